//! What f64 points cost: the same set with f32 and with f64 positions, in turn, one thread, medians.
//!
//! `cargo run --release --example double_points -- 1000000`

use mbkd::glam::DVec3;
use mbkd::{NeighborBuffer, PointArrays, PointParams, PointTree};
use mbkd_evidence::accuracy::Random;
use std::hint::black_box;
use std::time::Instant;

/// Rounds, of which the median counts.
const ROUNDS: usize = 9;

/// Queries per round.
const QUERIES: usize = 20_000;

fn nanoseconds(run: impl FnOnce()) -> f64 {
    let start = Instant::now();
    run();
    start.elapsed().as_secs_f64() * 1e9
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn ask(tree: &PointTree, queries: &[(DVec3, f32)], k: usize, radius: f32, buffer: &mut NeighborBuffer) {
    for &(q, time) in queries {
        match k {
            0 => {
                black_box(tree.query(q, time).radius(radius).collect_into(buffer).len());
            }
            1 => {
                black_box(tree.nearest(q, time));
            }
            _ => {
                black_box(tree.query(q, time).nearest_n_into(k, buffer).len());
            }
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let count: usize = std::env::args().nth(1).map_or(Ok(1_000_000), |n| n.parse())?;
    let mut random = Random(7);
    let spacing = (count as f64).cbrt().recip() * 2.0;
    for (name, speed) in [("still", 0.0), ("moving by half the spacing", 0.5)] {
        let open: Vec<DVec3> = (0..count).map(|_| random.vec()).collect();
        let close: Vec<DVec3> = open.iter().map(|p| *p + random.vec() * (speed * spacing)).collect();
        let keys: Vec<&[DVec3]> = if speed > 0.0 { vec![&open, &close] } else { vec![&open] };
        let set = PointArrays { keys: &keys, alive: &[], ids: &[] };
        let build = |round_to_f32: bool| PointTree::build(&set, &PointParams { round_to_f32, ..Default::default() });
        let mut builds = [Vec::new(), Vec::new()];
        for _ in 0..3 {
            for (times, round) in builds.iter_mut().zip([true, false]) {
                times.push(nanoseconds(|| drop(black_box(build(round)))));
            }
        }
        let [single, double] = builds.map(median);
        println!("{name}: build {:.0} and {:.0} ms, {:.2} times", single / 1e6, double / 1e6, double / single);
        let trees = [build(true)?, build(false)?];
        let [single, double] = [&trees[0], &trees[1]].map(|tree| tree.statistics().bytes() as f64 / count as f64);
        println!("{name}: {single:.0} and {double:.0} bytes per point");
        let queries: Vec<(DVec3, f32)> = (0..QUERIES).map(|_| (random.vec(), random.unit() as f32)).collect();
        let mut buffer = NeighborBuffer::new();
        // A ball with about forty points.
        let radius = (40.0 / count as f64 * 8.0 / 4.19).cbrt() as f32;
        for k in [1, 8, 32, 0] {
            let mut times = [Vec::new(), Vec::new()];
            for _ in 0..ROUNDS {
                for (times, tree) in times.iter_mut().zip(&trees) {
                    times.push(nanoseconds(|| ask(tree, &queries, k, radius, &mut buffer)) / QUERIES as f64);
                }
            }
            let [single, double] = times.map(median);
            let what = if k == 0 { "radius with 40 hits".into() } else { format!("{k} nearest") };
            println!("{name}, {what}: {single:.0} and {double:.0} ns, {:.2} times", double / single);
        }
    }
    Ok(())
}
