//! What calls of trees of instances report: progress of builds, work of queries, `Debug`.

use super::common::{Random, random_ray, soup};
use core::ops::ControlFlow;
use core::sync::atomic::{AtomicUsize, Ordering};
use mbkd::glam::{DAffine3, DVec3};
use mbkd::{BuildError, BuildParams, Counters, Instance, InstanceError, InstanceTree, LazyParams, RayTree, WideParams};
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
fn builds_report_rising_fractions_up_to_one_and_stop_when_told() {
    let tree = leaf(&BuildParams::default());
    let (last, calls) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let note = |fraction: f32| {
        calls.fetch_add(1, Ordering::Relaxed);
        last.fetch_max((fraction * 1000.0) as usize, Ordering::Relaxed);
        ControlFlow::Continue(())
    };
    let params = WideParams::default();
    let reported = InstanceTree::build_with_progress(row(&tree, 500), &params, &note).unwrap();
    assert!(calls.load(Ordering::Relaxed) > 1 && last.load(Ordering::Relaxed) == 1000, "{calls:?}, {last:?}");
    assert_eq!(reported.statistics(), InstanceTree::build(row(&tree, 500), &params).unwrap().statistics());
    for stop_at in [0.0, 1.0] {
        let stop = |at: f32| if at >= stop_at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        let error = InstanceTree::build_with_progress(row(&tree, 500), &params, &stop).unwrap_err();
        assert_eq!(error, InstanceError::Build(BuildError::Cancelled));
    }
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
