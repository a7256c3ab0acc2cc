//! Rays that begin far from small objects and near something large: they are traversed in pieces.

use super::common::{Random, all_hits, closed_sphere, difference, saved, soup};
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DVec3, Vec3};
use mbkd::{
    BuildParams, Counters, Hit, Instance, InstanceTree, MovingSphere, Ray, RayTree, Shape, TriangleMesh, WideParams,
};
use std::sync::Arc;

/// A small object at zero, another one beside it, and a plain that reaches a billion times as far.
fn meshes(keys: usize, wobble: f32) -> Vec<TriangleMesh> {
    let far = |x: f32, y: f32| Vec3::new(x, y, -3.0);
    let plain = vec![far(-1e9, -1e9), far(1e9, -1e9), far(0.0, 1e9)];
    let mut dust = soup(300, keys, 0.02, wobble, 5);
    dust.indices.extend([[0, 1, 2]; 3]);
    vec![closed_sphere(40, keys, wobble, 3), TriangleMesh::fixed(vec![[0, 1, 2]], plain), dust]
}

fn shapes() -> Vec<Shape> {
    let ball = |x: f64| MovingSphere::new(vec![(DVec3::new(x, 1.5, 0.0), 0.1), (DVec3::new(x, 1.6, 0.0), 0.1)]).into();
    (0..40).map(|i| ball(f64::from(i - 20) * 0.1)).collect()
}

/// A ray at a place near zero, from above and so far away.
fn towards(random: &mut Random, away: f64) -> Ray {
    let dir = Vec3::new(random.vec().x, random.vec().y, -random.unit() - 0.1);
    let target = random.vec().as_dvec3() * if random.unit() < 0.5 { 0.9 } else { 2.0 };
    let time = random.unit();
    Ray::new(target - dir.as_dvec3() * away, dir).at_time(time)
}

#[test]
fn rays_from_near_something_large_equal_brute_force_in_pieces() {
    for (keys, wobble) in [(1, 0.0), (2, 0.02), (4, 0.02)] {
        let meshes = meshes(keys, wobble);
        let tree = RayTree::of_scene(&meshes, shapes(), &BuildParams::default()).unwrap();
        let oracle = BruteForce::of_scene(&meshes, shapes()).unwrap();
        let (mut random, mut hits, mut rays) = (Random(6), 0, Vec::new());
        for i in 0..1500 {
            let away = 10f64.powf(f64::from(random.unit()) * 11.0);
            let ray = towards(&mut random, away);
            let step = [1.0, 1e-30, 1e30][i % 3];
            // Whole rays, parts, lines, rays back and rays beside it.
            let part = |a: f64, b: f64| ray.between((a * away) as f32, (b * away) as f32);
            let ray = match i / 3 % 8 {
                0 => part(0.5, 2.0),
                1 => part(0.999, 1.0),
                2 => part(0.0, 1.0),
                3 => ray.between(f32::NEG_INFINITY, f32::INFINITY),
                4 => Ray { dir: -ray.dir, ..ray },
                5 => Ray { origin: ray.origin + DVec3::X * away * 0.1, ..ray },
                _ => ray,
            };
            let scaled = |t: f32| if t == 0.0 { t } else { t / step };
            let ray = Ray { dir: ray.dir * step, t_min: scaled(ray.t_min), t_max: scaled(ray.t_max), ..ray };
            assert_eq!(difference(&tree, &oracle, &ray), None, "{i}");
            hits += all_hits(&tree, &ray).iter().filter(|hit| hit.mesh != 1).count();
            let odd = |hit: &Hit| hit.primitive % 2 == 1;
            assert_eq!(tree.closest_hit_filtered(&ray, !0, odd), oracle.closest_hit_filtered(&ray, !0, odd));
            rays.push(ray);
        }
        assert!(hits > 700, "{hits}");
        let (mut closest, mut any) = (Vec::new(), Vec::new());
        tree.closest_hits(&rays, &mut closest);
        tree.any_hits(&rays, &mut any);
        for (i, ray) in rays.iter().enumerate() {
            assert_eq!((closest[i], any[i]), (tree.closest_hit(ray), tree.any_hit(ray)), "{ray:?}");
        }
        // The same tree as an instance.
        let of = Arc::new(tree);
        let placed = DAffine3::from_translation(DVec3::new(10.0, -3.0, 1.0));
        let instances = InstanceTree::build(vec![Instance::new(of.clone(), placed)], &WideParams::default()).unwrap();
        for ray in &rays {
            // None if the direction is too short or too long for instances.
            let expected = instances.local_ray(0, ray).and_then(|local| of.closest_hit(&local));
            assert_eq!(instances.closest_hit(ray).map(|found| found.hit), expected, "{ray:?}");
        }
    }
}

/// Without pieces, each ray would test thousands of triangles from a million sizes away on.
#[test]
fn far_rays_near_something_large_test_as_few_triangles_as_near_ones() {
    for (keys, wobble) in [(1, 0.0), (2, 0.02)] {
        let mut tree = RayTree::build(&meshes(keys, wobble), &BuildParams::default()).unwrap();
        for loaded in [false, true] {
            if loaded {
                tree = RayTree::read_from(&mut &saved(&tree).unwrap()[..]).unwrap();
            }
            let work = |away: f64| {
                let (mut random, mut counts) = (Random(8), [Counters::default(); 2]);
                for _ in 0..200 {
                    let ray = towards(&mut random, away);
                    tree.closest_hit_observed(&ray, &mut counts[0]);
                    let _ = tree.all_hits_observed(&ray, &mut counts[1], |_| ControlFlow::Continue(()));
                }
                counts.map(|of| of.primitive_tests + of.nodes)
            };
            let near = work(10.0);
            for away in [1e5, 1e6, 1e7, 1e8] {
                let far = work(away);
                assert!(far[0] < 4 * near[0] && far[1] < 4 * near[1], "{away}: {far:?} instead of {near:?}");
            }
        }
    }
}
