//! Reports of progress of builds of points, and cancellation at any of them.

use crate::support::{Random, cloud};
use core::ops::ControlFlow;
use mbkd::glam::{DVec3, Vec3};
use mbkd::point::{GatherError, GatherParams, Photon, PhotonMap, PhotonTime, VisiblePoint, VisiblePoints};
use mbkd::{PointArrays, PointError, PointParams, PointStructure, PointTree, Precision};
use std::sync::Mutex;

/// The longest part of a build between two reports on one thread.
const LARGEST_GAP: f32 = 0.12;

fn params(structure: PointStructure) -> PointParams {
    PointParams { structure, ..PointParams::default() }
}

#[test]
fn builds_report_progress_and_can_be_cancelled() {
    let mut rng = Random(21);
    let cloud = cloud("random", 100_000, &mut rng);
    let wide: Vec<Vec<DVec3>> =
        cloud.keys.iter().map(|key| key.iter().map(|p| p.as_dvec3() * 1.000_000_001).collect()).collect();
    let told = |params: &PointParams, keys: usize, precise: bool, stop_at: f32| {
        let told = Mutex::new(Vec::new());
        let hear = |done: f32| {
            assert!((0.0..=1.0).contains(&done), "{done} of the work is done");
            told.lock().unwrap().push(done);
            if done < stop_at { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let tree = if precise {
            let keys: Vec<&[DVec3]> = wide[..keys].iter().map(Vec::as_slice).collect();
            PointTree::build_with_progress(&PointArrays { keys: &keys, active: &[], ids: &[] }, params, &hear)
        } else {
            let keys: Vec<&[Vec3]> = cloud.keys[..keys].iter().map(Vec::as_slice).collect();
            PointTree::build_with_progress(&PointArrays { keys: &keys, active: &[], ids: &[] }, params, &hear)
        };
        (tree, told.into_inner().unwrap())
    };
    assert!(cloud.keys.len() > 1);
    for (structure, keys, precise) in [
        (PointStructure::Automatic, 1, false),
        (PointStructure::Automatic, 2, false),
        (PointStructure::Linear, 2, false),
        (PointStructure::TimeSlices(4), 2, false),
        (PointStructure::Kd, 2, false),
        (PointStructure::Automatic, 1, true),
        (PointStructure::TimeSlices(4), 2, true),
    ] {
        let what = format!("{structure:?} at {keys} keys, in f64: {precise}");
        let params = params(structure);
        let (whole, mut all) = told(&params, keys, precise, 2.0);
        assert_eq!(whole.unwrap().len(), 100_000, "{what}");
        assert_eq!(all.pop(), Some(1.0), "{what}: the end is told");
        let most = all.iter().copied().fold(0.0, f32::max);
        assert!(most > 0.98 && most < 1.0, "{what}: {most} is told to be done before the end");
        for stop_at in [0.0, 0.15] {
            let (none, all) = told(&params, keys, precise, stop_at);
            let most = all.iter().copied().fold(0.0, f32::max);
            assert_eq!(none.unwrap_err(), PointError::Cancelled, "{what}");
            // Skipped work is not reported as finished. The k-d tree makes leaves of the remaining nodes.
            assert!(most < 0.9 || structure == PointStructure::Kd, "{what}: went on to {most}");
        }
    }
}

/// On one thread, where each report comes.
#[test]
fn builds_report_evenly() {
    let mut rng = Random(22);
    let still: Vec<Vec3> = (0..200_000).map(|_| rng.vec()).collect();
    let mut moved = |by: f32| still.iter().map(|&p| p + rng.vec() * by).collect::<Vec<Vec3>>();
    let (hardly, far) = (moved(1e-4), moved(0.2));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for (what, keys, params) in [
        ("static", &[&still[..]][..], PointParams::default()),
        ("hardly moving", &[&still, &hardly], PointParams::default()),
        ("moving", &[&still, &far], PointParams::default()),
        ("time slices", &[&still, &far], params(PointStructure::TimeSlices(4))),
        ("k-d tree", &[&still, &far], params(PointStructure::Kd)),
        ("in f64", &[&still, &far], PointParams { precision: Precision::Double, ..PointParams::default() }),
    ] {
        let build = |enough: &(dyn Fn(usize) -> bool + Sync)| {
            let told = Mutex::new(Vec::new());
            let hear = |done: f32| {
                let mut told = told.lock().unwrap();
                told.push(done);
                if enough(told.len()) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let arrays = PointArrays { keys, active: &[], ids: &[] };
            let tree = pool.install(|| PointTree::build_with_progress(&arrays, &params, &hear));
            (tree.map(|tree| tree.len()), told.into_inner().unwrap())
        };
        let (whole, told) = build(&|_| false);
        assert_eq!(whole, Ok(200_000), "{what}");
        assert_eq!(told.iter().position(|&done| done == 1.0), Some(told.len() - 1), "{what}: {told:?}");
        let before = [0.0].iter().chain(&told);
        let gaps = before.zip(&told).map(|(before, done)| done - before);
        assert!(gaps.clone().all(|gap| gap > 0.0 && gap <= LARGEST_GAP), "{what}: {told:?}");
        for share in [0.0, 0.3, 0.6, 0.9] {
            let last = ((told.len() as f64 * share) as usize).max(1);
            let (none, until) = build(&|count| count == last);
            assert_eq!((none, &until[..]), (Err(PointError::Cancelled), &told[..last]), "{what}, at report {last}");
        }
    }
}

/// Photons with a stamp, those that move, both, and visible points; on one thread, where each report comes.
#[test]
fn builds_of_photons_report_evenly_and_can_be_cancelled() {
    const COUNT: usize = 100_000;
    let mut rng = Random(23);
    let mut photons = |stamped: fn(usize) -> bool| -> Vec<Photon<f32>> {
        let mut photon = |i: usize| {
            let (position, time) = (rng.vec(), rng.unit());
            let time = match stamped(i) {
                true => PhotonTime::At(time),
                false => PhotonTime::Carried { time, velocity: rng.vec() },
            };
            Photon { position, normal: Vec3::Z, flux: 1.0, time }
        };
        (0..COUNT).map(&mut photon).collect()
    };
    let kinds = [photons(|_| true), photons(|_| false), photons(|i| i % 2 == 0)];
    let seen: Vec<VisiblePoint> =
        (0..COUNT).map(|_| VisiblePoint { position: rng.vec(), time: rng.unit(), radius: 0.01 }).collect();
    let params = GatherParams::default();
    type Report<'a> = &'a (dyn Fn(f32) -> ControlFlow<()> + Sync);
    type Build<'a> = Box<dyn Fn(Report<'_>) -> Result<usize, GatherError> + Sync + 'a>;
    let mut builds: Vec<Build<'_>> = Vec::new();
    for photons in &kinds {
        builds.push(Box::new(|hear| PhotonMap::build_with_progress(photons, &params, hear).map(|map| map.len())));
    }
    builds.push(Box::new(|hear| VisiblePoints::build_with_progress(&seen, &params, hear).map(|points| points.len())));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for (number, build) in builds.iter().enumerate() {
        let told = |most: usize| {
            let told = Mutex::new(Vec::new());
            let hear = |done: f32| {
                let mut told = told.lock().unwrap();
                told.push(done);
                if told.len() == most { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let built = pool.install(|| build(&hear));
            (built, told.into_inner().unwrap())
        };
        let (whole, all) = told(usize::MAX);
        assert_eq!((whole, all.last()), (Ok(COUNT), Some(&1.0)), "build {number}");
        let gaps = [0.0].iter().chain(&all).zip(&all).map(|(before, done)| done - before);
        assert!(gaps.clone().all(|gap| gap > 0.0 && gap <= LARGEST_GAP), "build {number}: {all:?}");
        for last in [1, all.len() / 3, all.len() - 1, all.len()] {
            let (none, until) = told(last);
            assert_eq!(
                (none, &until[..]),
                (Err(GatherError::Cancelled), &all[..last]),
                "build {number}, at report {last}"
            );
        }
    }
    // Nothing is built as well.
    let hear = |_: f32| ControlFlow::Continue(());
    assert!(PhotonMap::<f32>::build_with_progress(&[], &params, &hear).unwrap().is_empty());
    assert!(VisiblePoints::build_with_progress(&[], &params, &hear).unwrap().is_empty());
}
