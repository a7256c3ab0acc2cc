//! Closest approaches in periodic boxes: those of the nearest image of the query's path.

use crate::periodic_queries::{Lengths, images, lengths, place};
use crate::support::{Cloud, Random};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{Approach, MovingPoint, PointArrays, PointParams, PointStructure, PointTree, Precision, TimeInterval};

/// The path's images, from far before the points to far behind them.
fn paths([from, to]: [DVec3; 2], lengths: Lengths, (low, high): (DVec3, DVec3)) -> Vec<[DVec3; 2]> {
    let way = to - from;
    let around = (low - way.max(DVec3::ZERO), high - way.min(DVec3::ZERO));
    let end = |begin: DVec3| if begin == from { to } else { begin + way };
    images(from, lengths, around).into_iter().map(|begin| [begin, end(begin)]).collect()
}

fn nearest(approaches: impl Iterator<Item = Option<Approach>>) -> Option<Approach> {
    approaches.flatten().min_by_key(|near| (near.distance.to_bits(), near.time.to_bits(), near.id))
}

#[test]
fn approaches_are_those_of_the_nearest_image_of_the_path() {
    // How many were of other images than the path as it is.
    let mut others = 0;
    for seed in 0..72u64 {
        let mut rng = Random(seed);
        let (size, away) = ([1.0f32, 1e-3, 1e6][seed as usize % 3], [0.0, 0.3, 1e3][seed as usize / 3 % 3]);
        let keys = 1 + seed as usize % 4;
        let mut at: Vec<Vec3> =
            (0..[1, 7, 60][seed as usize % 3]).map(|_| (rng.vec() + Vec3::splat(away)) * size).collect();
        let cloud = Cloud {
            active: at
                .iter()
                .map(|_| {
                    let begin = rng.unit() * 0.6;
                    if rng.unit() < 0.3 { TimeInterval::new(begin, begin + 0.4).unwrap() } else { TimeInterval::FULL }
                })
                .collect(),
            keys: (0..keys)
                .map(|_| {
                    at.iter_mut().for_each(|at| *at += rng.vec() * size * 0.5);
                    at.clone()
                })
                .collect(),
        };
        let structure = [PointStructure::Automatic, PointStructure::Linear, PointStructure::Kd][seed as usize / 2 % 3];
        // Kd are for f32.
        let double = structure != PointStructure::Kd && seed / 4 % 2 == 1;
        let precision = if double { Precision::Double } else { Precision::Single };
        let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
        let set = PointArrays { keys: &keys, active: &cloud.active, ids: &[] };
        let tree = PointTree::build(&set, &PointParams { structure, precision, ..PointParams::default() }).unwrap();
        let lengths = lengths(&mut rng, size);
        let periodic = tree.periodic(lengths).unwrap();
        let ends = || cloud.keys.iter().flatten().map(|p| p.as_dvec3());
        let bounds = (ends().fold(ends().next().unwrap(), DVec3::min), ends().fold(ends().next().unwrap(), DVec3::max));
        for turn in 0..10 {
            let from = place(&mut rng, size, away).as_dvec3();
            let to = from + rng.vec().as_dvec3() * f64::from(size) * [0.0, 0.3, 4.0][turn % 3];
            let begin = rng.unit() * 0.9;
            let interval = TimeInterval::new(begin, begin + 0.1).unwrap();
            let interval = if turn % 2 == 0 { TimeInterval::FULL } else { interval };
            let odd = |id: u32| turn % 4 != 3 || id % 2 == 1;
            let open = |[from, to]: [DVec3; 2]| tree.closest_approach_filtered(from, to, interval, odd);
            let expected = nearest(paths([from, to], lengths, bounds).into_iter().map(open));
            let found = periodic.closest_approach_filtered(from, to, interval, odd);
            assert_eq!(found, expected, "seed {seed}, {from} to {to} in {interval:?}");
            others += usize::from(found != open([from, to]));
            if turn % 4 != 3 {
                assert_eq!(periodic.closest_approach(from, to, interval), expected, "seed {seed}");
            }
            // The same numbers in f32.
            let [from, to] = [from, to].map(DVec3::as_vec3);
            let wide = periodic.closest_approach_filtered(from.as_dvec3(), to.as_dvec3(), interval, odd);
            assert_eq!(periodic.closest_approach_filtered(from, to, interval, odd), wide, "seed {seed}");
        }
    }
    assert!(others > 200, "{others}");
}

/// Copies of the points in the boxes around theirs, found in open space.
#[test]
fn approaches_are_as_near_as_those_of_copies_of_the_points() {
    let mut rng = Random(8);
    for _ in 0..20 {
        let points: Vec<MovingPoint> = (0..30)
            .map(|_| {
                let at = (rng.vec() + Vec3::ONE) * 0.5;
                MovingPoint::new(at, at + rng.vec() * 0.4)
            })
            .collect();
        let copies: Vec<MovingPoint> = (0..125)
            .flat_map(|n| {
                let by = Vec3::new((n % 5) as f32, (n / 5 % 5) as f32, (n / 25) as f32) - Vec3::splat(2.0);
                points.iter().map(move |p| MovingPoint::new(p.open + by, p.close + by))
            })
            .collect();
        let [tree, open] = [points, copies].map(|set| PointTree::build(&set, &PointParams::default()).unwrap());
        let periodic = tree.periodic([Some(1.0); 3]).unwrap();
        for _ in 0..10 {
            let from = (rng.vec() + Vec3::ONE) * 0.5;
            let to = from + rng.vec();
            let found = periodic.closest_approach(from, to, TimeInterval::FULL).unwrap();
            let copy = open.closest_approach(from, to, TimeInterval::FULL).unwrap();
            assert!((found.distance - copy.distance).abs() < 2e-6, "{found:?} {copy:?}");
            // Points far from each other may be equally near but for rounding.
            assert!(found.id == copy.id % 30 || copy.distance < 1e-5, "{found:?} {copy:?}");
        }
    }
}

#[test]
fn paths_that_end_nowhere_or_far_away_find_nothing() {
    let tree = PointTree::build(&[Vec3::splat(0.5)], &PointParams::default()).unwrap();
    let periodic = tree.periodic([Some(1.0), Some(2.0), None]).unwrap();
    let all = TimeInterval::FULL;
    for end in [DVec3::NAN, DVec3::X * f64::INFINITY, DVec3::X * 16.1, DVec3::Y * -32.1, DVec3::Z * 1e30] {
        assert_eq!(periodic.closest_approach(DVec3::ZERO, end, all), None, "{end}");
        assert_eq!(periodic.closest_approach(end, DVec3::ZERO, all), None, "{end}");
    }
    for end in [DVec3::X * 16.0, DVec3::Y * -32.0, DVec3::Z * 1e17] {
        assert!(periodic.closest_approach(DVec3::ZERO, end, all).is_some(), "{end}");
    }
    // From any period.
    let far = DVec3::new(1e9, -2e9, 0.5) + 0.25;
    let near = periodic.closest_approach(far, far + DVec3::X, all).unwrap();
    assert!((near.time - 0.25).abs() < 1e-6, "{near:?}");
    assert_eq!(periodic.closest_approach_filtered(DVec3::ZERO, DVec3::X, all, |_| false), None);
    let empty = PointTree::build(&[] as &[Vec3], &PointParams::default()).unwrap();
    assert_eq!(empty.periodic([Some(1.0); 3]).unwrap().closest_approach(Vec3::ZERO, Vec3::X, all), None);
}
