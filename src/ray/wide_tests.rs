//! The wide layout against brute force over the same triangle test. (Whole queries are tested with
//! [`RayTree`](crate::RayTree) in `tests/`.)

use crate::baseline::BruteForce;
use crate::primitive::{PrimitiveSet, Triangles};
use crate::random::Random;
use crate::simd::SimdLevel;
use crate::{
    BuildParams, ClosestPointQuery, Counters, Division, Ray, RayTree, TimeInterval, TriangleMesh, WideParams, scene,
};

fn soup(n: usize, keys: usize, size: f32, motion: f32, random: &mut Random) -> TriangleMesh {
    let mut positions = vec![Vec::new(); keys];
    for _ in 0..n {
        let at = random.vec();
        let corners = [at, at + random.vec() * size, at + random.vec() * size];
        for key in positions.iter_mut() {
            let by = random.vec() * motion;
            key.extend(corners.map(|c| c + by));
        }
    }
    TriangleMesh::new((0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions)
}

#[cfg(feature = "rayon")]
#[test]
fn the_tree_is_the_same_for_any_number_of_threads() {
    let mut random = Random(7);
    let meshes = [
        soup(12_000, 1, 0.05, 0.0, &mut random),
        soup(24_000, 2, 0.3, 0.02, &mut random),
        soup(2_000, 3, 0.1, 0.2, &mut random),
    ];
    same_for_any_number_of_threads(&meshes);
    // Some subtrees with a temporal split, others without.
    same_for_any_number_of_threads(&scene::mixed(40_000).meshes);
}

#[cfg(feature = "rayon")]
fn same_for_any_number_of_threads(meshes: &[TriangleMesh]) {
    use crate::layout::WideTree;
    use crate::primitive::{Scene, no_shapes};
    use crate::progress::Progress;

    let set = Scene::new(meshes, no_shapes()).unwrap();
    let params = WideParams::default();
    let words = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let tree = pool.install(|| WideTree::build(&set, &params, &Progress::new(None)).unwrap());
        tree.validate(&set).unwrap();
        (tree.root, tree.arena.ints().to_vec())
    };
    let one = words(1);
    for threads in [2, 3, 8] {
        assert!(words(threads) == one, "{threads} threads make another tree");
    }
}

#[test]
fn presplits_and_temporal_splits_are_made_where_they_pay_and_answer_like_brute_force() {
    let mut random = Random(11);
    // Long needles: pre-split. Loose triangles in fast incoherent motion: temporal splits with copies.
    let needles = scene::needles(30_000, 0.05).meshes;
    let loose = vec![soup(6000, 2, 0.01, 0.6, &mut random)];
    for (meshes, least) in [(needles, 1.3), (loose, 1.9)] {
        let tree = RayTree::build(&meshes, &BuildParams::default()).unwrap();
        assert!(tree.statistics().references_per_primitive() > least, "{:?}", tree.statistics());
        tree.validate().unwrap();
        let oracle = BruteForce::new(&meshes).unwrap();
        for _ in 0..200 {
            let (origin, target) = (random.vec() * 3.0, random.vec() * 0.5);
            let ray = Ray::new(origin, target - origin).at_time(random.signed() * 0.5 + 0.5);
            assert_eq!(tree.closest_hit(&ray), oracle.closest_hit(&ray), "{ray:?}");
            assert_eq!(tree.any_hit(&ray), oracle.any_hit(&ray), "{ray:?}");
        }
    }
}

/// The number of steps and tests of rays through a scene, weighted by their cost.
fn work(scene: &scene::Scene, tree: RayTree) -> f64 {
    let tree = tree.with_simd(SimdLevel::BASELINE);
    let (mut random, mut counters) = (Random(5), Counters::default());
    for _ in 0..3000 {
        let mut unit = || random.signed() * 0.5 + 0.5;
        let ray = scene.camera.ray(unit(), unit(), 1.0, unit());
        if let Some(hit) = tree.closest_hit_observed(&ray, &mut counters) {
            // Continue from the hit in a random direction.
            let from = ray.point(hit.t).as_vec3();
            tree.closest_hit_observed(&Ray::new(from, random.vec()).at_time(ray.time), &mut counters);
        }
    }
    2.0 * counters.nodes as f64 + counters.leaves as f64 + 0.07 * counters.primitive_tests as f64
}

