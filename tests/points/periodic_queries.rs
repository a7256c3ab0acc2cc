//! Queries in periodic boxes: every answer equals brute force over all images of the query's place.

use crate::double::all;
use crate::set::Set;
use crate::support::{Cloud, Random};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    MovingPoint, Neighbor, PeriodError, PeriodicPoints, PointArrays, PointParams, PointStructure, PointTree, SimdLevel,
    TimeInterval,
};

/// Lengths of the periodic axes.
pub type Lengths = [Option<f64>; 3];

/// The place moved by whole periods: to all around a box, and farther.
pub fn images(place: DVec3, lengths: Lengths, (low, high): (DVec3, DVec3)) -> Vec<DVec3> {
    let along = |axis: usize| {
        let Some(length) = lengths[axis] else { return vec![place[axis]] };
        let inside = (0.0..length).contains(&place[axis]);
        let home = if inside { place[axis] } else { place[axis].rem_euclid(length) };
        let first = ((low[axis] - home) / length).floor() as i64 - 2;
        let last = ((high[axis] - home) / length).ceil() as i64 + 2;
        (first..=last).map(|periods| home + periods as f64 * length).collect()
    };
    let [xs, ys, zs]: [Vec<f64>; 3] = [along(0), along(1), along(2)];
    let mut images = Vec::new();
    for &x in &xs {
        for &y in &ys {
            images.extend(zs.iter().map(|&z| DVec3::new(x, y, z)));
        }
    }
    images
}

/// Each point at its nearest image, in order of (distance, id).
fn nearest_of(from_images: impl Iterator<Item = Vec<Neighbor>>) -> Vec<Neighbor> {
    let mut all: Vec<Neighbor> = from_images.flatten().collect();
    all.sort_by_key(|near| (near.id, near.distance_squared.to_bits()));
    all.dedup_by_key(|near| near.id);
    all.sort_by_key(|near| (near.distance_squared.to_bits(), near.id));
    all
}

fn check(periodic: &PeriodicPoints<'_>, (place, time): (DVec3, f32), all: &[Neighbor], rng: &mut Random) {
    let query = || periodic.query(place, time);
    assert_eq!(query().nearest(), all.first().copied());
    for k in [0, 1, 2, 8, 40] {
        assert_eq!(query().nearest_n(k), all[..k.min(all.len())], "{k}");
    }
    let odd: Vec<Neighbor> = all.iter().copied().filter(|near| near.id % 2 == 1).collect();
    assert_eq!(query().filter(|id| id % 2 == 1).nearest(), odd.first().copied());
    assert_eq!(query().filter(|id| id % 2 == 1).nearest_n(5), odd[..5.min(odd.len())]);
    let some = all.get(rng.below(all.len().max(1))).map_or(1.0, |near| near.distance_squared.sqrt());
    for radius in [0.0, some, 2.0 * some, f32::INFINITY, -1.0, f32::NAN] {
        let within = |near: &&Neighbor| radius >= 0.0 && near.distance_squared <= radius * radius;
        let within: Vec<Neighbor> = all.iter().take_while(within).copied().collect();
        assert_eq!(query().radius(radius).collect_sorted(), within, "{radius}");
        assert_eq!(query().radius(radius).count(), within.len(), "{radius}");
        let mut found = query().radius(radius).collect();
        found.sort_by_key(|near| (near.distance_squared.to_bits(), near.id));
        assert_eq!(found, within, "{radius}");
        assert_eq!(query().radius(radius).nearest_n(3), within[..3.min(within.len())], "{radius}");
        assert_eq!(query().radius(radius).nearest(), within.first().copied(), "{radius}");
    }
    for epsilon in [0.3f32, f32::INFINITY] {
        let factor = f64::from(1.0 + epsilon);
        let near = query().approximate(epsilon).nearest_n(6);
        assert_eq!(near.len(), 6.min(all.len()));
        for (near, exact) in near.iter().zip(all) {
            let [near, exact] = [near, exact].map(|of| f64::from(of.distance_squared).sqrt());
            assert!(near <= exact * factor * 1.0001, "{epsilon}: {near} {exact}");
        }
    }
}

/// The lengths of a box of about a size, and of open axes.
pub fn lengths(rng: &mut Random, size: f32) -> Lengths {
    [0, 1, 2].map(|_| (rng.unit() < 0.7).then(|| f64::from(size) * f64::from(0.7 + rng.unit())))
}

