//! The same builds, refits, lists and batches on one, two and five threads, to the last bit; queries of many threads on one tree
//! while it is built; and builds that are cancelled and begun again.

use crate::clouds::{Cloud, params as point_params};
use crate::compare::Outcome;
use crate::gather;
use crate::random::Random;
use crate::rays::{Answers, Queries};
use crate::scenes::{self, Scene, is_documented};
use crate::steps;
use core::ops::ControlFlow;
use core::sync::atomic::{AtomicUsize, Ordering};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, Vec3};
use mbkd::point::{
    GatherError, GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap, VisiblePoint, VisiblePoints,
};
use mbkd::{
    BuildError, BuildParams, EncounterLists, Instance, InstanceError, InstanceTree, LazyParams, NeighborLists,
    PointError, PointParams, PointTree, Precision, RayTree, WideParams,
};
use rayon::ThreadPool;
use std::sync::{Arc, LazyLock};

/// Pools of one, two and five threads.
static POOLS: LazyLock<[ThreadPool; 3]> = LazyLock::new(|| {
    [1, 2, 5].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads"))
});

/// What a function returns in each of the pools.
fn in_pools<T: Send>(of: impl Fn() -> T + Sync) -> [T; 3] {
    [0, 1, 2].map(|pool| POOLS[pool].install(&of))
}

/// An error unless a function returns the same in each of the pools.
fn alike<T: PartialEq + Send>(what: &str, of: impl Fn() -> T + Sync) -> Result<T, String> {
    let [one, two, five] = in_pools(of);
    ensure!(one == two, "{what}: two threads differ from one");
    ensure!(one == five, "{what}: five threads differ from one");
    Ok(one)
}

pub fn case(random: &mut Random) -> Outcome {
    match random.below(6) {
        0 => rays(random),
        1 => points(random),
        2 => lazy(random),
        3 => photons(random),
        4 => cancelled_rays(random),
        _ => cancelled_points(random),
    }
}

fn written(tree: &RayTree) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).is_ok().then_some(bytes)
}

/// Trees of rays and their refits.
fn rays(random: &mut Random) -> Outcome {
    let scene = Scene::random(random, 20_000, 6);
    let params = scenes::params(random);
    let what = format!("{} primitives, {params:?}", scene.len());
    let frames: Vec<(Scene, Vec<usize>)> = (0..2).map(|_| scene.moved(random)).collect();
    let told = random.one_in(2);
    alike(&what, || {
        let mut tree = match RayTree::of_scene(&scene.meshes, scene.shapes(), &params) {
            Ok(tree) => tree,
            Err(error) => return (Some(error), Vec::new()),
        };
        let mut all = vec![(written(&tree), None, tree.bounds())];
        for (next, differ) in &frames {
            // Each frame differs from the one before in what either moved.
            let moved: Vec<usize> = frames.iter().flat_map(|(_, differ)| differ).copied().collect();
            let refit = if told { tree.refit_moved(&next.meshes, &moved) } else { tree.refit(&next.meshes) };
            let _ = differ;
            all.push((written(&tree), Some(refit.map_err(|error| error.to_string())), tree.bounds()));
        }
        (None, all)
    })
    .map(|_| ())
}

/// Trees of points, and lists and batches of them.
fn points(random: &mut Random) -> Outcome {
    let double = random.one_in(3);
    let cloud = Cloud::random(random, 20_000, double);
    let params = point_params(random);
    let precision = if double { Precision::Double } else { Precision::Automatic };
    let params = PointParams { precision, ..params };
    let what = format!("{} points, {params:?}", cloud.len());
    let (time, interval, radius) = (random.time(), random.interval(), cloud.places.scale as f32 * 0.02);
    let queries: Vec<_> = (0..600).map(|_| (cloud.query(random, time), time)).collect();
    let around: Vec<_> = queries.iter().map(|(q, _)| *q).collect();
    let scale = cloud.places.scale as f32;
    alike(&what, || {
        let Ok(mut tree) = cloud.tree(&params) else { return Vec::new() };
        let mut all = vec![steps::bytes(&tree)];
        let mut keep = |of: String| all.push(of.into_bytes());
        keep(format!("{:?}", tree.statistics()));
        keep(format!("{:?}", tree.nearest_n_batch(&queries, 5).iter().collect::<Vec<_>>()));
        keep(format!("{:?}", tree.within_batch(&queries, radius).iter().collect::<Vec<_>>()));
        let (mut lists, mut swept) = (NeighborLists::new(), EncounterLists::new());
        let result = tree.neighbor_lists(time, radius).with_distances().max_neighbors(2000).run(&mut lists);
        keep(format!("{result:?} {:?} {:?} {:?}", lists.points(), lists.ids(), lists.distances_squared()));
        let result = tree.neighbor_lists(time, radius).periodic([Some(scale), None, None]).max_neighbors(2000);
        let result = result.run(&mut lists);
        keep(format!("{result:?} {:?} {:?}", lists.points(), lists.ids()));
        let result = tree.within_lists(&around, time, radius).max_neighbors(2000).run(&mut lists);
        keep(format!("{result:?} {:?} {:?}", lists.points(), lists.ids()));
        if cloud.len() * cloud.segments() < 20_000 {
            let result = tree.neighbor_lists_swept(interval, radius).max_neighbors(500).run(&mut swept);
            keep(format!("{result:?} {:?} {:?}", swept.points(), swept.encounters()));
            if result.is_ok() {
                keep(format!("{:?}", tree.neighbor_lists(time, 2.0 * radius).certified_until(radius, 1.0)));
            }
        }
        keep(format!("{:?}", tree.take_order()));
        all
    })
    .map(|_| ())
}

