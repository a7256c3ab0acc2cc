//! Far away: searches from far outside of a set visit little more than the points that are near enough (counted work), and how far
//! from zero a set may lie.

use crate::support::Random;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    MAX_COORDINATE, MovingPoint, NeighborLists, PointArrays, PointError, PointParams, PointStructure, PointTree,
};

/// Blocks that searches for `k` visit, and blocks of searches that know the distance of the k-th neighbour.
fn blocks(tree: &PointTree, k: usize) -> [u64; 2] {
    let mut rng = Random(5);
    let mut sum = [0; 2];
    for _ in 0..300 {
        // Beyond a corner of the unit cube.
        let (from, time) = ((rng.vec() + 1.0) * 1.5 + Vec3::new(4.0, -2.0, 1.0), rng.unit());
        let farthest = tree.nearest_n(from, time, k).last().expect("a neighbour").distance();
        sum[0] += tree.query(from, time).work(k).blocks;
        sum[1] += tree.query(from, time).radius(farthest.next_up()).work(usize::MAX).blocks;
    }
    sum
}

#[test]
fn the_nearest_leaves_give_a_threshold_for_the_others() {
    let mut rng = Random(3);
    let mut point = |motion: f32| {
        let p = (rng.vec() + 1.0) * 0.5;
        MovingPoint::new(p, p + rng.vec() * motion)
    };
    // Leaves of two blocks, and of one.
    for (count, motion) in [(100_000, 0.0), (100_000, 0.01), (400_000, 0.0)] {
        let points: Vec<MovingPoint> = (0..count).map(|_| point(motion)).collect();
        let structure = if motion > 0.0 { PointStructure::Linear } else { PointStructure::Automatic };
        let tree = PointTree::build(&points, &PointParams { structure, ..PointParams::default() }).unwrap();
        for k in [8, 11, 32, 64, 200] {
            let [visited, needed] = blocks(&tree, k);
            assert!(4 * visited <= 9 * needed, "{count} points, moving by {motion}, k = {k}: {visited} for {needed}");
        }
    }
}

/// Near the limit queries and lists find what they should; beyond it nothing is built. Without a limit, numbers inside trees would
/// overflow, or be those of no point.
#[test]
fn sets_in_f64_lie_as_far_from_zero_as_meshes_may() {
    for far in [1e20, 1e29, MAX_COORDINATE] {
        // A few times the spacing of f64 there, and a power of two, so that nothing is rounded.
        let step = 2f64.powi(far.log2().floor() as i32 - 50);
        let at = |i: usize, key: usize| DVec3::new(far - (i * (key + 1)) as f64 * step, step * i as f64, -far);
        let keys: Vec<Vec<DVec3>> = (0..3).map(|key| (0..40).map(|i| at(i, key)).collect()).collect();
        let rows: Vec<&[DVec3]> = keys.iter().map(|key| &key[..]).collect();
        for keys in [&rows[..1], &rows] {
            let tree = PointTree::build(&PointArrays { keys, active: &[], ids: &[] }, &PointParams::default()).unwrap();
            let mut lists = NeighborLists::new();
            tree.neighbor_lists(0.0, 1.5 * step as f32).run(&mut lists).unwrap();
            assert_eq!(lists.neighbors(), 2 * 39, "{far:e}");
            for (i, &query) in keys[keys.len() - 1].iter().enumerate() {
                assert_eq!(tree.nearest(query, 1.0).unwrap().id, i as u32, "{far:e}");
            }
        }
    }
    for far in [1.01e30, 1e54, 1e150, f64::MAX] {
        let (near, beyond) = ([DVec3::splat(1e30); 3], [DVec3::new(far, 0.1, 0.0); 3]);
        for keys in [&[&beyond[..]][..], &[&beyond, &near], &[&near, &near, &beyond]] {
            let tree = PointTree::build(&PointArrays { keys, active: &[], ids: &[] }, &PointParams::default());
            let Err(error @ PointError::TooLarge { point: 0, .. }) = tree else { panic!("{far:e} is built") };
            assert!(error.to_string().contains("than 1e30 from zero"), "{error}");
        }
    }
}