/// Places near the points, far from them, and on the faces of boxes.
pub fn place(rng: &mut Random, size: f32, away: f32) -> Vec3 {
    let far = if rng.unit() < 0.3 { 50.0 } else { 1.5 };
    let place = (rng.vec() * far + Vec3::splat(away)) * size;
    if rng.unit() < 0.2 { Vec3::new(0.0, place.y, 0.5 * size) } else { place }
}

#[test]
fn answers_are_those_of_the_nearest_image() {
    for seed in 0..48u64 {
        let mut rng = Random(seed);
        let (size, away) = ([1.0f32, 1e-3, 1e6][seed as usize % 3], [0.0, 0.3, 1e3][seed as usize / 3 % 3]);
        let points: Vec<MovingPoint> = (0..[1, 0, 7, 100][seed as usize % 4])
            .map(|i| {
                let at = (rng.vec() + Vec3::splat(away)) * size;
                let speed = rng.vec() * size * [0.0, 0.1][seed as usize % 2];
                let begin = rng.unit() * 0.6;
                let active = TimeInterval::new(begin, begin + 0.4).unwrap();
                MovingPoint::new(at, at + speed).with_active(if i % 3 == 0 { active } else { TimeInterval::FULL })
            })
            .collect();
        let structure = [PointStructure::Automatic, PointStructure::Linear, PointStructure::Kd][seed as usize / 2 % 3];
        let tree = PointTree::build(&points, &PointParams { structure, ..PointParams::default() }).unwrap();
        let cloud = Cloud::moving(&points);
        let lengths = lengths(&mut rng, size);
        let periodic = tree.periodic(lengths).unwrap();
        let ends = || cloud.keys.iter().flatten().map(|p| p.as_dvec3());
        let bounds = (ends().fold(DVec3::ZERO, DVec3::min), ends().fold(DVec3::ZERO, DVec3::max));
        let bounds = if away > 1.0 { (DVec3::splat(f64::from(away * size)) * 0.99, bounds.1) } else { bounds };
        for _ in 0..10 {
            let (place, time) = (place(&mut rng, size, away), rng.unit());
            let images = images(place.as_dvec3(), lengths, bounds);
            let all = nearest_of(images.iter().map(|image| cloud.sorted(image.as_vec3(), time)));
            check(&periodic, (place.as_dvec3(), time), &all, &mut rng);
        }
    }
}

#[test]
fn points_in_f64_are_found_at_their_nearest_image() {
    for seed in 0..24u64 {
        let mut rng = Random(seed);
        let size = [1.0f32, 1e7][seed as usize % 2];
        let set = Set::clusters(150, 2, (f64::from(size), 0.5 * f64::from(size), 1e-2), seed % 3 == 0, &mut rng);
        let tree = set.tree(PointStructure::Automatic, SimdLevel::best());
        let lengths = lengths(&mut rng, size);
        let periodic = tree.periodic(lengths).unwrap();
        let bounds = (DVec3::splat(-2.0 * f64::from(size)), DVec3::splat(2.0 * f64::from(size)));
        for _ in 0..8 {
            let (place, time) = (place(&mut rng, size, 0.0).as_dvec3() * (1.0 + 1e-10), rng.unit());
            let images = images(place, lengths, bounds);
            let all = nearest_of(images.iter().map(|&image| all(&set, image, time)));
            check(&periodic, (place, time), &all, &mut rng);
        }
    }
}

