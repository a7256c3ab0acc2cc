//! Trees from step to step of a simulation: built again from the order of the last step, and that order handed out.

use crate::support::{Random, STRUCTURES, build, cloud};
use mbkd::{NeighborLists, PointArrays, PointParams, PointTree, SimdLevel, glam::Vec3};

/// A tree that is rebuilt from the order of the last step gives the same answers, and is built from scratch if necessary.
#[test]
fn rebuilt_trees_answer_like_new_ones() {
    for count in [0, 1, 16, 17, 300, 5_000] {
        let mut rng = Random(count as u64);
        let mut points: Vec<Vec3> = (0..count).map(|_| rng.vec()).collect();
        let params = PointParams::default();
        let mut tree = PointTree::build(&points, &params).unwrap();
        let (mut kept, mut afresh) = (0, 0);
        for step in 0..40 {
            let speed = if step == 30 { 0.5 } else { 0.002 };
            points.iter_mut().for_each(|p| *p += rng.vec() * speed);
            let same_order = tree.rebuild(&points, &params).unwrap();
            if same_order {
                kept += 1
            } else {
                afresh += 1
            }
            if step % 7 == 3 {
                let order = tree.take_order();
                points = order.iter().map(|&id| points[id as usize]).collect();
            }
            let new = PointTree::build(&points, &params).unwrap();
            let lists = [&tree, &new].map(|tree| {
                let mut lists = NeighborLists::new();
                tree.neighbor_lists(0.0, 0.15).in_order().sorted().with_distances().run(&mut lists).unwrap();
                lists
            });
            assert_eq!(lists[0].offsets(), lists[1].offsets(), "{count} points, step {step}");
            assert_eq!(lists[0].ids(), lists[1].ids());
            assert_eq!(lists[0].distances_squared(), lists[1].distances_squared());
        }
        if count >= 5_000 {
            assert!(kept > 20 && afresh >= 1, "{count} points: {kept} kept, {afresh} afresh");
        }
        // Another set, a moving one, one with ids, and one that cannot be built.
        points.push(Vec3::ONE);
        assert!(!tree.rebuild(&points, &params).unwrap());
        assert_eq!(tree.len(), count + 1);
        assert!(tree.rebuild(&[Vec3::NAN] as &[Vec3], &params).is_err());
        let bad = vec![Vec3::NAN; count + 1];
        assert!(tree.rebuild(&bad, &params).is_err());
        assert_eq!(tree.nearest(Vec3::ONE, 0.0).map(|n| n.distance_squared), Some(0.0), "as it was");
        let ids: Vec<u32> = (0..count as u32 + 1).map(|i| 2 * i + 7).collect();
        let set = PointArrays { keys: &[&points], active: &[], ids: &ids };
        assert!(!tree.rebuild(&set, &params).unwrap());
        assert!(!tree.rebuild(&set, &params).unwrap(), "ids that are not indices are not kept");
        assert!(!tree.rebuild(&points, &params).unwrap(), "nor taken for indices");
        assert!(tree.rebuild(&points, &params).unwrap());
    }
}

/// Where points are drawn together while they mix, the boxes of leaves may become no larger at all.
#[test]
fn orders_are_not_kept_of_points_that_mix_while_they_are_drawn_together() {
    let params = PointParams::default();
    for core in [1.0, 0.1, 0.01, 1e-4] {
        let mut rng = Random(5);
        // A tenth stays, the others mix within the core; or all of them do, and shrink to it.
        for (all, within) in [(true, 1.0), (false, core)] {
            let place = |rng: &mut Random, i: usize, size: f32| {
                rng.vec() * if all || !i.is_multiple_of(10) { size } else { 1.0 }
            };
            let first: Vec<Vec3> = (0..20_000).map(|i| place(&mut rng, i, within)).collect();
            let last: Vec<Vec3> = (0..20_000).map(|i| place(&mut rng, i, core)).collect();
            let mut tree = PointTree::build(&first, &params).unwrap();
            let (mut points, mut kept) = (first.clone(), 0);
            for step in 1..=20 {
                let mixed = |i: usize| all || !i.is_multiple_of(10);
                (0..20_000).filter(|&i| mixed(i)).for_each(|i| points[i] = first[i].lerp(last[i], step as f32 / 20.0));
                kept += usize::from(tree.rebuild(&points, &params).unwrap());
            }
            // Where all shrink to a small core, they are mixed in the last step only.
            assert!(
                kept < if all && core < 0.1 { 20 } else { 15 },
                "{kept} of 20 orders kept, core of {core}, all: {all}"
            );
        }
    }
    // As a whole, a set may shrink, grow and move: its order stays as good.
    let mut rng = Random(6);
    let points: Vec<Vec3> = (0..20_000).map(|_| rng.vec()).collect();
    let mut tree = PointTree::build(&points, &params).unwrap();
    for size in [2.0, 50.0, 1.0, 0.1, 1e-5, 1.0] {
        let there: Vec<Vec3> = points.iter().map(|p| *p * size + Vec3::X * size).collect();
        assert!(tree.rebuild(&there, &params).unwrap(), "size {size}");
    }
}

#[test]
fn orders_of_moving_trees_name_each_point_once() {
    for kind in ["random", "fast few", "short intervals"] {
        let cloud = cloud(kind, 500, &mut Random(2));
        for structure in STRUCTURES {
            let mut tree = build(&cloud, structure, SimdLevel::best());
            let before: Vec<_> = (0..20).map(|i| tree.nearest(cloud.keys[0][i], 0.5).unwrap()).collect();
            let order = tree.take_order();
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert!(sorted.into_iter().eq(0..500), "{kind}, {structure:?}");
            for (i, before) in before.into_iter().enumerate() {
                let after = tree.nearest(cloud.keys[0][i], 0.5).unwrap();
                assert_eq!((order[after.id as usize], after.distance_squared), (before.id, before.distance_squared));
            }
        }
    }
}
