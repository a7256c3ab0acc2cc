//! What calls of trees of instances report: work of queries, `Debug`.

use super::common::{Random, random_ray, soup};
use core::ops::ControlFlow;
use mbkd::glam::{DAffine3, DVec3};
use mbkd::{BuildParams, Counters, Instance, InstanceTree, LazyParams, RayTree, WideParams};
use std::sync::Arc;

/// This many copies of a tree, in a row along x.
fn row(tree: &Arc<RayTree>, count: usize) -> Vec<Instance> {
    let place = |i: usize| Instance::new(tree.clone(), DAffine3::from_translation(DVec3::X * 0.2 * i as f64));
    (0..count).map(place).collect()
}

fn leaf(params: &BuildParams) -> Arc<RayTree> {
    Arc::new(RayTree::build(&[soup(200, 2, 0.3, 0.2, 3)], params).unwrap())
}

#[test]
fn an_observer_sees_the_work_of_all_hits_and_changes_no_answer() {
    let tree = InstanceTree::build(row(&leaf(&BuildParams::default()), 20), &WideParams::default()).unwrap();
    let (mut random, mut all, mut first) = (Random(1), Counters::default(), Counters::default());
    for _ in 0..100 {
        let ray = random_ray(&mut random, 1.0);
        let (mut plain, mut observed) = (Vec::new(), Vec::new());
        let _ = tree.all_hits(&ray, |hit| {
            plain.push(hit);
            ControlFlow::Continue(())
        });
        let flow = tree.all_hits_observed(&ray, &mut all, |hit| {
            observed.push(hit);
            ControlFlow::Continue(())
        });
        assert!(flow.is_continue());
        assert_eq!(observed, plain);
        let flow = tree.all_hits_observed(&ray, &mut first, |_| ControlFlow::Break(()));
        assert_eq!(flow.is_break(), !plain.is_empty());
    }
    // Work in the placed trees counts too: there are only a few leaves over twenty instances.
    assert!(all.leaves > first.leaves && first.leaves > 100 && all.nodes > 0, "{all:?} {first:?}");
}

/// `{:?}` of a lazy tree must not look at subtrees, which takes as long as there are many.
#[test]
fn debug_prints_what_is_known_without_a_visit() {
    let tree = leaf(&BuildParams::lazy(LazyParams { subtree: 20, ..LazyParams::default() }));
    let instances = InstanceTree::build(row(&tree, 2), &WideParams::default()).unwrap();
    let printed = format!("{tree:?} {instances:?}");
    assert_eq!(printed, "RayTree { primitives: 200, layout: \"lazy\", .. } InstanceTree { len: 2, levels: 1, .. }");
    assert_eq!(format!("{:?}", leaf(&BuildParams::paper())), "RayTree { primitives: 200, layout: \"k-d\", .. }");
    assert_eq!(format!("{:?}", leaf(&BuildParams::default())), "RayTree { primitives: 200, layout: \"wide\", .. }");
}
