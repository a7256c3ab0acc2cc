//! Lazy trees: only subtrees that queries enter are built, each once, and answers do not depend on it.

use crate::common::{Random, all_hits, difference, mapped, random_ray, soup};
use core::ops::ControlFlow;
use core::sync::atomic::{AtomicUsize, Ordering};
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DVec3, Vec3};
use mbkd::{
    BuildError, BuildParams, ClosestPointQuery, Division, FileError, Instance, InstanceTree, Intersection, LazyParams,
    LinearBounds, MovingSphere, Primitive, Ray, RayTree, RefitError, Shape, TimeInterval, TriangleMesh, WideParams,
};
use std::sync::Arc;

/// Parameters with at most this many primitives per subtree.
fn lazy(subtree: usize) -> BuildParams {
    BuildParams::lazy(LazyParams { subtree, ..LazyParams::default() })
}

/// Still, moving and bending meshes and spheres, some thousand primitives within a few units of zero.
fn scene() -> (Vec<TriangleMesh>, Vec<Shape>) {
    let meshes = vec![
        soup(1500, 1, 0.1, 0.0, 1),
        soup(1500, 2, 0.1, 0.3, 2),
        soup(1000, 7, 0.1, 0.1, 3).with_active(TimeInterval::new(0.25, 0.75).unwrap()).with_mask(2),
        // Without area, all at one place.
        TriangleMesh::fixed(vec![[0, 0, 0]; 300], vec![Vec3::splat(0.5)]),
    ];
    let mut random = Random(4);
    let ball = |random: &mut Random| {
        let at = random.vec().as_dvec3();
        Shape::from(MovingSphere::new(vec![(at, 0.05), (at + DVec3::X * 0.2, 0.1)]))
    };
    (meshes, (0..200).map(|_| ball(&mut random)).collect())
}

#[test]
fn every_query_has_the_answer_of_a_whole_tree_whoever_comes_first() {
    let build = |params: &BuildParams| {
        let (meshes, shapes) = scene();
        RayTree::of_scene(&meshes, shapes, params).unwrap()
    };
    let whole = build(&BuildParams::default());
    let mut random = Random(9);
    let rays: Vec<Ray> = (0..300).map(|_| random_ray(&mut random, 1.5)).collect();
    let points: Vec<ClosestPointQuery> =
        (0..60).map(|_| ClosestPointQuery::new(random.vec() * 2.0, random.unit())).collect();
    let divided = LazyParams {
        wide: WideParams { division: Division::SeparateTrees(3), max_references: 3.0, ..WideParams::default() },
        subtree: 100,
    };
    let whole_shutter =
        LazyParams { wide: WideParams { division: Division::Whole, ..WideParams::default() }, subtree: 500 };
    let others = [divided, whole_shutter].map(BuildParams::lazy);
    for params in [lazy(1), lazy(64), lazy(2048), lazy(65536)].into_iter().chain(others) {
        // Each query uses a tree of its own, of which nothing is built yet.
        let trees: Vec<RayTree> = (0..5).map(|_| build(&params)).collect();
        for ray in &rays {
            assert_eq!(trees[0].closest_hit(ray), whole.closest_hit(ray), "{params:?}, {ray:?}");
            assert_eq!(trees[1].any_hit(ray), whole.any_hit(ray), "{params:?}, {ray:?}");
            assert_eq!(all_hits(&trees[2], ray), all_hits(&whole, ray), "{params:?}, {ray:?}");
            let wanted = |hit: &mbkd::Hit| !hit.primitive.is_multiple_of(3);
            let filtered =
                |tree: &RayTree| (tree.closest_hit_filtered(ray, 1, wanted), tree.any_hit_filtered(ray, 2, wanted));
            assert_eq!(filtered(&trees[3]), filtered(&whole), "{params:?}, {ray:?}");
        }
        let nearest = |tree: &RayTree| {
            let mut answers = Vec::new();
            tree.closest_points(&points, &mut answers);
            let filtered = points.iter().map(|query| tree.closest_point_filtered(query, 1, |p| p.primitive % 2 == 0));
            (answers, filtered.collect::<Vec<_>>())
        };
        assert_eq!(nearest(&trees[4]), nearest(&whole), "{params:?}");
        for tree in &trees {
            assert_eq!(tree.validate(), Ok(()));
            let (mut hits, mut expected) = (Vec::new(), Vec::new());
            tree.closest_hits(&rays, &mut hits);
            whole.closest_hits(&rays, &mut expected);
            assert_eq!(hits, expected);
        }
        assert_eq!(trees[0].triangle(1, 7, 0.3), whole.triangle(1, 7, 0.3));
    }
}

