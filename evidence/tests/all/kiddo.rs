//! Distances to neighbours equal those that kiddo finds among the points where they are at time t.

use crate::support::Cloud;
use kiddo::SquaredEuclidean;
use mbkd::glam::Vec3;
use mbkd::{MovingPoint, PointParams, PointTree};
use proptest::prelude::*;
use std::num::NonZero;

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn distances_equal_those_of_kiddo(
        points in prop::collection::vec((-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0), 40..400),
        ways in prop::collection::vec(-0.5f32..0.5, 1200),
        (x, y, z) in (-1.2f32..1.2, -1.2f32..1.2, -1.2f32..1.2),
        t in 0.0f32..=1.0,
        k in 1usize..40,
    ) {
        let points: Vec<MovingPoint> = points.iter().zip(ways.chunks(3)).map(|(p, w)| {
            let p = Vec3::new(p.0, p.1, p.2);
            MovingPoint::new(p, p + Vec3::new(w[0], w[1], w[2]))
        }).collect();
        let cloud = Cloud::moving(&points);
        // kiddo gets the points where they are at time t.
        let now: Vec<[f32; 3]> = (0..points.len()).map(|i| cloud.at(i, t).to_array()).collect();
        let kiddo = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&now).unwrap();
        let tree = PointTree::build(&points, &PointParams::default()).unwrap();
        let still = PointTree::build(&now, &PointParams::default()).unwrap();
        let q = [x, y, z];
        let theirs = kiddo.query(&q).nearest_n::<SquaredEuclidean<f32>>(NonZero::new(k).unwrap()).execute();
        for ours in [tree.nearest_n(q, t, k), still.nearest_n(q, t, k)] {
            prop_assert_eq!(ours.len(), theirs.len());
            for (a, b) in ours.iter().zip(&theirs) {
                // Up to the rounding of its sums.
                prop_assert!((a.distance_squared - b.distance).abs() <= 4.0 * f32::EPSILON * a.distance_squared);
            }
        }
    }
}
