//! Masks of spheres and custom primitives, alone and beside meshes.

use crate::common::{Blob, Random, divided, random_ray, soup, variants};
use mbkd::baseline::BruteForce;
use mbkd::glam::DVec3;
use mbkd::{
    BuildParams, ClosestPointQuery, Division, LazyParams, MovingSphere, Policy, Ray, RayTree, Shape, TriangleMesh,
};
use std::ops::ControlFlow;

/// The masks that queries have: nothing, one and several bits, all.
const MASKS: [u32; 5] = [0, 0b1, 0b110, 0b1000, u32::MAX];

fn meshes() -> Vec<TriangleMesh> {
    (0..3).map(|i| soup(60, 1 + i, 0.3, 0.2 * i as f32, i as u64).with_mask(1 << i)).collect()
}

/// Spheres, spheres within other primitives, and custom primitives, with `masks` in turn.
fn shapes(count: usize, masks: &[u32]) -> Vec<Shape> {
    let mut random = Random(31);
    let shape = |i: usize| {
        let (from, by, mask) = (random.vec().as_dvec3(), random.vec().as_dvec3() * 0.3, masks[i % masks.len()]);
        let sphere = MovingSphere::new(vec![(from, 0.15), (from + by, 0.1)]);
        match i % 5 {
            0 => Shape::custom(Blob { mask, ..Blob::named(sphere.with_mask(!mask)) }),
            1 => Shape::custom(Blob::hidden(sphere.with_mask(mask))),
            _ => sphere.with_mask(mask).into(),
        }
    };
    (0..count).map(shape).collect()
}

fn params() -> Vec<BuildParams> {
    let divided = [Division::SharedLeaves(3), Division::SeparateTrees(2)].map(divided);
    let lazy = BuildParams { policy: Policy::Lazy(LazyParams::default()) };
    variants().into_iter().chain(divided).chain([lazy]).collect()
}

/// Every form of a query with a mask equals brute force, over shapes with these masks in turn. Returns how many shapes rays with a
/// mask of some bits saw.
fn assert_same(tree: &RayTree, oracle: &BruteForce, masks: &[u32], what: &str) -> usize {
    let mask_of =
        |mesh: u32, primitive: u32| if mesh < 3 { 1 << mesh } else { masks[primitive as usize % masks.len()] };
    let mut random = Random(5);
    let rays: Vec<Ray> = (0..150).map(|_| random_ray(&mut random, 1.5)).collect();
    let points: Vec<_> = (0..40).map(|_| ClosestPointQuery::new(random.vec() * 1.5, random.unit())).collect();
    let mut seen = 0;
    for mask in MASKS {
        let (mut closest, mut any) = (Vec::new(), Vec::new());
        tree.closest_hits_masked(&rays, mask, &mut closest);
        tree.any_hits_masked(&rays, mask, &mut any);
        for (i, ray) in rays.iter().enumerate() {
            let expected = oracle.closest_hit_filtered(ray, mask, |_| true);
            assert_eq!(tree.closest_hit_masked(ray, mask), expected, "{what}, mask {mask:b}, {ray:?}");
            assert_eq!(tree.closest_hit_filtered(ray, mask, |_| true), expected);
            assert_eq!((closest[i], any[i]), (expected, expected.is_some()));
            assert_eq!(tree.any_hit_masked(ray, mask), expected.is_some());
            let mut first = None;
            let _ = tree.all_hits_masked(ray, mask, |hit| {
                first = first.map_or(Some(hit.t), |t: f32| Some(t.min(hit.t)));
                ControlFlow::Continue(())
            });
            assert_eq!(first, expected.map(|hit| hit.t));
            assert!(expected.is_none_or(|hit| mask_of(hit.mesh, hit.primitive) & mask != 0));
            seen += usize::from(mask != u32::MAX && expected.is_some_and(|hit| hit.mesh == 3));
        }
        for query in &points {
            let expected = oracle.closest_point_filtered(query, mask, |_| true);
            assert_eq!(tree.closest_point_masked(query, mask), expected, "{what}, mask {mask:b}, {query:?}");
            assert!(expected.is_none_or(|near| mask_of(near.mesh, near.primitive) & mask != 0));
        }
    }
    seen
}

#[test]
fn queries_with_a_mask_equal_brute_force_in_every_layout() {
    for (count, masks) in [(60, &[0b1, 0b10, 0b1000, 0, 0b100][..]), (60, &[0b10]), (7, &[0b1000, u32::MAX])] {
        let oracle = BruteForce::of_scene(&meshes(), shapes(count, masks)).unwrap();
        for params in params() {
            let tree = RayTree::of_scene(&meshes(), shapes(count, masks), &params).unwrap();
            let seen = assert_same(&tree, &oracle, masks, &format!("{params:?}"));
            assert!(seen > 10, "{seen}");
        }
    }
}

#[test]
fn masks_change_in_refits_without_motion() {
    let mut tree = RayTree::of_scene(&meshes(), shapes(60, &[0b1]), &BuildParams::default()).unwrap();
    for masks in [&[0b1, 0b10][..], &[0b1000], &[u32::MAX], &[0, 0b100]] {
        tree.refit_with_shapes(&meshes(), shapes(60, masks)).unwrap();
        let oracle = BruteForce::of_scene(&meshes(), shapes(60, masks)).unwrap();
        assert_same(&tree, &oracle, masks, &format!("{masks:?}"));
    }
    // Shapes that stay keep their masks.
    tree.refit(&meshes()).unwrap();
    tree.refit_moved(&meshes(), &[1]).unwrap();
    let oracle = BruteForce::of_scene(&meshes(), shapes(60, &[0, 0b100])).unwrap();
    assert_same(&tree, &oracle, &[0, 0b100], "meshes alone");
}

#[test]
fn trees_of_shapes_alone_have_masks_too() {
    let balls = |shift: u32| -> Vec<MovingSphere> {
        let ball =
            |i: u32| MovingSphere::fixed(DVec3::new(0.0, 0.0, f64::from(i) * 3.0), 1.0).with_mask(1 << (i + shift));
        (0..20).map(ball).collect()
    };
    let ray = Ray::new(DVec3::new(0.0, 0.0, -5.0), DVec3::Z.as_vec3());
    let mut tree = RayTree::of_scene(&[], balls(0), &BuildParams::default()).unwrap();
    let hit = |tree: &RayTree, mask| tree.closest_hit_masked(&ray, mask).map(|hit| hit.primitive);
    assert_eq!([1, 0b1100, 0, 1 << 20].map(|mask| hit(&tree, mask)), [Some(0), Some(2), None, None]);
    tree.refit_with_shapes(&[], balls(1)).unwrap();
    assert_eq!([1, 0b1100, 0, 1 << 20].map(|mask| hit(&tree, mask)), [None, Some(1), None, Some(19)]);
    let lazy = BuildParams { policy: Policy::Lazy(LazyParams::default()) };
    for params in [lazy, BuildParams::paper()] {
        let tree = RayTree::of_scene(&[], balls(0), &params).unwrap();
        assert_eq!([1, 0b1100, 0, 1 << 20].map(|mask| hit(&tree, mask)), [Some(0), Some(2), None, None]);
    }
}
