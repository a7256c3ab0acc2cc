//! What f64 points cost: the same set with f32 and with f64 positions, one thread. A thousand queries of each in turn;
//! the median of the ratios of such pairs, and the least time of each.
//!
//! `cargo run --release --example double_points -- --points 100000 --rows uniform`; all rows with 100 000 and a million points
//! unless said otherwise.

use clap::Parser;
use mbkd::glam::DVec3;
use mbkd::{NeighborBuffer, NeighborLists, PointArrays, PointParams, PointTree, Precision, morton_code};
use mbkd_evidence::timing::{median, race, wall_seconds};
use mbkd_scenes::Random;
use std::hint::black_box;
use std::time::Instant;

/// What is compared.
const PRECISIONS: [Precision; 2] = [Precision::Single, Precision::Double];

/// Rounds through all queries.
const ROUNDS: usize = 5;

/// Queries of a round.
const QUERIES: usize = 20_000;

/// Queries that one tree answers before it is the other's turn.
const TURN: usize = 1000;

/// Asked of both trees: so many nearest, or with 0 all within a radius with forty hits.
const ASKED: [usize; 4] = [1, 8, 32, 0];

fn nanoseconds(run: impl FnOnce()) -> f64 {
    let start = Instant::now();
    run();
    start.elapsed().as_secs_f64() * 1e9
}

fn run_query(tree: &PointTree, queries: &[(DVec3, f32)], k: usize, radius: f32, buffer: &mut NeighborBuffer) {
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

/// Where points lie, all of it of about the same size.
const SCENES: [&str; 3] = ["uniform", "surfaces", "clusters 1e7 apart"];

fn place(scene: &str, random: &mut Random) -> DVec3 {
    match scene {
        "uniform" => random.dvec(),
        // Three spheres.
        "surfaces" => {
            let way = loop {
                let way = random.dvec();
                if way.length_squared() <= 1.0 {
                    break way.normalize();
                }
            };
            let number = random.below(3) as f64;
            DVec3::new(0.4, -0.2, 0.3) * number + way * (1.0 - 0.3 * number)
        }
        // Of a size whose spacing f32 can still tell apart.
        _ => random.dvec() * 1e5 + DVec3::new(0.7, 1.0, -0.3) * (1e7 * random.below(2) as f64),
    }
}

/// Places along a curve through the set.
fn morton(at: DVec3, (lo, hi): (DVec3, DVec3)) -> u64 {
    morton_code(
        ((at - lo) / (hi - lo) * 1_048_575.0).clamp(DVec3::ZERO, DVec3::splat(1_048_575.0)).as_uvec3().to_array(),
    )
}

fn compare(scene: &str, count: usize, moving: bool) -> Result<(), Box<dyn std::error::Error>> {
    let mut random = Random(7);
    let open: Vec<DVec3> = (0..count).map(|_| place(scene, &mut random)).collect();
    // A radius with about forty hits, and from it the mean spacing.
    let sample = PointTree::build(&open, &PointParams::default())?;
    let mut radii: Vec<f32> = (0..101)
        .filter_map(|_| Some(sample.nearest_n(open[random.below(count)], 0.0, 41).last()?.distance()))
        .collect();
    radii.sort_by(f32::total_cmp);
    let radius = radii[radii.len() / 2];
    let spacing = f64::from(radius) / 2.1;
    drop(sample);
    let close: Vec<DVec3> = open.iter().map(|p| *p + random.dvec() * (0.5 * spacing)).collect();
    let keys: Vec<&[DVec3]> = if moving { vec![&open, &close] } else { vec![&open] };
    let set = PointArrays { keys: &keys, active: &[], ids: &[] };
    let build = |precision| PointTree::build(&set, &PointParams { precision, ..Default::default() });
    let builds = race(wall_seconds, 3, &mut PRECISIONS.map(|precision| move || drop(black_box(build(precision)))));
    let [single_tree, double_tree] = PRECISIONS.map(build);
    let trees = [single_tree?, double_tree?];
    let [less, more] = [&trees[0], &trees[1]].map(|tree| tree.statistics().bytes() as f64 / count as f64);
    let name = format!("{scene}, {count}, {}", if moving { "moving by half the spacing" } else { "static" });
    println!("{name}: {less:.0} and {more:.0} bytes per point, build {:.2} times", builds[1].median / builds[0].median);
    let mut queries: Vec<(DVec3, f32)> = (0..QUERIES)
        .map(|_| (open[random.below(count)] + random.dvec() * (0.5 * spacing), random.unit_f64() as f32))
        .collect();
    let (mut buffer, mut lists, mut ratios) = (NeighborBuffer::new(), NeighborLists::new(), Vec::new());
    for _ in 0..ROUNDS {
        let mut make = |tree: &PointTree| {
            let start = Instant::now();
            tree.neighbor_lists(0.5, radius).run(&mut lists).map(|()| start.elapsed().as_secs_f64())
        };
        let times = [make(&trees[0])?, make(&trees[1])?];
        ratios.push(times[1] / times[0]);
    }
    println!("  lists of all within the radius: {:.2} times", median(ratios));
    for order in ["random", "Morton"] {
        if order == "Morton" {
            let hull = open.iter().fold((open[0], open[0]), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
            queries.sort_by_key(|(q, _)| morton(*q, hull));
        }
        print!("  {order}:");
        for k in ASKED {
            let (mut least, mut ratios) = ([f64::INFINITY; 2], Vec::new());
            for turn in (0..ROUNDS).flat_map(|_| queries.chunks(TURN)) {
                let mut time = |tree| nanoseconds(|| run_query(tree, turn, k, radius, &mut buffer)) / TURN as f64;
                let times = [time(&trees[0]), time(&trees[1])];
                ratios.push(times[1] / times[0]);
                least = [least[0].min(times[0]), least[1].min(times[1])];
            }
            let what = if k == 0 { "radius".into() } else { format!("k={k}") };
            print!("  {what} {:.0} {:.0} {:.2}", least[0], least[1], median(ratios));
        }
        println!();
    }
    Ok(())
}

#[derive(Parser)]
#[command(about = "What f64 points cost, beside the same set in f32")]
struct Args {
    /// Numbers of points.
    #[arg(long, value_delimiter = ',', default_values_t = [100_000, 1_000_000])]
    points: Vec<usize>,
    /// Only the rows with this in their names.
    #[arg(long, default_value = "")]
    rows: String,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args = Args::parse();
    for count in args.points {
        for scene in SCENES.into_iter().filter(|scene| scene.contains(&args.rows)) {
            for moving in [false, true] {
                compare(scene, count, moving)?;
            }
        }
    }
    Ok(())
}
