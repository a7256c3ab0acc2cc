//! Bad input: scenes, transforms, points, parameters and queries out of range, and forged files, have typed errors or documented
//! answers, and nothing panics.

use crate::clouds::{self, Cloud};
use crate::compare::Outcome;
use crate::random::Random;
use crate::rays::{closest_point_query, ray};
use crate::scenes::{self, Scene};
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use mbkd::point::{GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap};
use mbkd::{
    BuildError, BuildParams, Division, EncounterLists, Instance, InstanceTree, Keys, NeighborLists, PointArrays,
    PointParams, PointStructure, PointTree, Policy, Pose, Radii, RayTree, TimeInterval, Transform, WideParams,
};
use std::sync::Arc;

/// How the tests of files forge them.
#[allow(dead_code, unused_imports)]
#[path = "../../../tests/files/support.rs"]
mod files;

/// Numbers that are wrong in most places.
const NUMBERS: [f32; 14] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    -1.0,
    -0.0,
    0.0,
    1e-45,
    1.000_000_1,
    3e18,
    2e30,
    f32::MAX,
    f32::MIN,
    1e-30,
    1e10,
];

pub fn case(random: &mut Random) -> Outcome {
    match random.below(6) {
        0 => bad_scene(random),
        1 => bad_parameters(random),
        2 => bad_instances(random),
        3 => bad_points(random),
        4 => forged_rays(random),
        _ => forged_points(random),
    }
}

/// Trees and brute force refuse the same scenes for the same reason.
fn bad_scene(random: &mut Random) -> Outcome {
    let mut scene = Scene::random(random, 100, 28);
    let number = random.pick(&NUMBERS);
    for _ in 0..1 + random.below(2) {
        let (i, j) = (random.below(scene.meshes.len()), random.below(scene.balls.len()));
        if random.one_in(3) {
            let Some((ball, _)) = scene.balls.get_mut(j) else { continue };
            match (random.below(3), ball.keys.first_mut()) {
                (1, Some(key)) => key.1 = number.into(),
                (2, Some(key)) => key.0.z = number.into(),
                _ => ball.keys.clear(),
            }
            continue;
        }
        let Some(mesh) = scene.meshes.get_mut(i) else { continue };
        match (random.below(4), &mut mesh.keys) {
            (0, _) => mesh.indices.push([random.bits() as u32, 0, u32::MAX]),
            (1, Keys::F32(keys)) => keys.clear(),
            (2, Keys::F32(keys)) => keys.iter_mut().take(1).for_each(|key| key.truncate(key.len() / 2)),
            (_, Keys::F32(keys)) => keys.iter_mut().flatten().take(1).for_each(|p| p.x = number),
            (1, Keys::F64(keys) | Keys::Precise(keys)) => keys.push(Vec::new()),
            (_, Keys::F64(keys) | Keys::Precise(keys)) => {
                keys.iter_mut().flatten().take(1).for_each(|p| p.x = number.into());
            }
        }
    }
    let params = scenes::params(random);
    let built = RayTree::of_scene(&scene.meshes, scene.shapes(), &params);
    let brute = BruteForce::of_scene(&scene.meshes, scene.shapes());
    let of_input = built.as_ref().err().filter(|error| !scenes::is_documented(error));
    // Trees may also look at a part of the shutter in which a shape does not exist.
    if !(matches!(of_input, Some(BuildError::BadBounds { .. })) && brute.is_ok()) {
        same!(of_input, brute.as_ref().err(), "{params:?}");
    }
    let (Ok(tree), Ok(brute)) = (built, brute) else { return Ok(()) };
    for _ in 0..10 {
        let (ray, query) = (ray(random, &scene), closest_point_query(random, &scene));
        same!(tree.closest_hit(&ray), brute.closest_hit(&ray), "{params:?}: {ray:?}");
        same!(tree.closest_point(&query), brute.closest_point(&query), "{params:?}: {query:?}");
    }
    Ok(())
}

