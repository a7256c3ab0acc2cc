//! Clones of trees: they answer alike, and what becomes of one does not change the other.

use crate::brute_force::Brick;
use crate::common::{Random, closed_sphere, difference, divided, mapped, mapped_to_f64, random_ray, soup};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DVec3, Vec3};
use mbkd::{
    BuildParams, Division, Instance, InstanceTree, LazyParams, MovingSphere, RayTree, Shape, Statistics, TimeInterval,
    TriangleMesh, WideParams,
};
use std::sync::Arc;

fn meshes(shift: f32) -> Vec<TriangleMesh> {
    let mut meshes = vec![
        soup(150, 1, 0.2, 0.0, 1),
        soup(150, 2, 0.2, 0.4, 2).with_active(TimeInterval::new(0.2, 0.8).unwrap()),
        closed_sphere(10, 5, 0.1, 3).with_mask(0b10),
        soup(20, 2, 0.3, 0.1, 4),
    ];
    for mesh in &mut meshes {
        *mesh = mapped(mesh, |p| p + Vec3::X * shift);
    }
    let fine = mapped_to_f64(&meshes[3], |p| p * (1.0 + 1e-12));
    meshes[3] = TriangleMesh::new(meshes[3].indices.clone(), fine).precise();
    meshes
}

fn shapes(shift: f64) -> Vec<Shape> {
    let mut random = Random(9);
    let mut place = move || random.vec().as_dvec3() + DVec3::X * shift;
    let mut shapes: Vec<Shape> =
        (0..30).map(|_| MovingSphere::new(vec![(place(), 0.1), (place(), 0.05)]).into()).collect();
    shapes.push(Shape::custom(Brick::new(DVec3::Y + DVec3::X * shift, 0.3)));
    shapes
}

fn assert_answers(tree: &RayTree, oracle: &BruteForce, what: &str) {
    let mut random = Random(7);
    for _ in 0..300 {
        let ray = random_ray(&mut random, 1.5);
        assert_eq!(difference(tree, oracle, &ray), None, "{what}");
    }
}

/// What refits keep up to date, and all hits of some rays.
fn state(tree: &RayTree) -> (Statistics, Vec<Option<mbkd::Hit>>) {
    let mut random = Random(8);
    let hits = (0..100).map(|_| tree.closest_hit(&random_ray(&mut random, 1.5))).collect();
    (tree.statistics(), hits)
}

#[test]
fn a_refit_of_a_tree_or_of_its_clone_leaves_the_other_as_it_was() {
    let oracles = [0.0, 0.25].map(|by| BruteForce::of_scene(&meshes(by), shapes(f64::from(by))).unwrap());
    for division in [Division::Automatic, Division::SharedLeaves(3), Division::SeparateTrees(2)] {
        let mut tree = RayTree::of_scene(&meshes(0.0), shapes(0.0), &divided(division)).unwrap();
        // The first refit makes a plan, which a second clone copies.
        for round in 0..2 {
            let mut clone = tree.clone();
            let before = state(&tree);
            assert_eq!(state(&clone), before, "{division:?} {round}");
            let refit = clone.refit_with_shapes(&meshes(0.25), shapes(0.25)).unwrap();
            assert_eq!(state(&tree), before, "{division:?} {round}");
            assert_eq!(
                tree.clone().refit_with_shapes(&meshes(0.25), shapes(0.25)).unwrap(),
                refit,
                "{division:?} {round}"
            );
            for (of, oracle) in [&tree, &clone].into_iter().zip(&oracles) {
                assert_eq!(of.validate(), Ok(()), "{division:?} {round}");
                assert_answers(of, oracle, &format!("{division:?} {round}"));
            }
            // Meshes alone: the shapes, which both share, stay.
            let after = state(&clone);
            tree.refit(&meshes(0.0)).unwrap();
            assert_eq!(state(&clone), after, "{division:?} {round}");
            drop(clone);
            assert_answers(&tree, &oracles[0], &format!("{division:?} {round}, alone"));
        }
    }
}

#[test]
fn a_clone_of_a_lazy_tree_has_the_subtrees_built_so_far_and_builds_its_own() {
    let (meshes, oracle) = (meshes(0.0), BruteForce::of_scene(&meshes(0.0), shapes(0.0)).unwrap());
    let params = BuildParams::lazy(LazyParams { subtree: 32, ..LazyParams::default() });
    let built = |tree: &RayTree| tree.statistics().built_subtrees;
    let tree = RayTree::of_scene(&meshes, shapes(0.0), &params).unwrap();
    let mut random = Random(3);
    while built(&tree) < 3 {
        tree.closest_hit(&random_ray(&mut random, 1.5));
    }
    let (clone, before) = (tree.clone(), built(&tree));
    assert_eq!(built(&clone), before);
    assert_answers(&clone, &oracle, "lazy");
    assert!(built(&clone) > before && built(&tree) == before);
    assert_answers(&tree, &oracle, "lazy");
}

#[test]
fn trees_of_the_paper_are_cloned_as_well() {
    let oracle = BruteForce::of_scene(&meshes(0.0), shapes(0.0)).unwrap();
    let tree = RayTree::of_scene(&meshes(0.0), shapes(0.0), &BuildParams::paper()).unwrap();
    let clone = tree.clone();
    drop(tree);
    assert_eq!(clone.validate(), Ok(()));
    assert_answers(&clone, &oracle, "paper");
}

#[test]
fn an_instanced_tree_is_refitted_while_the_last_frame_still_holds_it() {
    let mut tree = Arc::new(RayTree::build(&meshes(0.0), &BuildParams::default()).unwrap());
    let place = |tree: &Arc<RayTree>| {
        let at = |x: f64| Instance::new(tree.clone(), DAffine3::from_translation(DVec3::X * x));
        InstanceTree::build(vec![at(0.0), at(4.0)], &WideParams::default()).unwrap()
    };
    let hits = |frame: &InstanceTree| {
        let mut random = Random(5);
        (0..200).map(|_| frame.closest_hit(&random_ray(&mut random, 1.5))).collect::<Vec<_>>()
    };
    let frame = place(&tree);
    let (before, copy) = (hits(&frame), frame.clone());
    Arc::make_mut(&mut tree).refit(&meshes(0.25)).unwrap();
    assert_eq!(hits(&frame), before);
    assert_eq!(hits(&copy), before);
    let fresh = Arc::new(RayTree::build(&meshes(0.25), &BuildParams::default()).unwrap());
    let next = place(&tree);
    assert_eq!(hits(&next), hits(&place(&fresh)));
    assert_ne!(hits(&next), before);
}
