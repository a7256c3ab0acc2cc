//! Meshes, spheres and custom primitives in one tree equal brute force over the same kernels.

use crate::brute_force::Brick;
use crate::common::{Random, difference, divided, random_ray, soup, variants};
use core::sync::atomic::{AtomicUsize, Ordering};
use mbkd::baseline::BruteForce;
use mbkd::glam::DVec3;
use mbkd::{
    BuildParams, ClosestPointQuery, Division, Intersection, LinearBounds, MovingSphere, Primitive, Ray, RayTree, Shape,
    SimdLevel, TimeInterval, TriangleMesh, Visitor,
};
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// Meshes that are static, move, and move with three keys, one of them active for a part of the shutter.
fn meshes() -> Vec<TriangleMesh> {
    let some_time = TimeInterval::new(0.2, 0.8).unwrap();
    vec![
        soup(150, 1, 0.2, 0.0, 1),
        soup(150, 2, 0.2, 0.4, 2),
        soup(100, 3, 0.2, 0.4, 3).with_active(some_time),
        soup(20, 2, 0.3, 0.1, 4).with_mask(0b10),
    ]
}

/// Spheres and bricks among the triangles, every fifth sphere for a part of the shutter.
fn shapes(count: usize) -> Vec<Shape> {
    let mut random = Random(9);
    let mut place = move || random.vec().as_dvec3();
    (0..count)
        .map(|i| {
            let (from, by) = (place(), place() * 0.3);
            if i % 10 == 3 {
                return Shape::custom(Brick::new(from, 0.3));
            }
            let sphere = MovingSphere::new(vec![(from, 0.1), (from + by, 0.05)]);
            let active = if i % 5 == 1 { TimeInterval::new(0.3, 0.6).unwrap() } else { TimeInterval::FULL };
            sphere.with_active(active).into()
        })
        .collect()
}

fn params() -> Vec<BuildParams> {
    let divided = [Division::SharedLeaves(3), Division::SeparateTrees(2)].map(divided);
    variants().into_iter().chain(divided).collect()
}

#[test]
fn rays_equal_brute_force_and_name_what_they_hit() {
    let meshes = meshes();
    // Few and many shapes, none, and shapes alone.
    for (meshes, count) in [(&meshes[..], 100), (&meshes[..], 1), (&meshes[..], 0), (&[][..], 60), (&meshes[2..3], 40)]
    {
        let oracle = BruteForce::of_scene(meshes, shapes(count)).unwrap();
        for params in params() {
            let mut tree = RayTree::of_scene(meshes, shapes(count), &params).unwrap();
            assert_eq!(tree.validate(), Ok(()), "{params:?}");
            let mut random = Random(7);
            let mut seen = BTreeSet::new();
            for level in SimdLevel::available() {
                tree = tree.with_simd(level);
                for _ in 0..300 {
                    let ray = random_ray(&mut random, 1.5);
                    assert_eq!(difference(&tree, &oracle, &ray), None, "{params:?}, {level}");
                    seen.extend(tree.closest_hit(&ray).map(|hit| hit.mesh));
                }
            }
            let kinds = meshes.iter().filter(|mesh| mesh.len() > 50).count() + usize::from(count > 30);
            assert!(seen.len() >= kinds, "{seen:?} of {} meshes and {count} shapes", meshes.len());
        }
    }
}

#[test]
fn nearest_points_equal_brute_force() {
    let meshes = meshes();
    let oracle = BruteForce::of_scene(&meshes, shapes(60)).unwrap();
    for params in params() {
        let tree = RayTree::of_scene(&meshes, shapes(60), &params).unwrap();
        let mut random = Random(8);
        let mut of_shapes = 0;
        for _ in 0..300 {
            let query = ClosestPointQuery::new(random.vec() * 1.5, random.unit());
            let found = tree.closest_point(&ClosestPointQuery::new(query.point, query.time));
            assert_eq!(found, oracle.closest_point(&query), "{params:?}");
            of_shapes += usize::from(found.is_some_and(|f| f.mesh == 4));
        }
        assert!((10..290).contains(&of_shapes), "{of_shapes}");
    }
}

