//! `approximate`, with and without a radius: never fewer answers than the exact search, and each within 1 + ε.

use crate::support::{Cloud, KINDS, Random, cloud};
use mbkd::glam::Vec3;
use mbkd::{MAX_POINT_COORDINATE, MovingPoint, Neighbor, PointParams, PointStructure, PointTree, SimdLevel};
use proptest::prelude::*;

const EPSILONS: [f32; 9] = [0.0, 1e-3, 0.1, 0.5, 2.0, 30.0, 1e10, f32::MAX, f32::INFINITY];

/// Queries farther from zero along an axis find nothing.
const FAR: Vec3 = Vec3::splat(MAX_POINT_COORDINATE as f32);

/// Whether `found` is a valid approximation of `exact`.
fn allowed(found: Neighbor, exact: Neighbor, epsilon: f32) -> bool {
    let [found, exact] = [found, exact].map(|n| f64::from(n.distance_squared).sqrt());
    found <= exact * (1.0 + f64::from(epsilon)) || found == exact
}

/// Compares all approximate searches at one point with the points in order.
fn check(tree: &PointTree, all: &[Neighbor], q: Vec3, time: f32, k: usize, radius: f32) -> Result<(), String> {
    let inside = &all[..all.partition_point(|n| n.distance_squared <= radius * radius)];
    for epsilon in EPSILONS {
        let query = tree.query(q, time).radius(radius).approximate(epsilon);
        let found = query.nearest_n(k);
        let what = format!("epsilon {epsilon}, k {k}, radius {radius}, q {q}, time {time}");
        if found.len() != k.min(inside.len()) {
            return Err(format!("{what}: {} found of {}", found.len(), k.min(inside.len())));
        }
        let wrong = found.iter().zip(inside).find(|(f, e)| !allowed(**f, **e, epsilon) || !inside.contains(f));
        if let Some((f, e)) = wrong {
            return Err(format!("{what}: {f:?} for {e:?}"));
        }
        if !found.is_sorted_by_key(|n| (n.distance_squared.to_bits(), n.id)) {
            return Err(format!("{what}: out of order"));
        }
        match (query.nearest(), inside.first()) {
            (None, None) => {}
            (Some(f), Some(e)) if allowed(f, *e, epsilon) && inside.contains(&f) => {}
            (f, e) => return Err(format!("{what}: nearest {f:?} for {e:?}")),
        }
    }
    Ok(())
}

#[test]
fn a_radius_is_never_shrunk_and_any_epsilon_answers() {
    for kind in KINDS {
        let mut rng = Random(7);
        let cloud = cloud(kind, 900, &mut rng);
        let points: Vec<MovingPoint> = (0..900)
            .map(|i| MovingPoint::new(cloud.keys[0][i], cloud.keys[1][i]).with_active(cloud.active[i]))
            .collect();
        for structure in [PointStructure::Automatic, PointStructure::TimeSlices(3), PointStructure::Kd] {
            for simd in SimdLevel::available() {
                let params = PointParams { structure, simd, ..PointParams::default() };
                let tree = PointTree::build(&points, &params).unwrap();
                for i in 0..6 {
                    let time = rng.unit();
                    let scale = cloud.at(0, time).abs().max_element();
                    let member = cloud.at(rng.below(900), time);
                    let q = if i % 2 == 0 { member } else { (rng.vec() * 1.2 * scale).clamp(-FAR, FAR) };
                    let all = cloud.sorted(q, time);
                    for (k, reach) in [(1, 0), (1, 3), (5, 2), (8, 40), (20, 20), (40, 500), (64, 64)] {
                        let radius = all.get(reach).map_or(f32::INFINITY, |n| n.distance());
                        for radius in [radius, f32::INFINITY] {
                            if let Err(e) = check(&tree, &all, q, time, k, radius) {
                                panic!("{kind}, {structure:?}, {simd}: {e}");
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Two leaves: the one whose box holds the query has its points at distance 1, the other one a point that is `near`.
/// An answer of 1 is too far as soon as `near * (1 + epsilon) < 1`.
#[test]
fn the_factor_is_applied_once() {
    let mut seen = 0;
    for step in 1..40 {
        let near = 0.58 + 0.01 * step as f32;
        let mut points = Vec::new();
        for i in 0..16 {
            let sign = |bit: usize| if i >> bit & 1 == 0 { 1.0f32 } else { -1.0 };
            points.push(Vec3::new(sign(0), sign(1), sign(2)) * (1.0f32 / 3.0).sqrt());
            points.push(Vec3::new(near + 0.01 * i as f32, 0.0, 0.0));
        }
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let all = Cloud::still(points).sorted(Vec3::ZERO, 0.0);
        for epsilon in [0.05f32, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6] {
            let query = tree.query(Vec3::ZERO, 0.0).approximate(epsilon);
            for found in [query.nearest().unwrap(), query.nearest_n(1)[0]] {
                assert!(allowed(found, all[0], epsilon), "{found:?} for {:?}, epsilon {epsilon}", all[0]);
                seen += usize::from(found != all[0]);
            }
        }
    }
    assert!(seen > 20, "nothing was ever skipped: the test sees nothing");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn approximate_and_radius_together(
        seed in any::<u64>(),
        count in 1usize..3000,
        spread in 0usize..4,
        k in 1usize..50,
        reach in 0usize..200,
        part in 0.5f32..1.5,
    ) {
        let mut rng = Random(seed);
        let length = [0.0, 0.01, 0.3, 2.0][spread];
        let points: Vec<MovingPoint> = (0..count).map(|_| {
            let p = rng.vec();
            MovingPoint::new(p, p + rng.vec() * length)
        }).collect();
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let cloud = Cloud::moving(&points);
        let (q, time) = (rng.vec() * 1.5, rng.unit());
        let all = cloud.sorted(q, time);
        let radius = all[reach.min(count - 1)].distance() * part;
        prop_assert_eq!(check(&tree, &all, q, time, k, radius), Ok(()));
    }
}
