//! Rays that begin far from small objects and near something large: they are traversed in pieces.

use super::common::{Random, all_hits, closed_sphere, difference, saved, soup};
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DVec3, Vec3};
use mbkd::{
    BuildParams, Counters, Hit, Instance, InstanceTree, MovingSphere, Pose, Ray, RayTree, Shape, TriangleMesh,
    WideParams,
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

/// Spheres and instances that are small and near zero, beside one so far away that it is 1e7 times as far as they are large.
#[test]
fn what_is_far_away_costs_rays_near_by_little() {
    const NEAR: usize = 3000;
    let place = |random: &mut Random, i: usize| {
        if i < NEAR { random.vec().as_dvec3() } else { DVec3::new(1e6, 3e5, 0.0) }
    };
    let triangle = vec![Vec3::ZERO, Vec3::X * 0.1, Vec3::Y * 0.1];
    let one =
        Arc::new(RayTree::build(&[TriangleMesh::fixed(vec![[0, 1, 2]], triangle)], &BuildParams::default()).unwrap());
    let of = |count: usize| {
        let mut random = Random(8);
        let balls: Vec<_> = (0..count).map(|i| MovingSphere::fixed(place(&mut random, i), 0.03)).collect();
        let oracle = BruteForce::of_scene(&[], balls.clone()).unwrap();
        let at = |i: usize| Pose { translation: place(&mut random, i), ..Pose::IDENTITY };
        let instances = (0..count).map(at).map(|pose| Instance::new(one.clone(), pose)).collect();
        let balls = RayTree::of_scene(&[], balls, &BuildParams::default()).unwrap();
        (balls, oracle, InstanceTree::build(instances, &WideParams::default()).unwrap())
    };
    let (alone, beside) = (of(NEAR), of(NEAR + 1));
    let (mut random, mut hits) = (Random(9), 0);
    let mut counters = [Counters::default(); 4];
    let [balls, balls_beside, instances, instances_beside] = &mut counters;
    for _ in 0..2000 {
        let ray = Ray::new(random.vec(), random.vec());
        let expected = alone.0.closest_hit_observed(&ray, balls);
        assert_eq!(beside.0.closest_hit_observed(&ray, balls_beside), expected);
        assert_eq!(difference(&beside.0, &beside.1, &ray), None);
        let placed = alone.2.closest_hit_observed(&ray, instances);
        assert_eq!(beside.2.closest_hit_observed(&ray, instances_beside), placed);
        hits += usize::from(expected.is_some()) + usize::from(placed.is_some());
        // Across the whole scene, close past what is far away.
        let ray = Ray::new(random.vec(), Vec3::new(1.0, 0.3, 0.0) + random.vec() * 1e-8);
        assert_eq!(difference(&beside.0, &beside.1, &ray), None);
    }
    assert!(hits > 500, "{hits}");
    let work = counters.map(|of| of.nodes + of.leaves);
    assert!(work[1] <= work[0] / 2 * 3 && work[3] <= work[2] / 2 * 3, "{work:?}");
}