#[test]
fn time_slices_do_not_depend_on_the_order_of_meshes() {
    let [still, moving] = [soup(4000, 1, 0.02, 0.0, 5), soup(8000, 2, 0.02, 2.0, 6)];
    let mut random = Random(10);
    let rays: Vec<Ray> = (0..300).map(|_| random_ray(&mut random, 1.5)).collect();
    for meshes in [[still.clone(), moving.clone()], [moving, still]] {
        let tree = RayTree::build(&meshes, &lazy(2048)).unwrap();
        rays.iter().for_each(|ray| _ = tree.closest_hit(ray));
        let built = tree.statistics();
        assert!(built.time_nodes == built.built_subtrees && built.built_subtrees > 0, "{built:?}");
    }
}

#[test]
fn instances_place_lazy_trees() {
    let place = |params: &BuildParams| {
        let (meshes, shapes) = scene();
        let tree = Arc::new(RayTree::of_scene(&meshes, shapes, params).unwrap());
        let at = |x: f64| Instance::new(tree.clone(), DAffine3::from_translation(DVec3::X * x));
        let placed = InstanceTree::build(vec![at(-1.0), at(1.5)], &WideParams::default()).unwrap();
        (tree, placed)
    };
    let ((tree, lazily), (_, whole)) = (place(&lazy(64)), place(&BuildParams::default()));
    let mut random = Random(11);
    let rays: Vec<Ray> = (0..200).map(|_| random_ray(&mut random, 1.5)).collect();
    assert_eq!(tree.statistics().built_subtrees, 0);
    let found: Vec<_> = rays.iter().map(|ray| (lazily.closest_hit(ray), lazily.any_hit(ray))).collect();
    assert!(rays.iter().map(|ray| (whole.closest_hit(ray), whole.any_hit(ray))).eq(found));
    assert!(tree.statistics().built_subtrees > 0);
}

#[test]
fn brute_force_agrees_also_where_there_is_nothing() {
    for mesh in
        [soup(0, 2, 1.0, 1.0, 1), soup(700, 3, 0.3, 0.5, 2), TriangleMesh::fixed(vec![[0; 3]; 9], vec![Vec3::X])]
    {
        let oracle = BruteForce::new(std::slice::from_ref(&mesh)).unwrap();
        let tree = RayTree::build(&[mesh], &lazy(30)).unwrap();
        let mut random = Random(3);
        for _ in 0..200 {
            assert_eq!(difference(&tree, &oracle, &random_ray(&mut random, 1.5)), None);
        }
        assert_eq!(tree.validate(), Ok(()));
    }
}

#[test]
fn rays_into_a_corner_build_what_is_there() {
    let tree = RayTree::build(&[soup(20_000, 2, 0.02, 0.02, 5)], &lazy(100)).unwrap();
    let before = tree.statistics();
    assert!(before.subtrees >= 200 && before.built_subtrees == 0 && before.references == 0, "{before:?}");
    let count = |tree: &RayTree| {
        let (mut all, mut leaves) = (0, 0);
        tree.boxes(0.5, |b| (all, leaves) = (all + 1, leaves + usize::from(b.leaf)));
        (all, leaves)
    };
    assert_eq!((count(&tree).1, tree.validate()), (before.subtrees, Ok(())));
    let mut random = Random(6);
    let mut last = before.bytes;
    for _ in 0..50 {
        let corner = Vec3::splat(0.9) + 0.05 * random.vec();
        tree.closest_hit(&Ray::new(corner + Vec3::X, Vec3::NEG_X).at_time(random.unit()).between(0.0, 1.1));
        let now = tree.statistics();
        assert!(now.bytes >= last);
        last = now.bytes;
    }
    let after = tree.statistics();
    assert!((1..=before.subtrees / 20).contains(&after.built_subtrees), "{after:?}");
    assert!(after.references >= after.built_subtrees && after.bytes > before.bytes && after.nodes > before.nodes);
    assert!(count(&tree) > count(&RayTree::build(&[soup(20_000, 2, 0.02, 0.02, 5)], &lazy(100)).unwrap()));
    assert_eq!(tree.validate(), Ok(()));
    // Once more, nothing more is built.
    tree.closest_point(&ClosestPointQuery::new(Vec3::splat(0.9), 0.5).within(0.01));
    let all = Ray::new(Vec3::splat(3.0), Vec3::ONE);
    assert!(!tree.any_hit(&all) && tree.statistics() == after);
}

/// A ball that counts the calls for its bounds.
struct Counted(MovingSphere, Arc<AtomicUsize>);

