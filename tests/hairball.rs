//! The hairball at its full 2.5 million triangles against brute force, on 1000 rays.

mod common;

use common::{Random, bits};
use mbkd::baseline::BruteForce;
use mbkd::{BuildParams, Policy, Ray, RayTree, scene};
use std::thread;

#[test]
fn full_size_equals_brute_force() {
    let recipe = scene::find("hairball").unwrap();
    let scene = (recipe.make)(recipe.full);
    assert!(scene.triangles() >= 2_400_000, "{}", scene.triangles());
    let mut random = Random(2);
    let rays: Vec<Ray> =
        (0..1000).map(|_| scene.camera.ray(random.unit(), random.unit(), 1.0, random.unit())).collect();
    let paper = BuildParams { max_references: 3.0, ..BuildParams::default().with_policy(Policy::Mbkd) };
    let trees = [paper, BuildParams::default()].map(|params| RayTree::build(&scene.meshes, &params).unwrap());
    let oracle = BruteForce::new(&scene.meshes).unwrap();
    drop(scene);
    let check = |rays: &[Ray]| {
        let mut hits = 0;
        for ray in rays {
            let expected = oracle.closest_hit(ray);
            for tree in &trees {
                let got = tree.closest_hit(ray);
                assert_eq!(got.map(bits), expected.map(bits), "{ray:?}: {got:?}, not {expected:?}");
                assert_eq!(tree.any_hit(ray), expected.is_some(), "{ray:?}");
            }
            hits += usize::from(expected.is_some());
        }
        hits
    };
    let (first, second) = rays.split_at(500);
    let hits = thread::scope(|scope| {
        let other = scope.spawn(|| check(second));
        check(first) + other.join().unwrap()
    });
    assert!(hits > 300, "{hits} of 1000 rays hit");
}
