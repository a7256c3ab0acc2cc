//! The hairball at its full 2.5 million triangles against brute force, on 1000 rays.

use crate::common::{Random, bits};
use crate::scene;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, KdParams, Ray, RayTree};
use std::thread;

#[test]
fn full_size_equals_brute_force() {
    let recipe = scene::find("hairball").unwrap();
    let scene = (recipe.make)(recipe.full);
    assert!(scene.triangles() >= 2_400_000, "{}", scene.triangles());
    let mut random = Random(2);
    let rays: Vec<Ray> =
        (0..1000).map(|_| scene.camera.ray(random.unit(), random.unit(), 1.0, random.unit())).collect();
    let paper = BuildParams::kd(KdParams { max_references: 3.0, ..KdParams::default() });
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

    // Batches on a tree of this size sort scattered rays, and interleave some of them.
    let wide = &trees[1];
    assert!(wide.statistics().bytes > 64 << 20, "{}", wide.statistics().bytes);
    let scattered: Vec<Ray> = (0..5000)
        .map(|i| {
            let mut point = || Vec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
            let ray = Ray::new(point(), point()).at_time(random.unit());
            if i % 100 == 7 { Ray { origin: DVec3::NAN, ..ray } } else { ray }
        })
        .collect();
    let (mut closest, mut any) = (Vec::new(), Vec::new());
    wide.closest_hits(&scattered, &mut closest);
    wide.any_hits(&scattered, &mut any);
    for (ray, (hit, shadow)) in scattered.iter().zip(closest.iter().zip(&any)) {
        assert_eq!(hit.map(bits), wide.closest_hit(ray).map(bits), "{ray:?}");
        assert_eq!(*shadow, hit.is_some(), "{ray:?}");
    }
    let hits = closest.iter().flatten().count();
    assert!((500..4900).contains(&hits), "{hits} of 5000 rays hit");
}
