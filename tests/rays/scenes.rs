//! Every policy on every scene, 75 000 rays each (the variants of a policy 7500), equal to brute force bit
//! for bit.

use crate::batches::assert_filtered;
use crate::common::{Random, all_hits, bits, variants};
use crate::scene;
use mbkd::baseline::BruteForce;
use mbkd::glam::Vec3;
use mbkd::{BuildParams, Hit, KdParams, MovingSphere, Ray, RayTree};
use std::thread;

const RAYS: usize = 75_000;
const PRIMITIVES: usize = 5_000;

/// Half of the rays come from the camera, half go between two places in the scene's box; every eighth looks at
/// the begin or end of the shutter.
fn rays(seed: u64, camera: &scene::Camera, low: Vec3, high: Vec3) -> Vec<Ray> {
    let mut random = Random(seed);
    (0..RAYS)
        .map(|i| {
            let time = match i % 16 {
                0 => 0.0,
                8 => 1.0,
                _ => random.unit(),
            };
            if i % 2 == 0 {
                return camera.ray(random.unit(), random.unit(), 1.0, time);
            }
            let mut place = || low + (high - low) * (random.vec() * 0.6 + 0.5);
            let (from, to) = (place(), place());
            Ray::new(from, to - from).at_time(time)
        })
        .collect()
}

/// Answers of brute force, on two threads.
fn answers(oracle: &BruteForce, rays: &[Ray]) -> Vec<Option<Hit>> {
    let half = rays.len() / 2;
    let answers_of = |rays: &[Ray]| rays.iter().map(|ray| oracle.closest_hit(ray)).collect::<Vec<_>>();
    thread::scope(|scope| {
        let second = scope.spawn(|| answers_of(&rays[half..]));
        let mut all = answers_of(&rays[..half]);
        all.extend(second.join().unwrap());
        all
    })
}

fn check(name: &str, rays: &[Ray], oracle: &BruteForce, build: impl Fn(&BuildParams) -> RayTree) {
    let expected = answers(oracle, rays);
    let hits = expected.iter().flatten().count();
    assert!(hits > rays.len() / 50, "only {hits} rays hit {name}");
    let some: Vec<(&Ray, Vec<Hit>)> = rays.iter().step_by(500).map(|ray| (ray, oracle.all_hits(ray))).collect();
    for (i, params) in variants().iter().enumerate() {
        let tree = build(params);
        assert!(tree.statistics().primitives >= PRIMITIVES, "{name} has {}", tree.statistics().primitives);
        // Each kind of tree once with all rays, the other variants of the paper's with some.
        let defaults =
            [BuildParams::default(), BuildParams::kd(KdParams::default()), BuildParams::kd(KdParams::classic())];
        let step = if defaults.contains(params) { 1 } else { 10 };
        for (ray, expected) in rays.iter().zip(&expected).skip(if step == 1 { 0 } else { i }).step_by(step) {
            let got = tree.closest_hit(ray);
            assert_eq!(got.map(bits), expected.map(bits), "{name} {params:?} {ray:?}: {got:?}, not {expected:?}");
            assert_eq!(tree.any_hit(ray), expected.is_some(), "{name} {params:?} {ray:?}");
        }
        let begin = 2000 * i;
        assert_filtered(&tree, &rays[begin..begin + 2000], [0b01, 0b10, 0b11][i % 3]);
        for (ray, expected) in &some {
            let got = all_hits(&tree, ray);
            assert!(got.iter().copied().map(bits).eq(expected.iter().copied().map(bits)), "{name} {params:?} {ray:?}");
        }
    }
}

fn check_scene(name: &str) {
    let recipe = scene::find(name).unwrap();
    let mut scene =
        (5..).map(|thousands| (recipe.make)(1000 * thousands)).find(|s| s.triangles() >= PRIMITIVES).unwrap();
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (i, mesh) in scene.meshes.iter_mut().enumerate() {
        mesh.mask = 1 << (i % 2);
        match &mesh.keys {
            mbkd::Keys::F32(keys) => {
                for p in keys.iter().flatten() {
                    (low, high) = (low.min(*p), high.max(*p));
                }
            }
            mbkd::Keys::F64(keys) | mbkd::Keys::Precise(keys) => {
                for p in keys.iter().flatten().map(|p| p.as_vec3()) {
                    (low, high) = (low.min(p), high.max(p));
                }
            }
        }
    }
    let rays = rays(name.len() as u64, &scene.camera, low, high);
    let oracle = BruteForce::new(&scene.meshes).unwrap();
    check(name, &rays, &oracle, |params| RayTree::build(&scene.meshes, params).unwrap());
}

#[test]
fn hairball() {
    check_scene("hairball");
}

#[test]
fn tornado() {
    check_scene("tornado");
}

#[test]
fn hall() {
    check_scene("hall");
}

#[test]
fn camera() {
    check_scene("camera");
}

#[test]
fn hand() {
    check_scene("hand");
}

#[test]
fn coherent() {
    check_scene("coherent");
}

#[test]
fn needles() {
    check_scene("needles");
}

#[test]
fn needles30() {
    check_scene("needles30");
}

#[test]
fn debris() {
    check_scene("debris");
}

#[test]
fn mixed() {
    check_scene("mixed");
}

#[test]
fn building() {
    check_scene("building");
}

#[test]
fn visited() {
    check_scene("visited");
}

#[test]
fn distant() {
    check_scene("distant");
}

#[test]
fn crowd() {
    check_scene("crowd");
}

#[test]
fn flake() {
    let (spheres, camera) = scene::flake(PRIMITIVES);
    let spheres: Vec<MovingSphere> = spheres
        .iter()
        .map(|s| MovingSphere::new(s.centers.iter().map(|c| (c.as_dvec3(), f64::from(s.radius))).collect()))
        .collect();
    let rays = rays(6, &camera, Vec3::splat(-1.6), Vec3::splat(1.6));
    let oracle = BruteForce::of_scene(&[], spheres.clone()).unwrap();
    check("flake", &rays, &oracle, |params| RayTree::of_scene(&[], spheres.clone(), params).unwrap());
}

#[test]
fn every_scene_of_the_catalogue_is_tested() {
    let here = [
        "hairball",
        "tornado",
        "hall",
        "camera",
        "hand",
        "coherent",
        "needles",
        "needles30",
        "debris",
        "mixed",
        "building",
        "visited",
        "distant",
        "crowd",
    ];
    let names: Vec<&str> = scene::CATALOGUE.iter().map(|recipe| recipe.name).collect();
    assert_eq!(names, here);
}
