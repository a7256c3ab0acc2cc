//! Searches from far outside of a set visit little more than the points that are near enough: counted work.

use crate::support::Rng;
use mbkd::glam::Vec3;
use mbkd::{MovingPoint, PointParams, PointStructure, PointTree};

/// Blocks that searches for `k` visit, and blocks of searches that know the distance of the k-th neighbour.
fn blocks(tree: &PointTree, k: usize) -> [u64; 2] {
    let mut rng = Rng(5);
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
    let mut rng = Rng(3);
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
