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
    ("tornado", "paper", [39137, 11305, 91622, 37970]),
    ("hall", "paper", [68010, 16477, 29178, 23989]),
    ("hairball", "paper", [51883, 15342, 67470, 38633]),
    ("tornado", "moving planes", [39357, 11744, 68076, 34106]),
    ("coherent", "moving planes", [32858, 7624, 9389, 20822]),
    ("tornado", "classic", [44161, 12617, 0, 136570]),
    ("hall", "classic", [71828, 17228, 0, 15595]),
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