/// Photons: batches of gathers, and sums that are scattered over points.
fn photons(random: &mut Random) -> Outcome {
    let cloud = Cloud::random(random, 4000, false);
    let clock = random.below(4);
    let photons = gather::photons(random, &cloud, clock);
    let window = random.pick(&[0.3, 0.05, 2.0]);
    let params = GatherParams { window, ..GatherParams::default() };
    let what = format!("{} photons, clock {clock}, {params:?}", photons.len());
    let cases: Vec<_> = (0..300).map(|_| gather::any_case(random, &photons, window)).collect();
    let queries: Vec<_> = cases.iter().map(|case| case.query()).collect();
    let scale = cloud.places.scale as f32;
    let point = |p: &Photon<f32>| (p.position, random.time(), scale * random.unit() * 0.3);
    let seen: Vec<_> = photons.iter().map(point).collect();
    let radii: Vec<f32> = seen.iter().map(|_| scale * random.unit() * 0.1).collect();
    let arrivals: Vec<_> = (0..500)
        .map(|_| {
            let i = random.below(seen.len());
            let at = seen.get(i).map_or(Vec3::ZERO, |of| of.0);
            (at + random.vec().as_vec3() * scale * 0.1, random.time())
        })
        .collect();
    alike(&what, || {
        let map = PhotonMap::build(&photons, &params).map_err(|error| error.to_string())?;
        // One that fails must not hide what the others answer.
        let all: Vec<_> = queries.iter().map(|query| map.gather(query, &mut NeighborBuffer::new())).collect();
        let good: Vec<_> = queries.iter().zip(&all).filter(|(_, of)| of.is_ok()).map(|(query, _)| *query).collect();
        let batch = map.gather_batch(&good).map_err(|error| error.to_string())?;
        let single: Vec<_> = all.iter().flatten().collect();
        ensure!(format!("{batch:?}") == format!("{single:?}"), "{what}: a batch differs");
        let points = seen.iter().map(|&(position, time, radius)| VisiblePoint { position, time, radius });
        let points = VisiblePoints::build(&points.collect::<Vec<_>>(), &params);
        let mut points = points.map_err(|error| error.to_string())?;
        let mut sums = vec![0f32; points.len()];
        for _ in 0..2 {
            let add =
                |sum: &mut f32, at: &(Vec3, f32), square: f32| *sum = *sum * 1.000_1 + at.1 + square / (scale * scale);
            points.scatter(&arrivals, |at| *at, window, &mut sums, add).map_err(|error| error.to_string())?;
            points.set_radii(&radii).map_err(|error| error.to_string())?;
        }
        Ok::<_, String>((format!("{all:?}"), sums.iter().map(|sum| sum.to_bits()).collect::<Vec<_>>()))
    })?
    .map(|_| ())
}

/// Many threads ask one tree of which nothing is built yet, and take clones of it meanwhile.
fn lazy(random: &mut Random) -> Outcome {
    let scene = Scene::random(random, 4000, 6);
    let params =
        BuildParams::lazy(LazyParams { wide: scenes::wide(random), subtree: random.pick(&[1, 5, 16, 64, 300, 2048]) });
    let tree = match RayTree::of_scene(&scene.meshes, scene.shapes(), &params) {
        Err(error) if is_documented(&error) => return Ok(()),
        tree => tree.map_err(|error| format!("{params:?}: {error}"))?,
    };
    let oracle = BruteForce::of_scene(&scene.meshes, scene.shapes()).map_err(|error| error.to_string())?;
    let seeds: Vec<u64> = (0..4).map(|_| random.bits()).collect();
    let work: Vec<(Queries, Answers)> = seeds
        .iter()
        .map(|&seed| {
            let queries = Queries::new(&mut Random::new(seed), &scene, &oracle, 12);
            let answers = Answers::of_brute_force(&oracle, &queries);
            (queries, answers)
        })
        .collect();
    let what = format!("{} primitives, {params:?}, many threads", scene.len());
    let answer = |of: usize| -> Outcome {
        let (queries, answers) = &work[of];
        if of == 0 {
            let clone = tree.clone();
            answers.check(&clone, queries, &format!("{what}, a clone"))?;
        }
        answers.check(&tree, queries, &what)?;
        same!(tree.validate(), Ok(()), "{what}");
        let of_tree = tree.statistics();
        ensure!(of_tree.built_subtrees <= of_tree.subtrees, "{what}: {of_tree:?}");
        Ok(())
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..work.len()).map(|of| scope.spawn(move || answer(of))).collect();
        threads.into_iter().try_for_each(|thread| thread.join().map_err(|_| format!("{what}: a thread panicked"))?)
    })
}