impl Primitive for Counted {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.bounds(over)
    }
    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        self.0.intersect(ray)
    }
}

#[test]
fn rays_do_not_build_what_their_mask_hides() {
    let near = soup(2000, 2, 0.1, 0.1, 11);
    let behind = mapped(&soup(2000, 1, 0.1, 0.0, 12), |p| p + Vec3::X * 20.0);
    let meshes = [near.with_mask(0b01), behind.with_mask(0b10)];
    let oracle = BruteForce::new(&meshes).unwrap();
    let trees: [RayTree; 3] = core::array::from_fn(|_| RayTree::build(&meshes, &lazy(100)).unwrap());
    let mut random = Random(14);
    let mut hits = 0;
    for _ in 0..300 {
        let p = random.vec();
        let ray = Ray::new(Vec3::new(-3.0, p.y, p.z), Vec3::X).at_time(random.unit());
        for (tree, mask) in trees.iter().zip([0b100, 0b10, 0b11]) {
            let expected = oracle.closest_hit_filtered(&ray, mask, |_| true);
            assert_eq!(tree.closest_hit_filtered(&ray, mask, |_| true), expected, "{mask:b}, {ray:?}");
            assert_eq!(tree.any_hit_filtered(&ray, mask, |_| true), expected.is_some(), "{mask:b}, {ray:?}");
            let mut batch = Vec::new();
            tree.closest_hits_filtered(&[ray], mask, |_, _| true, &mut batch);
            assert_eq!(batch, [expected]);
            hits += usize::from(expected.is_some());
        }
    }
    assert!(hits > 100, "{hits}");
    let [none, behind, all] = trees.map(|tree| tree.statistics().built_subtrees);
    assert!(none == 0 && behind > 0 && all > behind, "{none}, {behind}, {all}");
    assert!(2 * all > 3 * behind, "{behind} of {all}");
}

#[test]
fn all_threads_at_once_find_the_same_and_each_subtree_is_built_once() {
    let calls = Arc::new(AtomicUsize::new(0));
    let mut random = Random(8);
    let balls: Vec<MovingSphere> = (0..2000)
        .map(|_| {
            let at = random.vec().as_dvec3();
            MovingSphere::new(vec![(at, 0.02), (at + 0.1 * random.vec().as_dvec3(), 0.03)])
        })
        .collect();
    let rays: Vec<Ray> = (0..500).map(|_| random_ray(&mut random, 1.2)).collect();
    let counted = |ball: &MovingSphere| Shape::custom(Counted(ball.clone(), calls.clone()));
    let build = || RayTree::of_scene(&[], balls.iter().map(counted).collect(), &lazy(40)).unwrap();
    let alone = build();
    let expected: Vec<_> = rays.iter().map(|ray| alone.closest_hit(ray)).collect();
    let once = calls.swap(0, Ordering::Relaxed);
    for _ in 0..5 {
        let tree = build();
        let start = std::sync::Barrier::new(8);
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let (tree, start, rays, expected) = (&tree, &start, &rays, &expected);
                scope.spawn(move || {
                    start.wait();
                    if thread % 4 == 3 {
                        // From the pool that all share.
                        let mut hits = Vec::new();
                        tree.closest_hits(rays, &mut hits);
                        assert_eq!(&hits, expected);
                    }
                    for (ray, expected) in rays.iter().zip(expected) {
                        assert_eq!(tree.closest_hit(ray), *expected);
                    }
                });
            }
        });
        assert_eq!(calls.swap(0, Ordering::Relaxed), once);
        assert_eq!(tree.statistics(), alone.statistics());
    }
}

#[test]
fn what_a_lazy_tree_cannot_do_is_an_error() {
    let meshes = [soup(300, 2, 0.1, 0.1, 1)];
    let mut tree = RayTree::build(&meshes, &lazy(50)).unwrap();
    let mut bytes = Vec::new();
    assert!(matches!(tree.write_to(&mut bytes), Err(FileError::Lazy)) && bytes.is_empty());
    assert_eq!(tree.refit(&meshes), Err(RefitError::Lazy));
    for subtree in [0, 65537] {
        let expected = BuildError::Parameter { name: "subtree", expected: "in [1, 65536]" };
        assert_eq!(RayTree::build(&meshes, &lazy(subtree)).unwrap_err(), expected);
    }
    let cancelled = RayTree::build_with_progress(&meshes, &lazy(50), &|_| ControlFlow::Break(()));
    assert_eq!(cancelled.unwrap_err(), BuildError::Cancelled);
}
