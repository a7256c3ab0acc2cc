//! Counted work of every structure for rays, compared exactly with `golden/ray_structures.csv`.
//!
//! Counts are the same on every machine: builds and the peers' traversals are plain unfused arithmetic, scenes and rays have the
//! same bits everywhere, and the library's wide tree, whose culling may fuse where the hardware does, is asked on the portable code
//! path. A node of a tree that is laid out wide is sixteen boxes that a ray is tested against, of which the last may be empty. A
//! difference is a change of a build or of a traversal, and belongs in the notes.

use mbkd::{BuildParams, Counters, KdParams, Ray, TriangleMesh};
use mbkd_evidence::peers::{BvhParams, Collapsed, FourDParams, Peer, Structure};
use mbkd_scenes as scene;
use mbkd_scenes::Random;
use std::fmt::Write;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/ray_structures.csv");
/// What makes the test write the file instead.
const UPDATE: &str = "UPDATE_GOLDEN";
const TRIANGLES: usize = 2000;
const RAYS: usize = 1000;

fn structures() -> [(&'static str, Structure); 14] {
    let kd = |params| Structure::Portable(BuildParams::kd(params));
    [
        ("BVH_i", Structure::BvhI),
        ("MSBVH", Structure::msbvh()),
        ("4D k-d", Structure::FourD(FourDParams::default())),
        ("classic k-d", kd(KdParams::classic())),
        ("paper", kd(KdParams::paper())),
        ("moving planes", kd(KdParams::default())),
        ("wide", Structure::Portable(BuildParams::default())),
        ("BVH_i laid out wide", Structure::Collapsed(Collapsed::Bvh(BvhParams::BVH_I))),
        ("MSBVH laid out wide", Structure::Collapsed(Collapsed::Bvh(BvhParams::MSBVH))),
        ("4D k-d laid out wide", Structure::Collapsed(Collapsed::FourD(FourDParams::default()))),
        ("classic k-d laid out wide", Structure::Collapsed(Collapsed::Kd(KdParams::classic()))),
        ("paper laid out wide", Structure::Collapsed(Collapsed::Kd(KdParams::paper()))),
        ("moving planes laid out wide", Structure::Collapsed(Collapsed::Kd(KdParams::default()))),
        ("2 slices of the paper's", Structure::Slices(2, BuildParams::paper())),
    ]
}

/// Inner nodes, leaves and references of a structure; nodes, leaves and tests of all rays; hits.
fn counts(structure: &Structure, meshes: &[TriangleMesh], rays: &[Ray]) -> [u64; 7] {
    let mut counters = Counters::default();
    let peer = Peer::build(structure, meshes).unwrap();
    let of = peer.statistics();
    let sizes = [of.nodes, of.leaves, of.references];
    let hits = rays.iter().filter(|ray| peer.closest_hit_observed(ray, &mut counters).is_some()).count() as u64;
    let [tree_nodes, tree_leaves, references] = sizes.map(|n| n as u64);
    let Counters { nodes, leaves, primitive_tests, .. } = counters;
    [tree_nodes, tree_leaves, references, nodes, leaves, primitive_tests, hits]
}

#[test]
fn counted_work() {
    let heads = "scene,structure,nodes,leaves,references,nodes of rays,leaves of rays,tests of rays,hits";
    let mut found = format!("{heads}\n");
    for name in ["hall", "hairball", "hand", "tornado"] {
        let scene = (scene::find(name).unwrap().make)(TRIANGLES);
        let mut random = Random(11);
        let mut unit = || random.unit_f64() as f32;
        let rays: Vec<Ray> = (0..RAYS).map(|_| scene.camera.ray(unit(), unit(), 1.0, unit())).collect();
        for (structure, of) in structures() {
            let counts = counts(&of, &scene.meshes, &rays).map(|n| n.to_string()).join(",");
            writeln!(found, "{name},{structure},{counts}").unwrap();
        }
    }
    if std::env::var_os(UPDATE).is_some() {
        std::fs::write(FILE, &found).unwrap();
        return;
    }
    let expected = std::fs::read_to_string(FILE).unwrap_or_default();
    let differ: Vec<String> = found
        .lines()
        .zip(expected.lines().chain(std::iter::repeat("nothing")))
        .filter(|(found, expected)| found != expected)
        .map(|(found, expected)| format!("found    {found}\nexpected {expected}"))
        .collect();
    assert!(
        differ.is_empty() && found.lines().count() == expected.lines().count(),
        "{heads}\n{}\nIf that is meant: {UPDATE}=1 cargo test --release -p mbkd-evidence --test all ray_structures",
        differ.join("\n")
    );
}
