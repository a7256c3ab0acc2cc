//! Bytes per point of our static tree and of kiddo's, counted at the allocator: those of the finished tree, and the
//! peak during the build.
//!
//! `cargo bench --bench neighbor_tables_memory`
//!
//! A separate program: a counting allocator would slow down allocations in the timing tables.

use clap::Parser;
use kiddo::leaf_strategy::FlatVec;
use kiddo::stem_strategy::Eytzinger;
use mbkd::{PointParams, PointTree};
use mbkd_evidence::options;
use mbkd_scenes::Random;
use peak_alloc::PeakAlloc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

type Flat = kiddo::KdTree<f32, u32, Eytzinger, FlatVec<f32, u32, 3, 32>, 3, 32>;

#[derive(Parser)]
#[command(about = "Bytes per point of static trees, ours and kiddo's, counted at the allocator")]
struct Args {
    /// Numbers of points.
    #[arg(long, value_delimiter = ',', default_values_t = [10_000, 100_000, 1_000_000, 10_000_000],
        value_parser = clap::value_parser!(u32).range(1..))]
    points: Vec<u32>,
}

fn weigh<T>(name: &str, points: usize, build: impl FnOnce() -> T) {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let built = build();
    let each = |bytes: usize| (bytes - before) as f64 / points as f64;
    let (held, most) = (each(MEMORY.current_usage()), each(MEMORY.peak_usage()));
    println!("  {name}: {held:.1} bytes per point, {most:.1} while building");
    drop(built);
}

fn main() {
    let args: Args = options();
    let mut random = Random(1);
    for n in args.points.into_iter().map(|n| n as usize) {
        let points: Vec<[f32; 3]> = (0..n).map(|_| [random.unit(), random.unit(), random.unit()]).collect();
        println!("{n} points");
        weigh("mbkd", n, || PointTree::build(&points, &PointParams::default()).expect("points are finite"));
        weigh("kiddo, arena leaves", n, || kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&points).expect("a tree"));
        weigh("kiddo, flat leaves", n, || Flat::new_from_slice(&points).expect("a tree"));
    }
}