fn bad_parameters(random: &mut Random) -> Outcome {
    let scene = Scene::random(random, 60, 6);
    let mut params = scenes::params(random);
    let (number, count) = (random.pick(&NUMBERS), random.pick(&[0, 1, 2, 16, 17, 65537, usize::MAX]));
    match &mut params.policy {
        Policy::Wide(wide) | Policy::Lazy(mbkd::LazyParams { wide, .. }) if random.one_in(2) => match random.below(3) {
            0 => wide.max_references = number,
            1 => wide.bytes_per_primitive = number,
            _ => wide.division = Division::SharedLeaves(count),
        },
        Policy::Wide(wide) => wide.division = Division::SeparateTrees(count),
        Policy::Lazy(lazy) => lazy.subtree = count,
        Policy::Kd(kd) => match random.below(5) {
            0 => kd.plane_time = number,
            1 => kd.traversal_cost = number,
            2 => kd.intersection_cost = number,
            3 => (kd.empty_factor, kd.max_depth) = (number, Some(count as u32)),
            _ => kd.max_references = number,
        },
        _ => {}
    }
    let built = RayTree::of_scene(&scene.meshes, scene.shapes(), &params);
    match (built, params.validate()) {
        (Err(error), Err(expected)) => same!(error, expected, "{params:?}"),
        (Err(error), Ok(())) => ensure!(scenes::is_documented(&error), "{params:?}: {error}"),
        (Ok(tree), valid) => {
            same!(valid, Ok(()), "{params:?}: a tree was built");
            for ray in (0..10).map(|_| ray(random, &scene)) {
                let brute = BruteForce::of_scene(&scene.meshes, scene.shapes()).map_err(|error| error.to_string())?;
                same!(tree.closest_hit(&ray), brute.closest_hit(&ray), "{params:?}: {ray:?}");
            }
        }
    }
    Ok(())
}

fn bad_instances(random: &mut Random) -> Outcome {
    let scene = Scene::random(random, 30, 6);
    let tree = RayTree::of_scene(&scene.meshes, scene.shapes(), &BuildParams::default());
    let tree = Arc::new(tree.map_err(|error| error.to_string())?);
    let mut number = || f64::from(random.pick(&NUMBERS)) * if random.one_in(4) { 1e300 } else { 1.0 };
    let mut vec = || DVec3::new(number(), 1.0, number());
    let matrix = DAffine3 { matrix3: DMat3::from_cols(vec(), vec(), vec()), translation: vec() };
    let pose = Pose { scale: vec(), rotation: DQuat::from_vec4(vec().extend(1.0)), translation: vec() };
    let transform: Transform = match random.below(5) {
        0 => matrix.into(),
        1 => vec![DAffine3::IDENTITY, matrix].into(),
        2 => pose.into(),
        3 => vec![Pose { rotation: DQuat::IDENTITY, ..pose }, Pose::IDENTITY].into(),
        _ => vec![Pose { scale: DVec3::ONE, ..pose }; random.below(3)].into(),
    };
    let what = format!("{transform:?}");
    let Ok(placed) = InstanceTree::build(vec![Instance::new(tree, transform)], &WideParams::default()) else {
        return Ok(());
    };
    same!(placed.validate(), Ok(()), "{what}");
    for _ in 0..10 {
        let ray = ray(random, &scene);
        let local = placed.local_ray(0, &ray);
        let expected = local.and_then(|ray| placed.tree(&[0]).and_then(|tree| tree.closest_hit(&ray)));
        same!(placed.closest_hit(&ray).map(|hit| hit.hit), expected, "{what}: {ray:?}");
        let _ = placed.closest_point(&closest_point_query(random, &scene));
    }
    Ok(())
}

