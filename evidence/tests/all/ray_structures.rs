//! Counted work of every structure for rays, compared exactly with `golden/ray_structures.csv`.
//!
//! Counts are the same on every machine: builds and the binary traversals are plain unfused arithmetic, scenes and rays
//! have the same bits everywhere, and the wide tree, whose culling may fuse where the hardware does, is asked on the portable
//! code path. A difference is a change of a build or of a traversal, and belongs in the changelog.

use mbkd::{BuildParams, Counters, KdParams, Ray, RayTree, SimdLevel, TriangleMesh};
use mbkd_evidence::accuracy::Random;
use mbkd_evidence::peers::{FourDParams, Peer, Structure};
use mbkd_scenes as scene;
use std::fmt::Write;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/ray_structures.csv");
/// What makes the test write the file instead.
const UPDATE: &str = "UPDATE_GOLDEN";
const TRIANGLES: usize = 2000;
const RAYS: usize = 1000;

fn structures() -> [(&'static str, Structure); 8] {
    [
        ("BVH_i", Structure::BvhI),
        ("MSBVH", Structure::msbvh()),
        ("4D k-d", Structure::FourD(FourDParams::default())),
        ("classic k-d", Structure::Library(BuildParams::kd(KdParams::classic()))),
        ("paper", Structure::Library(BuildParams::paper())),
        ("moving planes", Structure::Library(BuildParams::kd(KdParams::default()))),
        ("wide", Structure::wide()),
        ("2 slices of the paper's", Structure::Slices(2, BuildParams::paper())),
    ]
}

/// Inner nodes, leaves and references of a structure; nodes, leaves and tests of all rays; hits.
fn counts(structure: &Structure, meshes: &[TriangleMesh], rays: &[Ray]) -> [u64; 7] {
    let mut counters = Counters::default();
    // On the portable code path, or whatever there is one of.
    let library = match structure {
        Structure::Library(params) => Some(RayTree::build(meshes, params).unwrap().with_simd(SimdLevel::PORTABLE)),
        _ => None,
    };
    let peer = library.is_none().then(|| Peer::build(structure, meshes).unwrap());
    let sizes = match (&library, &peer) {
        (Some(tree), _) => {
            let of = tree.statistics();
            [of.nodes, of.leaves, of.references]
        }
        (_, Some(peer)) => {
            let of = peer.statistics();
            [of.nodes, of.leaves, of.references]
        }
        _ => [0; 3],
    };
    let mut closest = |ray: &Ray| match (&library, &peer) {
        (Some(tree), _) => tree.closest_hit_observed(ray, &mut counters),
        (_, Some(peer)) => peer.closest_hit_observed(ray, &mut counters),
        _ => None,
    };
    let hits = rays.iter().filter(|ray| closest(ray).is_some()).count() as u64;
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
        let mut unit = || random.unit() as f32;
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
