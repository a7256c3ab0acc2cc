//! Counted work: nodes and tests per ray, exactly. A change here is a change of the trees or of the traversal, and
//! belongs in the notes with the new figures.

use crate::common::Random;
use crate::scene;
use mbkd::{BuildParams, Counters, KdParams, RayTree, SimdLevel};

/// Nodes, leaves, references skipped by time and tests of 2000 camera rays at random times.
fn counts(name: &str, params: &BuildParams) -> [u64; 4] {
    let scene = (scene::find(name).unwrap().make)(5000);
    // Culling may fuse where the hardware does, so counts of the wide tree belong to one instruction set.
    let tree = RayTree::build(&scene.meshes, params).unwrap().with_simd(SimdLevel::BASELINE);
    let mut random = Random(11);
    let mut counters = Counters::default();
    for _ in 0..2000 {
        let ray = scene.camera.ray(random.unit(), random.unit(), 1.0, random.unit());
        tree.closest_hit_observed(&ray, &mut counters);
    }
    [counters.nodes, counters.leaves, counters.time_skips, counters.primitive_tests]
}

/// Scene, tree, and its counts.
const GOLDEN: &[(&str, &str, [u64; 4])] = &[
    ("tornado", "paper", [42372, 12215, 80737, 35402]),
    ("hall", "paper", [71690, 17478, 15984, 14499]),
    ("hairball", "paper", [64899, 18097, 40045, 23055]),
    ("tornado", "moving planes", [41912, 12510, 57740, 31997]),
    ("coherent", "moving planes", [34263, 7735, 4319, 17328]),
    ("tornado", "classic", [44196, 12635, 0, 136420]),
    ("hall", "classic", [72001, 17336, 0, 15360]),
    ("tornado", "wide", [3796, 2962, 0, 25100]),
    ("hall", "wide", [6741, 2114, 0, 20845]),
    ("hairball", "wide", [4487, 252, 0, 2037]),
    ("mixed", "wide", [11196, 3700, 0, 38315]),
    ("needles", "wide", [15051, 22861, 0, 212382]),
    ("building", "wide", [9010, 2666, 0, 22378]),
    ("visited", "wide", [10753, 2991, 0, 22712]),
];

#[test]
fn nodes_leaves_time_skips_and_tests() {
    let mut wrong = Vec::new();
    for &(scene, tree, expected) in GOLDEN {
        let params = match tree {
            "paper" => BuildParams::paper(),
            "moving planes" => BuildParams::kd(KdParams::default()),
            "classic" => BuildParams::kd(KdParams::classic()),
            _ => BuildParams::default(),
        };
        let got = counts(scene, &params);
        if got != expected {
            wrong.push(format!("    ({scene:?}, {tree:?}, {got:?}),"));
        }
    }
    assert!(wrong.is_empty(), "different counts:\n{}", wrong.join("\n"));
}

/// Observers change neither answers nor work. (That unobserved queries cost nothing extra is measured by the pair `closest` and
/// `closest observed by ()` in `benches/rays.rs`: the plain query is the observed one with `()`.)
#[test]
fn observing_changes_nothing() {
    let scene = (scene::find("hall").unwrap().make)(5000);
    for params in [BuildParams::default(), BuildParams::paper()] {
        let tree = RayTree::build(&scene.meshes, &params).unwrap();
        let mut random = Random(3);
        for _ in 0..2000 {
            let ray = scene.camera.ray(random.unit(), random.unit(), 1.0, random.unit());
            let (mut first, mut second) = (Counters::default(), Counters::default());
            let plain = tree.closest_hit(&ray);
            assert_eq!(tree.closest_hit_observed(&ray, &mut first), plain, "{ray:?}");
            assert_eq!(tree.closest_hit_observed(&ray, &mut ()), plain, "{ray:?}");
            tree.closest_hit_observed(&ray, &mut second);
            assert_eq!(first, second, "{ray:?}");
            assert!(plain.is_none() || first.primitive_tests > 0, "{ray:?}: a hit without a test");
        }
    }
}