#[test]
fn batches_are_single_queries() {
    let mut rng = Random(31);
    // More than fit the cache up to which queries keep their order.
    let points: Vec<[f32; 3]> = (0..150_000).map(|_| rng.vec().to_array()).collect();
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    assert!(tree.statistics().bytes() > 2 << 20);
    let periodic = tree.periodic([Some(2.0), None, Some(2.5)]).unwrap();
    let accept = |query: usize, id: u32| id as usize % 3 != query % 3;
    let radius = |query: usize| [0.01, 0.03, 0.0][query % 3];
    let mut queries: Vec<(Vec3, f32)> = (0..2000).map(|_| (3.0 * rng.vec(), rng.unit())).collect();
    queries[7] = (Vec3::NAN, 0.5);
    queries[8] = (Vec3::ZERO, 1.5);
    let run = || {
        let lists = (periodic.nearest_n_batch(&queries, 4), periodic.within_batch(&queries, 0.03));
        (periodic.nearest_batch(&queries), lists, periodic.count_batch(&queries, 0.03))
    };
    let (nearest, (lists, within), counts) = run();
    let four = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap().install(run);
    assert_eq!((&nearest, &lists, &within, &counts), (&four.0, &four.1.0, &four.1.1, &four.2));
    let some = periodic.nearest_batch_with(&queries, |i, query| query.filter(move |id| accept(i, id)));
    let own = periodic.nearest_n_batch_with(&queries, 3, |i, query| query.radius(radius(i)));
    let all = periodic.within_batch_with(&queries, |i, query| query.radius(radius(i)).filter(move |id| accept(i, id)));
    let number =
        periodic.count_batch_with(&queries, |i, query| query.radius(radius(i)).filter(move |id| accept(i, id)));
    for (i, &(place, time)) in queries.iter().enumerate() {
        let query = || periodic.query(place, time);
        let filtered = || query().filter(|id| accept(i, id));
        assert_eq!((nearest[i], some[i]), (query().nearest(), filtered().nearest()), "{i}");
        assert_eq!(lists.row(i), query().nearest_n(4), "{i}");
        assert_eq!(own.row(i), query().radius(radius(i)).nearest_n(3), "{i}");
        assert_eq!(within.row(i), query().radius(0.03).collect_sorted(), "{i}");
        assert_eq!(all.row(i), filtered().radius(radius(i)).collect_sorted(), "{i}");
        assert_eq!(counts[i], within.row(i).len(), "{i}");
        assert_eq!(number[i], all.row(i).len(), "{i}");
    }
    assert!(nearest[7].is_none() && lists.row(8).is_empty() && counts[7..9] == [0, 0]);
    assert!(counts.iter().sum::<usize>() > 500 && number.iter().sum::<usize>() > 100);
    assert!(periodic.nearest_batch::<Vec3>(&[]).is_empty() && periodic.count_batch::<Vec3>(&[], 1.0).is_empty());
}

/// Several points of one id may be the nearest of an image, instead of others that belong to the nearest ids.
#[test]
fn points_with_one_id_take_no_place_of_others() {
    let at = |x: &[f32]| x.iter().map(|&x| [x, 0.0, 0.0]).collect::<Vec<_>>();
    let nearest = |x: &[f32], ids: &[u32], k: usize| {
        let set = PointArrays { keys: &[&at(x)], active: &[], ids };
        let tree = PointTree::build(&set, &PointParams::default()).unwrap();
        let periodic = tree.periodic([Some(1.0f32), None, None]).unwrap();
        let query = || periodic.query([0.0f32; 3], 0.0);
        let found = query().nearest_n(k);
        // Once for each id. Within half a period, points with the same id count like any others.
        let all = query().radius(9.0).collect_sorted();
        for (found, all) in found.iter().zip(&all) {
            assert!(found.distance_squared <= all.distance_squared, "{x:?} {ids:?}: {found:?} instead of {all:?}");
        }
        // Each point once, where it is nearest, in order.
        let of_point = |(&x, &id): (&f32, &u32)| Neighbor { id, distance_squared: (x * x).min((x - 1.0) * (x - 1.0)) };
        let mut points: Vec<Neighbor> = x.iter().zip(ids).map(of_point).collect();
        points.sort_by_key(|near| (near.distance_squared.to_bits(), near.id));
        let mut rest = points.iter();
        assert!(found.iter().all(|near| rest.any(|point| point == near)), "{x:?} {ids:?}: {found:?} of {points:?}");
        found.len()
    };
    assert_eq!(nearest(&[0.1, 0.62, 0.7, 0.55], &[0, 0, 0, 1], 2), 2);
    assert_eq!(nearest(&[0.1, 0.15, 0.7, 0.72, 0.4], &[0, 0, 2, 2, 1], 3), 3);
    let mut rng = Random(3);
    for _ in 0..2000 {
        let count = 2 + rng.below(9);
        let x: Vec<f32> = (0..count).map(|_| rng.unit()).collect();
        let ids: Vec<u32> = (0..count).map(|_| rng.below(4) as u32).collect();
        let different = (0..4).filter(|id| ids.contains(id)).count();
        // All of them, from both sides, reach farther than half a period.
        assert_eq!(nearest(&x, &ids, different), different, "{x:?} {ids:?}");
    }
}

/// Whether the other images find anything or not.
#[test]
fn what_a_filter_hides_does_not_tell_whether_ids_repeat() {
    let set =
        PointArrays { keys: &[&[[0.45f32, 0.0, 0.0], [0.5, 0.0, 0.0], [0.9, 0.0, 0.0]]], active: &[], ids: &[0, 0, 1] };
    let tree = PointTree::build(&set, &PointParams::default()).unwrap();
    let periodic = tree.periodic([Some(1.0f32), None, None]).unwrap();
    let query = || periodic.query([0.475f32, 0.0, 0.0], 0.0).radius(0.6).filter(|id| id != 1);
    assert_eq!(query().nearest_n(10), query().collect_sorted());
    assert_eq!(query().nearest_n(10).len(), query().count());
}