#[test]
fn a_choice_per_region_takes_less_work_than_one_global_choice_of_no_more_memory() {
    let scene = scene::mixed(160_000);
    let of = |division| {
        let params = BuildParams::wide(WideParams { division, ..WideParams::default() });
        let tree = RayTree::build(&scene.meshes, &params).unwrap();
        (tree.statistics().bytes, tree)
    };
    let (size, tree) = of(Division::Automatic);
    let own = work(&scene, tree);
    let mut compared = 0;
    for division in [
        Division::Whole,
        Division::SharedLeaves(2),
        Division::SharedLeaves(4),
        Division::SeparateTrees(2),
        Division::SeparateTrees(3),
        Division::SeparateTrees(4),
    ] {
        let (bytes, tree) = of(division);
        if bytes <= size {
            compared += 1;
            let other = work(&scene, tree);
            println!("{division:?}: {other}, {bytes} bytes; automatic {own}, {size}");
            let factor = if division == Division::Whole { 0.7 } else { 0.98 };
            assert!(own < factor * other, "{division:?}: {own} against {other}");
        }
    }
    assert!(compared >= 4, "{size} bytes");
}

#[test]
fn the_budget_is_kept_and_more_of_it_never_makes_less() {
    let mut random = Random(3);
    let scenes = [
        scene::mixed(60_000).meshes,
        scene::tornado(20_000).meshes,
        scene::needles(20_000, 0.3).meshes,
        vec![soup(6000, 2, 0.01, 0.6, &mut random)],
    ];
    for (i, meshes) in scenes.iter().enumerate() {
        let mut last = 0.0;
        for budget in [128.0, 256.0, 400.0, 700.0, 1024.0, 2000.0, 4000.0] {
            let params = BuildParams::wide(WideParams { bytes_per_primitive: budget, ..WideParams::default() });
            let statistics = RayTree::build(meshes, &params).unwrap().statistics();
            let bytes = statistics.bytes as f32 / statistics.primitives as f32;
            println!("scene {i}, {budget}: {bytes}");
            assert!(bytes <= budget && bytes >= last, "scene {i}, {budget}: {bytes} after {last}");
            last = bytes;
        }
    }
}

#[test]
fn separate_trees_have_references_of_their_own_and_shared_leaves_have_not() {
    let mut random = Random(23);
    let meshes =
        [soup(600, 1, 0.1, 0.0, &mut random), soup(600, 2, 0.1, 0.3, &mut random), soup(300, 3, 0.1, 0.2, &mut random)];
    for division in [
        Division::Whole,
        Division::SharedLeaves(2),
        Division::SharedLeaves(3),
        Division::SharedLeaves(16),
        Division::SeparateTrees(2),
        Division::SeparateTrees(5),
        Division::SeparateTrees(16),
    ] {
        let tree =
            RayTree::build(&meshes, &BuildParams::wide(WideParams { division, ..WideParams::default() })).unwrap();
        tree.validate().unwrap();
        let references = tree.statistics().references;
        match division {
            Division::SeparateTrees(n) => assert_eq!(references, 1500 * n),
            // The mesh of three keys has one copy with all keys.
            _ => assert_eq!(references, 1500),
        }
    }
}

#[test]
fn boxes_hold_all_triangles_at_their_time() {
    let scene = scene::mixed(20_000);
    let tree = RayTree::build(&scene.meshes, &BuildParams::default()).unwrap();
    for time in [0.0, 0.3, 0.5, 1.0] {
        let mut top = Vec::new();
        tree.boxes(time, |b| top.extend((b.level == 1).then_some(b.bounds)));
        assert!((2..=16).contains(&top.len()));
        let mut random = Random(77);
        for _ in 0..500 {
            let mesh = (random.signed().abs() * scene.meshes.len() as f32) as u32;
            let triangle = (random.signed().abs() * scene.meshes[mesh as usize].len() as f32) as u32;
            let hit = crate::Hit { t: 0.0, u: 0.0, v: 0.0, mesh, primitive: triangle };
            let corners = tree.vertices(&hit, time);
            assert!(top.iter().any(|b| corners.iter().all(|&p| b.contains(p))), "{mesh} {triangle} at {time}");
        }
    }
    let mut seen = 0;
    tree.boxes(f32::NAN, |_| seen += 1);
    tree.boxes(1.5, |_| seen += 1);
    RayTree::build(&scene.meshes, &BuildParams::paper()).unwrap().boxes(0.5, |_| seen += 1);
    assert_eq!(seen, 0);
}