fn bad_points(random: &mut Random) -> Outcome {
    let cloud = Cloud::random(random, 60, false);
    let mut keys: Vec<Vec<Vec3>> = cloud.keys.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect();
    let (mut active, mut ids, mut params) = (cloud.active.clone(), cloud.ids.clone(), clouds::params(random));
    let number = random.pick(&NUMBERS);
    match random.below(7) {
        0 => keys.iter_mut().flatten().take(1).for_each(|p| p.y = number),
        1 => keys.iter_mut().skip(1).for_each(|key| key.truncate(key.len() / 2)),
        2 => active.truncate(cloud.len() / 2),
        3 => ids.iter_mut().take(1).for_each(|id| *id = u32::MAX),
        4 => params.max_references = number,
        5 => params.structure = PointStructure::TimeSlices(random.pick(&[0, 1025, usize::MAX])),
        _ => keys.clear(),
    }
    let slices: Vec<&[Vec3]> = keys.iter().map(Vec::as_slice).collect();
    let built = PointTree::build(&PointArrays { keys: &slices, active: &active, ids: &ids }, &params);
    if let Err(expected) = params.validate() {
        same!(built.as_ref().err(), Some(&expected), "{params:?}");
    }
    let tree = match built {
        Ok(tree) => tree,
        Err(_) => cloud.tree(&PointParams::default()).map_err(|error| error.to_string())?,
    };
    let place = |random: &mut Random| Vec3::new(random.pick(&NUMBERS), random.unit(), random.pick(&NUMBERS));
    for _ in 0..10 {
        let (q, r, time, radius) = (place(random), place(random), random.any_time(), random.pick(&NUMBERS));
        let exists = (0.0..=1.0).contains(&time) && q.is_finite() && q.abs().max_element() <= 1e18;
        let found = tree.nearest_n(q, time, 3);
        ensure!(exists || found.is_empty(), "{q} at {time}: {found:?}");
        let _ = (tree.within(q, time, radius), tree.closest_approach(q, r, random.interval()));
        let _ = tree.query(q, time).approximate(radius).nearest();
        let mut lists = NeighborLists::new();
        let few = vec![radius; random.below(tree.len() + 1)];
        let periods = [Some(radius), None, Some(number)];
        let _ = tree.neighbor_lists(time, radius).periodic(periods).in_order().run(&mut lists);
        let _ = tree.neighbor_lists(time, Radii::Own(&few)).run(&mut lists);
        let _ = tree.within_lists(&[q, r], time, Radii::Own(&few)).in_order().run(&mut lists);
        let _ = tree.neighbor_lists_with_skin(time, radius, number, random.any_time(), &mut lists);
        let _ = tree.neighbor_lists_swept(random.interval(), radius).run(&mut EncounterLists::new());
        let photons = [Photon::at_time(q, r, radius, time), Photon::at_time(Vec3::ONE, Vec3::Z, 1.0, 0.5)];
        if let Ok(map) = PhotonMap::build(&photons, &GatherParams { window: number, ..GatherParams::default() }) {
            let query =
                GatherQuery::new(r, q, time).radius(radius).window(number).cosine(radius).nearest(random.below(3));
            let _ = map.gather(&query, &mut NeighborBuffer::new());
        }
    }
    Ok(())
}

/// Forged files are refused, or all queries end.
fn forged_rays(random: &mut Random) -> Outcome {
    let scene = Scene::random(random, 300, 6);
    let tree = match RayTree::of_scene(&scene.meshes, scene.shapes(), &scenes::params(random)) {
        Err(BuildError::OverBudget { .. } | BuildError::TooManyReferences) => return Ok(()),
        tree => tree.map_err(|error| error.to_string())?,
    };
    let mut bytes = Vec::new();
    if tree.write_to(&mut bytes).is_err() {
        return Ok(());
    }
    for _ in 0..20 {
        let forged = files::mutate(&bytes, &mut files::Random(random.bits()));
        let Ok(tree) = RayTree::read_from(&mut forged.as_slice()) else { continue };
        for _ in 0..4 {
            let ray = ray(random, &scene);
            let _ = (tree.closest_hit(&ray), tree.any_hit_masked(&ray, 1), tree.statistics(), tree.triangle(0, 3, 0.7));
            let _ = tree.all_hits(&ray, |_| ControlFlow::Continue(()));
            let _ = tree.closest_point(&closest_point_query(random, &scene));
        }
    }
    Ok(())
}

fn forged_points(random: &mut Random) -> Outcome {
    let double = random.one_in(3);
    let cloud = Cloud::random(random, 300, double);
    let Ok(tree) = cloud.tree(&clouds::params(random)) else { return Ok(()) };
    let mut bytes = Vec::new();
    tree.write_to(&mut bytes).map_err(|error| error.to_string())?;
    for _ in 0..20 {
        let forged = files::mutate(&bytes, &mut files::Random(random.bits()));
        let Ok(tree) = PointTree::read_from(&mut forged.as_slice()) else { continue };
        let time = random.time();
        let (q, radius) = (cloud.query(random, time), (cloud.places.scale * 0.1) as f32);
        let _ = (tree.nearest_n(q, time, 20), tree.within(q, time, radius));
        let _ = tree.closest_approach(q, q * 0.5, TimeInterval::FULL);
        let _ = tree.neighbor_lists(time, radius).run(&mut NeighborLists::new());
        let _ = tree.neighbor_lists_swept(TimeInterval::FULL, radius).collect();
    }
    Ok(())
}