/// Records all calls.
struct All(BTreeSet<(u32, u32)>);

impl Visitor<mbkd::TreePrimitive> for All {
    fn enter(&mut self, _: &mbkd::Aabb) -> Option<f32> {
        Some(0.0)
    }

    fn visit(&mut self, item: mbkd::TreePrimitive) -> ControlFlow<()> {
        self.0.insert((item.mesh, item.primitive));
        ControlFlow::Continue(())
    }
}

#[test]
fn visitors_meet_all_and_corners_are_those_of_meshes() {
    let meshes = meshes();
    for params in params() {
        let tree = RayTree::of_scene(&meshes, shapes(30), &params).unwrap();
        let alone = RayTree::build(&meshes, &params).unwrap();
        let mut all = All(BTreeSet::new());
        assert!(tree.traverse(0.5, &mut all).is_continue());
        let expected: usize = meshes.iter().map(TriangleMesh::len).sum();
        let of_shapes = all.0.iter().filter(|name| name.0 == 4).count();
        assert_eq!((all.0.len() - of_shapes, of_shapes), (expected, 30));
        for (mesh, triangle) in all.0.into_iter().filter(|name| name.0 < 4) {
            assert_eq!(tree.triangle(mesh, triangle, 0.3), alone.triangle(mesh, triangle, 0.3));
        }
        assert!(tree.triangle(4, 0, 0.5)[0].is_nan());
        assert_eq!(tree.shape_count(), 30);
    }
}

#[test]
fn bad_shapes_are_refused_beside_meshes_too() {
    let bad = vec![MovingSphere::fixed(DVec3::ZERO, 1.0), MovingSphere::fixed(DVec3::NAN, 1.0)];
    let error = RayTree::of_scene(&meshes(), bad, &BuildParams::default()).unwrap_err();
    assert_eq!(error, mbkd::BuildError::BadBounds { primitive: 1 });
}

/// A sphere of a type of its own, which the crate cannot know.
struct Own(MovingSphere);

impl Primitive for Own {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        self.0.bounds(over)
    }

    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        ASKED.fetch_add(1, Ordering::Relaxed);
        self.0.intersect(ray)
    }
}

/// How many rays were tested against such spheres.
static ASKED: AtomicUsize = AtomicUsize::new(0);

/// A custom primitive is tested by itself, which takes long: boxes exclude nearly all of them.
#[test]
fn rays_are_tested_against_few_primitives_of_the_callers() {
    let mut random = Random(21);
    let ball = |random: &mut Random| {
        let (center, by) = (random.vec().as_dvec3(), random.vec().as_dvec3() * 0.05);
        MovingSphere::new(vec![(center, 0.03), (center + by, 0.03)])
    };
    let balls: Vec<MovingSphere> = (0..5000).map(|_| ball(&mut random)).collect();
    let shapes = || balls.iter().cloned().map(Own).map(Shape::custom).collect();
    let few = soup(100, 2, 0.1, 0.1, 5);
    for meshes in [vec![], vec![few], vec![soup(6000, 2, 0.01, 0.01, 6)]] {
        let tree = RayTree::of_scene(&meshes, shapes(), &BuildParams::default()).unwrap();
        let brute = BruteForce::of_scene(&meshes, shapes()).unwrap();
        let rays: Vec<Ray> = (0..500).map(|_| random_ray(&mut random, 1.0)).collect();
        let expected: Vec<_> = rays.iter().map(|ray| brute.closest_hit(ray)).collect();
        ASKED.store(0, Ordering::Relaxed);
        assert!(rays.iter().zip(expected).all(|(ray, expected)| tree.closest_hit(ray) == expected));
        let asked = ASKED.load(Ordering::Relaxed) / 500;
        assert!((1..16).contains(&asked), "{asked} tests per ray");
    }
}