#[test]
fn corners_come_back_from_leaf_blocks_as_they_were_given() {
    let mut random = Random(5);
    let mut meshes = vec![
        soup(40, 1, 0.3, 0.0, &mut random),
        TriangleMesh::fixed(vec![], vec![]),
        soup(300, 2, 0.1, 0.3, &mut random),
        soup(100, 4, 0.1, 0.2, &mut random),
        soup(60, 1, 0.1, 0.0, &mut random),
        soup(50, 3, 0.1, 0.2, &mut random).with_active(TimeInterval::new(0.2, 0.4).unwrap()),
    ];
    // Shared vertices, static and moving, and pre-split needles.
    meshes.extend(scene::hall(3000).meshes);
    meshes.extend(scene::needles(2000, 0.05).meshes);
    let listed = RayTree::build(&meshes, &BuildParams::paper()).unwrap();
    for division in [Division::Automatic, Division::SharedLeaves(3), Division::SeparateTrees(2)] {
        let tree =
            RayTree::build(&meshes, &BuildParams::wide(WideParams { division, ..WideParams::default() })).unwrap();
        tree.validate().unwrap();
        for (mesh, of) in meshes.iter().enumerate() {
            for primitive in 0..of.len() {
                let hit = crate::Hit { t: 0.0, u: 0.0, v: 0.0, mesh: mesh as u32, primitive: primitive as u32 };
                for time in [0.0, 0.1, 1.0 / 3.0, 0.5, 0.77, 1.0] {
                    let bits = |tree: &RayTree| tree.vertices(&hit, time).map(|p| p.to_array().map(f64::to_bits));
                    assert_eq!(bits(&tree), bits(&listed), "{mesh} {primitive} at {time}, {division:?}");
                }
            }
        }
        let beyond = crate::Hit { t: 0.0, u: 0.0, v: 0.0, mesh: 0, primitive: 40 };
        assert!(tree.vertices(&beyond, 0.5).iter().all(|p| p.is_nan()));
    }
}

#[test]
fn the_check_finds_boxes_that_do_not_hold_their_triangles() {
    use crate::layout::{ValidationError, WideTree};
    use crate::primitive::{Scene, no_shapes};
    use crate::progress::Progress;
    use crate::simd::LANES;

    let mut random = Random(9);
    let meshes = [soup(200, 1, 0.1, 0.0, &mut random), soup(200, 2, 0.1, 0.3, &mut random)];
    let set = Scene::new(&meshes, no_shapes()).unwrap();
    let params = WideParams { division: Division::Whole, ..WideParams::default() };
    let mut tree = WideTree::build(&set, &params, &Progress::new(None)).unwrap();
    assert_eq!(tree.validate(&set), Ok(()));
    let (root, lanes) = (tree.root.at(), tree.lanes(tree.root).map(|(lane, _)| lane).collect::<Vec<_>>());
    // Each upper face in x of the root's boxes, moved inward a little and then restored.
    for lane in lanes {
        let face = &mut tree.arena.ints_mut()[root + LANES + lane];
        let whole = *face;
        *face = (f32::from_bits(whole) - 0.01).to_bits();
        assert!(matches!(tree.validate(&set), Err(ValidationError::Bounds { .. })), "lane {lane}");
        tree.arena.ints_mut()[root + LANES + lane] = whole;
    }
}

/// Corners of moving triangles as closest points have them, which round them to f32.
#[test]
fn corners_are_at_distance_zero_at_all_times() {
    let mut random = Random(12);
    let meshes = [soup(400, 2, 0.3, 0.5, &mut random)];
    let tree = RayTree::build(&meshes, &BuildParams::default()).unwrap();
    let set = Triangles::new(&meshes).unwrap();
    for i in 0..1200 {
        let time = random.unit();
        let corner = set.frame().to_world(set.corners(i / 3, time)[i as usize % 3]);
        let found = tree.closest_point(&ClosestPointQuery::new(corner, time).within(0.0)).unwrap();
        assert_eq!((found.distance, found.point), (0.0, corner));
    }
}