#[test]
fn an_open_box_is_no_box() {
    let mut rng = Random(4);
    let points: Vec<Vec3> = (0..500).map(|_| rng.vec()).collect();
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let open = tree.periodic([None::<f32>; 3]).unwrap();
    for _ in 0..50 {
        let place = rng.vec() * 2.0;
        assert_eq!(open.query(place, 0.5).nearest_n(7), tree.nearest_n(place, 0.5, 7));
        assert_eq!(open.query(place, 0.5).nearest(), tree.nearest(place, 0.5));
    }
}

#[test]
fn what_is_no_length_and_points_too_far_apart_are_errors() {
    let tree = PointTree::build(&[Vec3::ZERO, Vec3::X * 20.0], &PointParams::default()).unwrap();
    for (axis, length) in [(0, 0.0f32), (1, -1.0), (2, f32::NAN), (0, f32::INFINITY)] {
        let mut lengths = [Some(100.0); 3];
        lengths[axis] = Some(length);
        let error = tree.periodic(lengths).unwrap_err();
        assert_eq!(error, PeriodError::Length { axis });
        assert!(error.to_string().contains(&format!("axis {axis}")));
    }
    assert_eq!(tree.periodic([Some(1.0), None, None]).unwrap_err(), PeriodError::Extent { axis: 0 });
    assert_eq!(tree.periodic([Some(1e-300), None, None]).unwrap_err(), PeriodError::Extent { axis: 0 });
    assert!(tree.periodic([Some(2.0), None, Some(1e300)]).is_ok());
    // Not only of points that are apart.
    let far = PointTree::build(&[Vec3::splat(1e6)], &PointParams::default()).unwrap();
    for (length, right) in [(1e-20, false), (0.9e-6, false), (1e-6, true), (1e-3, true)] {
        let periodic = far.periodic([None, Some(length), None]);
        assert_eq!(periodic.is_ok(), right, "{length}");
        match periodic {
            Err(error) => assert_eq!(error, PeriodError::FarFromPeriod { axis: 1 }),
            // At most half a period away, and the rounding of a coordinate.
            Ok(periodic) => {
                let near = periodic.query(DVec3::new(1e6, 0.3 * length, 1e6), 0.0).nearest().unwrap();
                assert!(f64::from(near.distance_squared).sqrt() <= 0.5 * length + 0.0625, "{length}");
            }
        }
    }
    // Nothing is found where nothing would be found in open space.
    let periodic = tree.periodic([Some(2.0), None, None]).unwrap();
    let nowhere = [(Vec3::NAN, 0.5), (Vec3::ZERO, 1.5), (Vec3::ZERO, f32::NAN), (Vec3::splat(1e30), 0.5)];
    for (place, time) in nowhere {
        assert_eq!(periodic.query(place, time).nearest(), None);
        assert_eq!(periodic.query(place, time).nearest_n(3), []);
        assert_eq!(periodic.query(place, time).collect(), []);
        assert_eq!(periodic.query(place, time).count(), 0);
    }
}

#[test]
fn an_image_that_rounding_brings_within_the_radius_counts() {
    let tree = PointTree::build(&[Vec3::X * 5e5], &PointParams::default()).unwrap();
    let periodic = tree.periodic([Some(1e6), None, None]).unwrap();
    // Rounded to f32, it is at the point itself.
    let place = DVec3::X * 499_999.99;
    for periods in [-2.0, 0.0, 1.0] {
        let near = periodic.query(place + DVec3::X * (1e6 * periods), 0.0).radius(5e-3);
        assert_eq!(near.nearest().map(|near| near.distance_squared), Some(0.0));
        assert_eq!((near.nearest_n(2).len(), near.collect().len(), near.count()), (1, 1, 1));
    }
}

#[test]
fn squares_that_underflow_count() {
    let tree = PointTree::build(&[Vec3::ZERO], &PointParams::default()).unwrap();
    for place in [DVec3::X * 2e-23, DVec3::X * (1e-20 - 2e-23)] {
        let near = tree.periodic([Some(1e-20), None, None]).unwrap().query(place, 0.0).radius(0.0);
        assert_eq!((near.nearest().map(|near| near.id), near.nearest_n(2).len(), near.count()), (Some(0), 1, 1));
    }
}