/// A callback that breaks at its n-th call.
fn breaks_at(n: usize, calls: &AtomicUsize) -> impl Fn(f32) -> ControlFlow<()> + Sync + '_ {
    move |_| match calls.fetch_add(1, Ordering::Relaxed) + 1 >= n {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}

/// Builds of rays and instances that are cancelled at any report.
fn cancelled_rays(random: &mut Random) -> Outcome {
    let scene = Scene::random(random, 4000, 6);
    let params = scenes::params(random);
    let what = format!("{} primitives, {params:?}", scene.len());
    let build = |n: usize, calls: &AtomicUsize| {
        RayTree::of_scene_with_progress(&scene.meshes, scene.shapes(), &params, &breaks_at(n, calls))
    };
    let all = AtomicUsize::new(0);
    let whole = match build(usize::MAX, &all) {
        Err(error) if is_documented(&error) => return Ok(()),
        tree => tree.map_err(|error| format!("{what}: {error}"))?,
    };
    let all = all.into_inner();
    for _ in 0..3 {
        let (n, calls) = (1 + random.below(all), AtomicUsize::new(0));
        match build(n, &calls) {
            Err(error) => same!(error, BuildError::Cancelled, "{what}: at {n} of {all}"),
            // Threads do not report alike.
            Ok(tree) => {
                ensure!(calls.load(Ordering::Relaxed) < n, "{what}: {n} of {all} did not cancel");
                ensure!(written(&tree) == written(&whole), "{what}: another tree");
            }
        }
    }
    let again = build(usize::MAX, &AtomicUsize::new(0)).map_err(|error| format!("{what}: again: {error}"))?;
    ensure!(written(&again) == written(&whole), "{what}: another tree after builds that were cancelled");
    let placed = Arc::new(again);
    let instances: Vec<Instance> = (0..random.count(400))
        .map(|_| Instance::new(placed.clone(), DAffine3::from_translation(random.vec() * scene.places.scale * 9.0)))
        .collect();
    let calls = AtomicUsize::new(0);
    let n = 1 + random.below(5);
    match InstanceTree::build_with_progress(instances, &WideParams::default(), &breaks_at(n, &calls)) {
        Err(InstanceError::Build(error)) => {
            ensure!(error == BuildError::Cancelled || is_documented(&error), "{what}: instances: {error}");
        }
        Err(error) => return Err(format!("{what}: instances: {error}")),
        Ok(_) => ensure!(calls.load(Ordering::Relaxed) < n, "{what}: instances were not cancelled at {n}"),
    }
    Ok(())
}

/// Builds of points and photons that are cancelled at any report.
fn cancelled_points(random: &mut Random) -> Outcome {
    let double = random.one_in(3);
    let cloud = Cloud::random(random, 20_000, double);
    let params = point_params(random);
    let what = format!("{} points, {params:?}", cloud.len());
    let build = |n: usize, calls: &AtomicUsize| {
        cloud.with_set(|single, double| match (single, double) {
            (Some(set), _) => PointTree::build_with_progress(&set, &params, &breaks_at(n, calls)),
            (_, Some(set)) => PointTree::build_with_progress(&set, &params, &breaks_at(n, calls)),
            _ => PointTree::build::<[Vec3]>(&[], &params),
        })
    };
    let all = AtomicUsize::new(0);
    let Ok(whole) = build(usize::MAX, &all) else { return Ok(()) };
    let (all, whole) = (all.into_inner(), steps::bytes(&whole));
    for _ in 0..4 {
        let (n, calls) = (1 + random.below(all), AtomicUsize::new(0));
        match build(n, &calls) {
            Err(error) => same!(error, PointError::Cancelled, "{what}: at {n} of {all}"),
            Ok(tree) => {
                ensure!(calls.load(Ordering::Relaxed) < n, "{what}: {n} of {all} did not cancel");
                ensure!(steps::bytes(&tree) == whole, "{what}: another tree");
            }
        }
    }
    let photon = |i: usize| Photon::at_time(cloud.at(i, 0.0).as_vec3(), Vec3::Z, 1.0f32, random.time());
    let photons: Vec<Photon<f32>> = (0..cloud.len()).map(photon).collect();
    let gather = GatherParams { window: 0.1, ..GatherParams::default() };
    let (n, calls) = (1 + random.below(6), AtomicUsize::new(0));
    match PhotonMap::build_with_progress(&photons, &gather, &breaks_at(n, &calls)) {
        Err(error) => same!(error, GatherError::Cancelled, "{what}: photons"),
        Ok(map) => {
            ensure!(calls.load(Ordering::Relaxed) < n, "{what}: photons were not cancelled at {n}");
            let query = GatherQuery::new(Vec3::ZERO, Vec3::Z, 0.5).nearest(3);
            match map.gather(&query, &mut NeighborBuffer::new()) {
                Ok(found) => ensure!(found.count <= 3, "{what}: photons: {found:?}"),
                Err(error) => same!(error, GatherError::NoArea, "{what}: photons"),
            }
        }
    }
    Ok(())
}
