//! Builds in processor time, and the counted work of searches.

use mbkd::glam::Vec3;
use mbkd::{MovingPoint, PointLayerKind, PointParams, PointStatistics, PointStructure, PointTree};
use mbkd_evidence::timing::{race, seconds};
use std::hint::black_box;

/// The costs of the engine (`points` in `src/tuning.rs`), in nodes.
const BLOCK_COST: f64 = 0.4;
const UNCACHED_COST: f64 = 40.0;
const HALF_UNCACHED_BYTES: f64 = 100e6;

/// Numbers of time slices that are requested.
const FORCED: [usize; 6] = [1, 2, 4, 8, 16, 32];

/// What was measured of one set. Builds are in static builds of the same number of points.
pub struct Row {
    pub kind: &'static str,
    pub points: usize,
    pub chosen: String,
    /// The reason, for each layer.
    pub why: Vec<String>,
    /// The build of the automatic choice.
    pub build: f64,
    /// That of the chosen structure on request; none if fast or static points are apart.
    pub requested: Option<f64>,
    /// That of the best number of time slices within the default budget of references.
    pub build_of_best: f64,
    /// The cost of a search in the chosen structure, in nodes, and relative to the least cost of any number of time slices within
    /// the budget, and of any number.
    pub work: f64,
    pub to_best: f64,
    pub to_best_of_all: f64,
    /// The best number of time slices within the budget, and of all.
    pub best: [usize; 2],
}

impl Row {
    /// Measures a set; small ones are built more often.
    pub fn of(kind: &'static str, points: &[MovingPoint], queries: &[(Vec3, f32)], repeat: usize) -> Row {
        let automatic = build(points, PointStructure::Automatic);
        let work = cost(&automatic, queries);
        let budget = f64::from(PointParams::default().max_references);
        let of_forced = |slices| {
            let tree = build(points, PointStructure::TimeSlices(slices));
            let affordable = tree.statistics().references_per_point() <= budget;
            (slices, cost(&tree, queries), affordable)
        };
        let forced = FORCED.map(of_forced);
        let least = |all: bool| {
            let some = forced.iter().filter(|(_, _, affordable)| all || *affordable);
            some.min_by(|a, b| a.1.total_cmp(&b.1)).map_or((1, f64::INFINITY), |&(slices, cost, _)| (slices, cost))
        };
        let (best, best_of_all) = (least(false), least(true));
        let same = one_layer(automatic.statistics());
        let still: Vec<Vec3> = points.iter().map(|point| point.open.lerp(point.close, 0.5)).collect();
        let requested = |slices| drop(black_box(build(points, PointStructure::TimeSlices(slices))));
        let mut builds: [&mut dyn FnMut(); 4] = [
            &mut || drop(black_box(PointTree::build(&still, &PointParams::default()).expect("finite points"))),
            &mut || drop(black_box(build(points, PointStructure::Automatic))),
            &mut || requested(best.0),
            // Without such a number, nothing is timed twice.
            &mut || same.filter(|&slices| slices != best.0).into_iter().for_each(requested),
        ];
        let times = race(seconds, repeat * (50_000 / points.len()).max(1), &mut builds);
        let times: Vec<f64> = times.iter().map(|times| times.median).collect();
        let requested = same.map(|slices| if slices == best.0 { times[2] } else { times[3] } / times[0]);
        Row {
            kind,
            points: points.len(),
            chosen: describe(automatic.statistics()),
            why: automatic.statistics().layers.iter().map(|layer| layer.why.clone()).collect(),
            build: times[1] / times[0],
            requested,
            build_of_best: times[2] / times[0],
            work,
            to_best: work / best.1,
            to_best_of_all: work / best_of_all.1,
            best: [best.0, best_of_all.0],
        }
    }
}

fn build(points: &[MovingPoint], structure: PointStructure) -> PointTree {
    PointTree::build(points, &PointParams { structure, ..PointParams::default() }).expect("finite points")
}

/// The cost of a search for eight neighbours, in nodes.
fn cost(tree: &PointTree, queries: &[(Vec3, f32)]) -> f64 {
    let (mut nodes, mut blocks) = (0, 0);
    for &(point, time) in queries {
        let work = tree.query(point, time).work(8);
        nodes += work.nodes;
        blocks += work.blocks;
    }
    let bytes = tree.statistics().bytes() as f64;
    let memory = UNCACHED_COST * bytes / (bytes + HALF_UNCACHED_BYTES);
    (nodes as f64 + BLOCK_COST * blocks as f64) / queries.len() as f64 + memory
}

/// The number of time slices if there is only one layer.
fn one_layer(statistics: &PointStatistics) -> Option<usize> {
    match statistics.layers[..] {
        [ref layer] => time_slices(&layer.kind),
        _ => None,
    }
}

fn time_slices(kind: &PointLayerKind) -> Option<usize> {
    if let PointLayerKind::Linear { time_slices } = kind { Some(*time_slices) } else { None }
}

fn describe(statistics: &PointStatistics) -> String {
    let all = statistics.layers.iter();
    let names = all.map(|layer| time_slices(&layer.kind).map_or("static".into(), |slices| slices.to_string()));
    names.collect::<Vec<_>>().join(" + ")
}
