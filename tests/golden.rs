//! Counted work: nodes and tests per ray, exactly. A change here is a change of the trees or of the traversal, and
//! belongs in the changelog with the new figures.

mod common;

use common::Random;
use mbkd::{BuildParams, Counters, Policy, RayTree, scene};

/// Nodes, leaves, references skipped by time and tests of 2000 camera rays at random times.
fn counts(name: &str, params: &BuildParams) -> [u64; 4] {
    let scene = (scene::find(name).unwrap().make)(5000);
    let tree = RayTree::build(&scene.meshes, params).unwrap();
    let mut random = Random(11);
    let mut counters = Counters::default();
    for _ in 0..2000 {
        let ray = scene.camera.ray(random.unit(), random.unit(), 1.0, random.unit());
        tree.closest_hit_observed(&ray, &mut counters);
    }
    [counters.nodes, counters.leaves, counters.time_skips, counters.primitive_tests]
}

/// Scene, which tree, and its counts.
const GOLDEN: &[(&str, &str, [u64; 4])] = &[
    ("tornado", "paper", [41853, 12340, 114823, 24649]),
    ("hall", "paper", [66255, 15763, 28207, 17927]),
    ("hairball", "paper", [60363, 17912, 77337, 43878]),
    ("tornado", "moving planes", [42683, 12747, 73091, 19383]),
    ("coherent", "moving planes", [32716, 7531, 20366, 35129]),
    ("tornado", "classic", [51787, 14693, 0, 113357]),
    ("hall", "classic", [68788, 16396, 0, 13517]),
];

#[test]
fn nodes_leaves_time_skips_and_tests_of_the_kd_trees() {
    let mut wrong = Vec::new();
    for &(scene, tree, expected) in GOLDEN {
        let params = match tree {
            "paper" => BuildParams::paper(),
            "moving planes" => BuildParams::default().with_policy(Policy::Mbkd),
            _ => BuildParams::default().with_policy(Policy::ClassicKd),
        };
        let got = counts(scene, &params);
        if got != expected {
            wrong.push(format!("    ({scene:?}, {tree:?}, {got:?}),"));
        }
    }
    assert!(wrong.is_empty(), "different counts:\n{}", wrong.join("\n"));
}
