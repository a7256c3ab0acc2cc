//! Reports of progress, and cancellation at any of them.

use crate::common::{divided, soup};
use core::ops::ControlFlow;
use mbkd::glam::DVec3;
use mbkd::{
    BuildError, BuildParams, Division, Instance, InstanceError, InstanceTree, LazyParams, MovingSphere, Pose, RayTree,
    Shape, TriangleMesh, WideParams,
};
use std::sync::{Arc, Mutex};

const TRIANGLES: usize = 200_000;

/// No report may be further from the one before. (A step that turns out not to be needed, such as moving subtrees, counts at once.)
const LARGEST_GAP: f32 = 0.07;

type Report<'a> = &'a (dyn Fn(f32) -> ControlFlow<()> + Sync);

/// A build that reports its progress.
type Build<'a> = &'a (dyn Fn(Report<'_>) -> Result<(), BuildError> + Sync);

/// What a build reports, and its result. It is cancelled once `enough` of the number of reports and the fraction.
fn reported(build: Build<'_>, enough: impl Fn(usize, f32) -> bool + Sync) -> (Vec<f32>, Result<(), BuildError>) {
    let told = Mutex::new(Vec::new());
    let hear = |done: f32| {
        let mut told = told.lock().unwrap();
        told.push(done);
        if enough(told.len(), done) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let result = build(&hear);
    (told.into_inner().unwrap(), result)
}

/// Checks that reports increase from above 0 to below 1 without a large gap.
fn assert_even(what: &str, told: &[f32]) {
    let mut before = 0.0;
    for &done in told {
        assert!(done > before && done < 1.0, "{what}: {done} after {before}");
        assert!(done - before <= LARGEST_GAP, "{what}: {done} after {before}");
        before = done;
    }
    assert!(1.0 - before <= LARGEST_GAP, "{what}: the last one is {before}");
}

/// Checks a build on one thread and on several.
fn check(what: &str, expected: &Result<(), BuildError>, build: Build<'_>) {
    let on = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let (one, four) = (on(1), on(4));
    let (mut told, result) = one.install(|| reported(build, |_, _| false));
    assert_eq!(result, *expected, "{what}");
    if expected.is_ok() {
        assert_eq!(told.pop(), Some(1.0), "{what}: the end is told");
    }
    assert_even(what, &told);
    let cancelled = Err(BuildError::Cancelled);
    for share in [0.0, 0.2, 0.5, 0.8, 0.95] {
        let last = ((told.len() as f64 * share) as usize).max(1);
        let (until, result) = one.install(|| reported(build, |count, _| count == last));
        assert_eq!((result, &until[..]), (cancelled.clone(), &told[..last]), "{what}, cancelled at report {last}");
    }
    // While a thread reports, others go on. So it is not certain at which fractions there are reports.
    let (told, result) = four.install(|| reported(build, |_, _| false));
    assert_eq!((result, told.is_sorted_by(|a, b| a < b)), (expected.clone(), true), "{what}: {told:?}");
    assert_eq!(told.last() == Some(&1.0), expected.is_ok(), "{what}: {told:?}");
    for share in [0.0, 0.5] {
        let (until, result) = four.install(|| reported(build, |_, done| done > share));
        assert_eq!(result, cancelled, "{what}, cancelled at {share}");
        let (last, before) = until.split_last().unwrap();
        assert!(*last > share && before.iter().all(|done| *done <= share), "{what}: {until:?}");
    }
}

fn check_meshes(what: &str, meshes: &[TriangleMesh], params: &BuildParams) {
    check(what, &Ok(()), &|report| RayTree::build_with_progress(meshes, params, report).map(|_| ()));
}

#[test]
fn builds_of_triangles_report_evenly_and_can_be_cancelled_at_any_report() {
    let params = BuildParams::default();
    check_meshes("static", &[soup(TRIANGLES, 1, 0.02, 0.0, 1)], &params);
    check_meshes("long triangles", &[soup(TRIANGLES, 1, 0.5, 0.0, 2)], &params);
    check_meshes("two keys", &[soup(TRIANGLES, 2, 0.02, 0.05, 3)], &params);
    check_meshes("two keys, hardly moving", &[soup(TRIANGLES, 2, 0.02, 1e-4, 4)], &params);
}

#[test]
fn builds_with_time_slices_report_evenly_and_can_be_cancelled_at_any_report() {
    let bent = [soup(TRIANGLES / 4, 9, 0.02, 0.3, 5)];
    check_meshes("bent", &bent, &BuildParams::default());
    check_meshes("bent, shared leaves", &bent, &divided(Division::SharedLeaves(8)));
    let straight = [soup(TRIANGLES, 2, 0.02, 0.3, 6)];
    check_meshes("separate trees", &straight, &divided(Division::SeparateTrees(4)));
}

#[test]
fn coarse_builds_of_lazy_trees_report_evenly_and_can_be_cancelled_at_any_report() {
    check_meshes("lazy", &[soup(TRIANGLES, 2, 0.02, 0.05, 7)], &BuildParams::lazy(LazyParams::default()));
}

/// A build that exceeds its budget begins again, with what is left of its progress.
#[test]
fn builds_that_exceed_their_budget_report_as_well() {
    let meshes = [soup(20_000, 9, 0.2, 0.3, 3)];
    for bytes_per_primitive in [128.0, 160.0, 200.0] {
        let params = BuildParams::wide(WideParams { bytes_per_primitive, ..WideParams::default() });
        let expected = RayTree::build(&meshes, &params).map(|_| ());
        let build = |report: Report<'_>| RayTree::build_with_progress(&meshes, &params, report).map(|_| ());
        let (told, result) = reported(&build, |_, _| false);
        assert_eq!((result, told.is_sorted_by(|a, b| a < b)), (expected.clone(), true), "{told:?}");
        assert_eq!(told.last() == Some(&1.0), expected.is_ok(), "{told:?}");
        for share in [0.1, 0.5, 0.9] {
            let (until, result) = reported(&build, |_, done| done > share);
            assert_eq!(result, Err(BuildError::Cancelled), "{bytes_per_primitive}, cancelled at {share}: {until:?}");
        }
    }
}

#[test]
fn builds_of_shapes_and_instances_report_evenly_and_can_be_cancelled_at_any_report() {
    let at = |i: usize| DVec3::new((i % 50) as f64, (i / 50 % 50) as f64, (i / 2500) as f64);
    let ball = |i: usize| MovingSphere::new(vec![(at(i), 0.4), (at(i) + DVec3::X, 0.3)]);
    let params = BuildParams::default();
    check("spheres", &Ok(()), &|report| {
        let shapes: Vec<Shape> = (0..TRIANGLES / 2).map(|i| ball(i).into()).collect();
        RayTree::of_scene_with_progress(&[], shapes, &params, report).map(|_| ())
    });
    check("primitives", &Ok(()), &|report| {
        RayTree::of_scene_with_progress(&[], (0..TRIANGLES / 2).map(ball).collect(), &params, report).map(|_| ())
    });
    let of = Arc::new(RayTree::build(&[soup(10, 1, 0.1, 0.0, 9)], &params).unwrap());
    let placed = |i: usize| Instance::new(of.clone(), Pose { translation: at(i), ..Pose::IDENTITY });
    check("instances", &Ok(()), &|report| {
        let instances = (0..TRIANGLES / 4).map(placed).collect();
        InstanceTree::build_with_progress(instances, &WideParams::default(), report).map(|_| ()).map_err(|error| {
            match error {
                InstanceError::Build(error) => error,
                other => panic!("{other}"),
            }
        })
    });
}
