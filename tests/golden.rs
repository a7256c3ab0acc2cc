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

#[test]
fn the_papers_tree() {
    assert_eq!(counts("tornado", &BuildParams::paper()), [0, 0, 0, 0]);
    assert_eq!(counts("hall", &BuildParams::paper()), [0, 0, 0, 0]);
    assert_eq!(counts("hairball", &BuildParams::paper()), [0, 0, 0, 0]);
}

#[test]
fn moving_planes() {
    let params = BuildParams::default().with_policy(Policy::Mbkd);
    assert_eq!(counts("tornado", &params), [0, 0, 0, 0]);
    assert_eq!(counts("coherent", &params), [0, 0, 0, 0]);
}

#[test]
fn the_classic_tree() {
    let params = BuildParams::default().with_policy(Policy::ClassicKd);
    assert_eq!(counts("tornado", &params), [0, 0, 0, 0]);
    assert_eq!(counts("hall", &params), [0, 0, 0, 0]);
}
