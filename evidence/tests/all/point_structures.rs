//! Counted work of neighbour searches and the make-up of point trees, compared exactly with a file.
//!
//! Counts depend neither on the instruction set nor on the number of threads, which the test checks too. A change in them
//! is a change in what the library does: look at it, then write the file anew with
//! `UPDATE_GOLDEN=1 cargo test --release -p mbkd-evidence --test all point_structures`.

use mbkd::{NeighborWork, PointParams, PointStructure, PointTree, SimdLevel};
use mbkd_evidence::point_sets::{MOTIONS, moving_points, queries};
use std::path::Path;

/// Points of a set, queries among them, neighbours of a query.
const SIZES: (usize, usize, usize) = (4000, 200, 8);

const STRUCTURES: [(&str, PointStructure); 4] = [
    ("automatic", PointStructure::Automatic),
    ("linear", PointStructure::Linear),
    ("4 time slices", PointStructure::TimeSlices(4)),
    ("kd", PointStructure::Kd),
];

/// A line for each layer of each tree, then one for the searches.
fn counts(simd: SimdLevel) -> String {
    let (n, queried, k) = SIZES;
    let mut text = "set,structure,layer,points,references,nodes,levels\n".to_string();
    let mut work = "set,structure,search,nodes,blocks\n".to_string();
    for (name, motion) in MOTIONS {
        let points = moving_points(motion, n, 1);
        let queries = queries(&points, queried, 2);
        for (label, structure) in STRUCTURES {
            let tree = PointTree::build(&points, &PointParams { structure, simd, ..PointParams::default() }).unwrap();
            for layer in &tree.statistics().layers {
                let kind = format!("{:?}", layer.kind).to_lowercase();
                text += &format!(
                    "{name},{label},{kind},{},{},{},{}\n",
                    layer.points, layer.references, layer.nodes, layer.levels
                );
            }
            for epsilon in [0.0, 0.3] {
                let mut sum = NeighborWork::default();
                for (at, time) in &queries {
                    let own = tree.query(*at, *time).approximate(epsilon).work(k);
                    (sum.nodes, sum.blocks) = (sum.nodes + own.nodes, sum.blocks + own.blocks);
                }
                work += &format!("{name},{label},{k} nearest within {epsilon},{},{}\n", sum.nodes, sum.blocks);
            }
        }
    }
    text + &work
}

#[test]
fn counts_are_those_of_the_golden_file() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/point_structures.csv");
    let best = counts(SimdLevel::best());
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &best).unwrap();
    }
    let golden = std::fs::read_to_string(&path).unwrap_or_default();
    for (line, (found, expected)) in best.lines().zip(golden.lines()).enumerate() {
        assert_eq!(
            found,
            expected,
            "line {} of {}; if the change is wanted: UPDATE_GOLDEN=1 cargo test --release -p mbkd-evidence --test all point_structures",
            line + 1,
            path.display()
        );
    }
    assert_eq!(best.lines().count(), golden.lines().count(), "lines of {}; see the head of this test", path.display());
}

#[test]
fn counts_depend_neither_on_instructions_nor_on_threads() {
    let best = counts(SimdLevel::best());
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for level in SimdLevel::available() {
        assert!(one.install(|| counts(level)) == best, "{level}");
    }
}
