//! Property tests with shrinking: against comparing all points, and against the tree itself under transformations that
//! must not matter. (Against kiddo: `evidence/tests/all/kiddo.rs`.)

use crate::support::Cloud;
use mbkd::glam::Vec3;
use mbkd::{MovingPoint, Neighbor, PointParams, PointStructure, PointTree, TimeInterval};
use proptest::prelude::*;

/// Coordinates on a coarse grid half of the time: ties, equal points and points in planes.
fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![(-8i32..=8).prop_map(|x| x as f32 * 0.25), -2.0f32..2.0]
}

fn place() -> impl Strategy<Value = Vec3> {
    (coordinate(), coordinate(), coordinate()).prop_map(|(x, y, z)| Vec3::new(x, y, z))
}

fn interval() -> impl Strategy<Value = TimeInterval> {
    prop_oneof![
        Just(TimeInterval::FULL),
        (0u32..16, 1u32..=16).prop_map(|(begin, length)| {
            let end = (begin + length).min(16);
            TimeInterval::new(begin as f32 / 16.0, end as f32 / 16.0).unwrap()
        }),
    ]
}

fn moving_point() -> impl Strategy<Value = MovingPoint> {
    let displacement = prop_oneof![Just(Vec3::ZERO), place(), place().prop_map(|p| p * 0.01)];
    (place(), displacement, interval())
        .prop_map(|(p, displacement, active)| MovingPoint::new(p, p + displacement).with_active(active))
}

fn structure() -> impl Strategy<Value = PointStructure> {
    prop_oneof![
        Just(PointStructure::Automatic),
        Just(PointStructure::Linear),
        (1usize..6).prop_map(PointStructure::TimeSlices),
        Just(PointStructure::Kd),
    ]
}

fn time() -> impl Strategy<Value = f32> {
    prop_oneof![(0u32..=16).prop_map(|t| t as f32 / 16.0), 0.0f32..=1.0]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn neighbours_equal_comparing_all(
        points in prop::collection::vec(moving_point(), 0..400),
        structure in structure(),
        queries in prop::collection::vec((place(), time(), 0usize..40, 0.0f32..3.0), 1..8),
    ) {
        let cloud = Cloud::moving(&points);
        let params = PointParams { structure, max_references: 6.0, ..PointParams::default() };
        let tree = PointTree::build(&points, &params).unwrap();
        for (q, t, k, r) in queries {
            let all = cloud.sorted(q, t);
            prop_assert_eq!(tree.nearest(q, t), all.first().copied());
            prop_assert_eq!(&tree.nearest_n(q, t, k)[..], &all[..k.min(all.len())]);
            let inside = &all[..all.partition_point(|n| n.distance_squared <= r * r)];
            prop_assert_eq!(&tree.query(q, t).radius(r).collect_sorted()[..], inside);
            prop_assert_eq!(&tree.nearest_n_within(q, t, k, r)[..], &inside[..k.min(inside.len())]);
        }
    }

    #[test]
    fn invariant_under_mirroring_scaling_and_farther_points(
        points in prop::collection::vec(moving_point(), 1..300),
        q in place(),
        t in time(),
        axes in 0usize..6,
        turned in any::<bool>(),
    ) {
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let found = tree.nearest_n(q, t, 10);
        // Mirrored in all axes: the same floats up to sign, hence the same bits of distances.
        let mirror = |p: Vec3| -p;
        let mirrored: Vec<_> = points.iter().map(|p| MovingPoint { open: mirror(p.open), close: mirror(p.close), ..*p }).collect();
        let params = PointParams { structure: [PointStructure::Linear, PointStructure::Kd][usize::from(turned)], ..PointParams::default() };
        let other = PointTree::build(&mirrored, &params).unwrap();
        prop_assert_eq!(&other.nearest_n(mirror(q), t, 10), &found);
        // Scaled by a power of two: distances scale exactly.
        let scale = 2f32.powi(axes as i32 - 3);
        let scaled: Vec<_> = points.iter().map(|p| MovingPoint { open: p.open * scale, close: p.close * scale, ..*p }).collect();
        let other = PointTree::build(&scaled, &params).unwrap();
        let expected: Vec<Neighbor> = found.iter().map(|n| Neighbor { distance_squared: n.distance_squared * scale * scale, ..*n }).collect();
        prop_assert_eq!(other.nearest_n(q * scale, t, 10), expected);
        // Farther points do not change the nearest ones.
        let half = PointTree::build(&points[..points.len().div_ceil(2)], &PointParams::default()).unwrap();
        if let (Some(a), Some(b)) = (tree.nearest(q, t), half.nearest(q, t)) {
            prop_assert!(a.distance_squared <= b.distance_squared);
        }
    }
}
