//! Prints the tables that compare neighbour queries with kiddo, interleaved in one run, on one thread.
//!
//! `cargo bench --bench neighbor_tables -- static moving active --points 1000000`
//!
//! Times are medians over interleaved repetitions, in nanoseconds per query; only their ratios are meaningful on
//! another machine. kiddo is measured in two configurations (its default, arena leaves, and flat leaves) and the faster
//! one counts for each cell; build with `RUSTFLAGS=-Ctarget-cpu=native` to give it the widest instructions that stable
//! Rust offers. Its `simd` feature needs a nightly compiler and is not measured.

use clap::{Parser, ValueEnum};
use kiddo::SquaredEuclidean;
use kiddo::leaf_strategy::FlatVec;
use kiddo::stem_strategy::Eytzinger;
use mbkd::glam::{DMat3, DVec3, Vec3};
use mbkd::{MovingPoint, NeighborBuffer, PointLayerKind, PointLayerStatistics, PointParams};
use mbkd::{PointStructure, PointTree, SimdLevel, TimeInterval};
use mbkd_evidence::options;
use mbkd_evidence::point_sets::{morton, on_surfaces};
use mbkd_evidence::timing::{self, on_one_thread, wall_seconds};
use mbkd_scenes::Random;
use std::hint::black_box;
use std::num::NonZero;

type Arena = kiddo::ImmutableKdTree<f32, 3>;
type Flat = kiddo::KdTree<f32, u32, Eytzinger, FlatVec<f32, u32, 3, 32>, 3, 32>;

#[derive(Parser)]
#[command(about = "Neighbour queries against kiddo, in tables")]
struct Args {
    /// The tables to print; all by default.
    #[arg(value_enum)]
    tables: Vec<Table>,
    /// Numbers of points.
    #[arg(long, value_delimiter = ',', default_values_t = [100_000, 1_000_000], value_parser = at_least::<100>)]
    points: Vec<usize>,
    /// Queries per repetition.
    #[arg(long, default_value_t = 100_000, value_parser = at_least::<100>)]
    queries: usize,
    /// Repetitions; the median is reported.
    #[arg(long, default_value_t = 5, value_parser = at_least::<1>)]
    repeat: usize,
    /// Measure every forced structure in the moving tables and in that of active intervals, not just the automatic choice, and
    /// compare it with the best.
    #[arg(long)]
    structures: bool,
    /// Only the rows of the moving table whose names contain this.
    #[arg(long, default_value = "")]
    rows: String,
}

/// The tables.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Table {
    /// Static points
    Static,
    /// Moving points
    Moving,
    /// Points with short active intervals
    Active,
    /// The costs of nodes, blocks and memory: fits the cost model by which structures are chosen (only if named)
    Costs,
    /// Times of builds relative to static ones, of the rows of the moving table and other motion (only if named)
    Builds,
}

/// A sufficiently large number: with fewer points or queries there is nothing to measure.
fn at_least<const LEAST: usize>(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n >= LEAST).ok_or_else(|| format!("a whole number, at least {LEAST}"))
}

/// Medians of interleaved times, in nanoseconds per query.
fn race(repeat: usize, count: usize, contestants: &mut [&mut dyn FnMut()]) -> Vec<f64> {
    let times = timing::race(wall_seconds, repeat, contestants);
    times.iter().map(|times| times.median * 1e9 / count as f64).collect()
}

/// The radius around points of a set that holds about `aim` others on average.
fn radius_for(tree: &PointTree, at: &[(Vec3, f32)], aim: usize) -> f32 {
    let (mut buffer, mut sum) = (NeighborBuffer::new(), 0.0);
    for (q, t) in at.iter().take(300) {
        sum += tree.query(*q, *t).nearest_n_into(aim, &mut buffer).last().map_or(0.0, |n| f64::from(n.distance()));
    }
    (sum / at.len().min(300) as f64) as f32
}

fn k_nearest(tree: &PointTree, at: &[(Vec3, f32)], k: usize, buffer: &mut NeighborBuffer) {
    for (q, t) in at {
        black_box(if k == 1 {
            tree.query(*q, *t).nearest().map_or(0, |n| n.id)
        } else {
            tree.query(*q, *t).nearest_n_into(k, buffer).first().map_or(0, |n| n.id)
        });
    }
}

fn in_radius(tree: &PointTree, at: &[(Vec3, f32)], radius: f32, buffer: &mut NeighborBuffer) {
    for (q, t) in at {
        black_box(tree.query(*q, *t).radius(radius).collect_into(buffer).len());
    }
}

macro_rules! kiddo_queries {
    ($tree:expr, $at:expr, $k:expr, $radius:expr) => {
        for (q, _) in $at {
            let place = q.to_array();
            let query = $tree.query(&place);
            match $k {
                0 => {
                    black_box(query.within::<SquaredEuclidean<f32>>($radius * $radius).unsorted().execute().len());
                }
                1 => {
                    black_box(query.nearest_one::<SquaredEuclidean<f32>>().execute().item);
                }
                k => {
                    black_box(query.nearest_n::<SquaredEuclidean<f32>>(NonZero::new(k).unwrap()).execute()[0].item);
                }
            }
        }
    };
}

fn static_tables(args: &Args) {
    let params = PointParams::default();
    println!("\nStatic points: ns per query, ours / kiddo's best = ratio (target)");
    for &n in &args.points {
        for set in ["uniform", "surface"] {
            let mut rng = Random(1);
            let mut point = || if set == "uniform" { rng.in_cube() } else { on_surfaces(&mut rng) };
            let points: Vec<Vec3> = (0..n).map(|_| point()).collect();
            let arrays: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
            // On and near the points, as in a gather.
            let mut at: Vec<(Vec3, f32)> = (0..args.queries).map(|_| (point(), 0.0)).collect();
            let build = race(
                // Small ones often: the first builds of a process also fault in its memory.
                (3_000_000 / n).clamp(3, 15),
                n,
                &mut [
                    &mut || drop(black_box(PointTree::build(&points, &params).unwrap())),
                    &mut || drop(black_box(Arena::new_from_slice(&arrays).unwrap())),
                    &mut || drop(black_box(Flat::new_from_slice(&arrays).unwrap())),
                ],
            );
            let tree = PointTree::build(&points, &params).unwrap();
            let (arena, flat) = (Arena::new_from_slice(&arrays).unwrap(), Flat::new_from_slice(&arrays).unwrap());
            let ms = |time: f64| time * n as f64 / 1e6;
            println!(
                "{n} {set}: build {:.1} ms, kiddo {:.1}/{:.1} ms = {:.2}; {:.1} bytes per point",
                ms(build[0]),
                ms(build[1]),
                ms(build[2]),
                build[1].min(build[2]) / build[0],
                tree.statistics().bytes() as f64 / n as f64
            );
            let radius = radius_for(&tree, &at, 40);
            let row = |label: &str, at: &[(Vec3, f32)], wanted: &[(usize, f64)]| {
                print!("  {label:7}");
                let mut peers = Vec::new();
                for &(k, wanted) in wanted {
                    let (arena, flat) = (&arena, &flat);
                    let by_arena = Box::new(move || kiddo_queries!(arena, at, k, radius));
                    let by_flat = Box::new(move || kiddo_queries!(flat, at, k, radius));
                    let times = race_trees(args.repeat, &[&tree], at, k, radius, vec![by_arena, by_flat]);
                    let peer = times[1].min(times[2]);
                    print!("  {} {:.0}/{peer:.0} = {:.2} ({wanted})", name(k), times[0], peer / times[0]);
                    peers.push(peer);
                }
                println!();
                peers
            };
            let peers = row("random", &at, &WANTED);
            batches(&tree, &at, &peers, args.repeat);
            at.sort_by_key(|(q, _)| morton(*q));
            row("morton", &at, &WANTED);
            // Beyond a corner of the set. Few queries: kiddo takes a hundred times as long for them.
            let far: Vec<(Vec3, f32)> =
                at.iter().step_by(200).map(|(q, t)| (*q * 3.0 + Vec3::new(4.0, -2.0, 1.0), *t)).collect();
            row("far", &far, &WANTED[..4]);
        }
    }
}

/// Numbers of neighbours (0, the last: all within a radius) and required ratios.
const WANTED: [(usize, f64); 5] = [(1, 2.0), (8, 3.0), (32, 3.5), (64, 4.5), (0, 3.5)];

fn name(k: usize) -> String {
    if k == 0 { "radius".to_string() } else { format!("k={k}") }
}

/// A row for callers that have all their queries at once: a batch on one thread, which sorts queries and copies
/// results, against the peer's single queries in the same random order. (Not for radius queries: a batch sorts its
/// results, the others do not.)
fn batches(tree: &PointTree, at: &[(Vec3, f32)], peers: &[f64], repeat: usize) {
    print!("  batch  ");
    for ((k, _), peer) in WANTED.into_iter().zip(peers).filter(|((k, _), _)| *k > 0) {
        let mut run = || match k {
            1 => drop(black_box(tree.nearest_batch(at))),
            k => drop(black_box(tree.nearest_n_batch(at, k))),
        };
        let time = race(repeat, at.len(), &mut [&mut run])[0];
        print!("  {} {time:.0}/{peer:.0} = {:.2}", name(k), peer / time);
    }
    println!();
}

/// The rows of the moving table.
const MOVING_ROWS: [&str; 9] = [
    "two streams",
    "coherent 10%",
    "random 0.5x",
    "random 1x",
    "random 5x",
    "random 20x",
    "5% fast",
    "5% fast, rest slow",
    "clustered",
];

/// Rows of the table of builds only.
const BUILD_ROWS: [&str; 3] = ["explosion", "wave", "1% fast"];

/// The points of a row of the tables of moving points and of builds, by the row's name.
fn moving_set(row: &str, n: usize) -> Vec<MovingPoint> {
    let mut rng = Random(7);
    let spacing = 1.0 / (n as f32).cbrt();
    (0..n)
        .map(|_| {
            let p = if row == "clustered" { on_surfaces(&mut rng) } else { rng.in_cube() };
            let random = rng.vec() * spacing;
            let displacement = match row {
                "coherent 10%" => Vec3::new(p.y - 0.5, 0.5 - p.x, 0.3 * p.z) * 0.14,
                "random 0.5x" => random * 0.5,
                "random 1x" => random,
                "random 5x" => random * 5.0,
                "random 20x" => random * 20.0,
                "5% fast" => {
                    if rng.unit() < 0.05 {
                        random * 20.0
                    } else {
                        Vec3::ZERO
                    }
                }
                "5% fast, rest slow" => random * if rng.unit() < 0.05 { 20.0 } else { 0.1 },
                "clustered" => random * 0.5,
                "explosion" => (p - 0.5) * 0.3,
                "two streams" => Vec3::X * if rng.unit() < 0.5 { 0.1 } else { -0.1 },
                "wave" => Vec3::Y * (p.x * 12.0).sin() * 0.1,
                "1% fast" => random * if rng.unit() < 0.01 { 20.0 } else { 0.1 },
                _ => unreachable!("{row}"),
            };
            MovingPoint::new(p, p + displacement)
        })
        .collect()
}

/// Queries among snapshots, each in that of the nearest time.
fn kiddo_at_times(snapshots: &[Arena; 16], at: &[(Vec3, f32)], k: usize, radius: f32) {
    for pair in at {
        kiddo_queries!(snapshots[((pair.1 * 16.0) as usize).min(15)], core::slice::from_ref(pair), k, radius);
    }
}

fn moving_tables(args: &Args) {
    let n = *args.points.last().unwrap();
    println!("\nMoving points, {n} of them, every query its own time: ns per query");
    for row in MOVING_ROWS.into_iter().filter(|row| row.contains(&args.rows)) {
        let points = moving_set(row, n);
        let mut rng = Random(99);
        let mut at: Vec<(Vec3, f32)> = (0..args.queries)
            .map(|i| {
                let (p, t) = (&points[i * 7919 % n], rng.unit());
                (p.open.lerp(p.close, t) + rng.vec() * 0.3 / (n as f32).cbrt(), t)
            })
            .collect();
        at.sort_by_key(|(q, _)| morton(*q));
        let still: Vec<Vec3> = points.iter().map(|p| p.open.lerp(p.close, 0.5)).collect();
        let still = PointTree::build(&still, &PointParams::default()).unwrap();
        let snapshots: [Arena; 16] = core::array::from_fn(|i| {
            let t = (i as f32 + 0.5) / 16.0;
            let at: Vec<[f32; 3]> = points.iter().map(|p| p.open.lerp(p.close, t).to_array()).collect();
            Arena::new_from_slice(&at).unwrap()
        });
        use PointStructure::{Automatic, Kd, Linear, TimeSlices};
        let forced = [Linear, TimeSlices(2), TimeSlices(4), TimeSlices(8), TimeSlices(16)];
        let structures = [&[Automatic][..], if args.structures { &forced } else { &[] }].concat();
        let trees = built(&points, &structures);
        let radius = radius_for(&trees[0].0, &at, 40);
        let mut table = vec![String::new(); trees.len()];
        let mut rivals = String::new();
        for k in [8, 0] {
            let all: Vec<&PointTree> = trees.iter().map(|t| &t.0).chain([&still]).collect();
            let kiddo = Box::new(|| kiddo_at_times(&snapshots, &at, k, radius));
            let times = race_trees(args.repeat, &all, &at, k, radius, vec![kiddo]);
            let (own, peer, name) = (times[trees.len()], times[trees.len() + 1], name(k));
            for (text, time) in table.iter_mut().zip(&times) {
                *text += &format!("  {name} {time:.0} ({:.2} x static, snapshots {:.2})", time / own, peer / time);
            }
            let best = times[1..trees.len()].iter().copied().fold(f64::INFINITY, f64::min);
            rivals += &format!("  {name}: own static {own:.0}, snapshots {peer:.0}");
            if args.structures {
                rivals += &format!(", automatic / best forced {:.2}", times[0] / best);
            }
        }
        println!("{row}:{rivals}");
        for (((tree, build), structure), text) in trees.iter().zip(&structures).zip(&table) {
            let bytes = tree.statistics().bytes() as f64 / n as f64;
            println!("  {structure:?}:{text}; build {build:.1} x static, {bytes:.0} bytes per point");
        }
        for layer in &trees[0].0.statistics().layers {
            println!("      {:?}, {} points: {}", layer.kind, layer.points, layer.why);
        }
        if args.structures {
            // Far slower than the others, so measured separately with a tenth of the queries.
            let some = &at[..at.len() / 10];
            drop(trees);
            let kd = built(&points, &[Kd]).remove(0).0;
            let kiddo = Box::new(|| kiddo_at_times(&snapshots, some, 8, radius));
            let times = race_trees(1, &[&kd, &still], some, 8, radius, vec![kiddo]);
            println!(
                "  Kd:  k=8 {:.0} ({:.2} x static, snapshots {:.2})",
                times[0],
                times[0] / times[1],
                times[2] / times[0]
            );
        }
    }
}

/// Builds of the chosen structure, and of the same forced where it is one for all points, relative to static ones.
fn build_tables(args: &Args) {
    for &n in &args.points {
        println!("\nBuilds of {n} points that move / that are static");
        for row in MOVING_ROWS.into_iter().chain(BUILD_ROWS).filter(|row| row.contains(&args.rows)) {
            let points = moving_set(row, n);
            let still: Vec<Vec3> = points.iter().map(|p| p.open.lerp(p.close, 0.5)).collect();
            let layers = PointTree::build(&points, &PointParams::default()).unwrap().statistics().layers.clone();
            let forced = match layers[..] {
                [PointLayerStatistics { kind: PointLayerKind::Linear { time_slices }, .. }] => time_slices,
                _ => 1,
            };
            let build = |structure| {
                let params = PointParams { structure, ..PointParams::default() };
                drop(black_box(PointTree::build(&points, &params).unwrap()));
            };
            let times = race(
                args.repeat,
                1,
                &mut [
                    &mut || drop(black_box(PointTree::build(&still, &PointParams::default()).unwrap())),
                    &mut || build(PointStructure::Automatic),
                    &mut || build(PointStructure::TimeSlices(forced)),
                ],
            );
            println!(
                "{row:18} static {:7.2} ms, automatic {:5.2}, {forced} time slices forced {:5.2}: {}",
                times[0] / 1e6,
                times[1] / times[0],
                times[2] / times[0],
                layers
                    .iter()
                    .map(|layer| format!("{:?} of {}", layer.kind, layer.points))
                    .collect::<Vec<_>>()
                    .join(", ")
            );
            if args.structures {
                layers.iter().for_each(|layer| println!("      {}", layer.why));
            }
        }
    }
}

/// The trees of all structures, and their build times relative to that of the same points as a static tree: medians of
/// three builds in alternation.
fn built(points: &[MovingPoint], structures: &[PointStructure]) -> Vec<(PointTree, f64)> {
    let still: Vec<Vec3> = points.iter().map(|p| p.open.lerp(p.close, 0.5)).collect();
    let build = |&structure: &PointStructure| {
        let params = PointParams { structure, ..PointParams::default() };
        let times = race(
            3,
            1,
            &mut [&mut || drop(black_box(PointTree::build(points, &params).unwrap())), &mut || {
                drop(black_box(PointTree::build(&still, &PointParams::default()).unwrap()))
            }],
        );
        (PointTree::build(points, &params).unwrap(), times[0] / times[1])
    };
    structures.iter().map(build).collect()
}

/// Times of all trees and, last, of rivals. `k` = 0: within the radius.
fn race_trees<'a>(
    repeat: usize,
    trees: &[&'a PointTree],
    at: &'a [(Vec3, f32)],
    k: usize,
    radius: f32,
    rivals: Vec<Box<dyn FnMut() + 'a>>,
) -> Vec<f64> {
    let run = |&tree: &&'a PointTree| -> Box<dyn FnMut() + 'a> {
        let mut buffer = NeighborBuffer::new();
        Box::new(move || match k {
            0 => in_radius(tree, at, radius, &mut buffer),
            k => k_nearest(tree, at, k, &mut buffer),
        })
    };
    let mut runs: Vec<_> = trees.iter().map(run).chain(rivals).collect();
    race(repeat, at.len(), &mut runs.iter_mut().map(|run| run.as_mut() as &mut dyn FnMut()).collect::<Vec<_>>())
}

fn active_tables(args: &Args) {
    let n = *args.points.last().unwrap();
    println!("\nPoints that exist for 2-10 % of the shutter, {n} of them: ns per query");
    let mut rng = Random(5);
    let points: Vec<MovingPoint> = (0..n)
        .map(|_| {
            let (begin, length) = (rng.unit() * 0.98, 0.02 + 0.08 * rng.unit());
            let active = TimeInterval::new(begin, (begin + length).min(1.0)).unwrap();
            MovingPoint::fixed(rng.in_cube()).with_active(active)
        })
        .collect();
    let all: Vec<Vec3> = points.iter().map(|p| p.open).collect();
    let all = PointTree::build(&all, &PointParams::default()).unwrap();
    let mut at: Vec<(Vec3, f32)> = (0..args.queries).map(|_| (rng.in_cube(), rng.unit())).collect();
    at.sort_by_key(|(q, _)| morton(*q));
    use PointStructure::{Automatic, Linear, TimeSlices};
    let forced = [Linear, TimeSlices(4), TimeSlices(8), TimeSlices(16), TimeSlices(32)];
    let structures = [&[Automatic][..], if args.structures { &forced } else { &[] }].concat();
    let trees = built(&points, &structures);
    let radius = radius_for(&trees[0].0, &at, 40);
    let mut table = vec![String::new(); trees.len()];
    for k in [8, 0] {
        let mut buffer = NeighborBuffer::new();
        let filtered = || {
            for (q, t) in &at {
                let query = all.query(*q, *t).filter(|id| points[id as usize].active.contains(*t));
                black_box(match k {
                    0 => query.radius(radius).collect_into(&mut buffer).len(),
                    k => query.nearest_n_into(k, &mut buffer).len(),
                });
            }
        };
        let every: Vec<&PointTree> = trees.iter().map(|t| &t.0).collect();
        let (times, name) = (race_trees(args.repeat, &every, &at, k, radius, vec![Box::new(filtered)]), name(k));
        for (text, time) in table.iter_mut().zip(&times) {
            *text += &format!("  {name} {time:.0} (filtering {:.2})", times[trees.len()] / time);
        }
        let best = times[1..trees.len()].iter().copied().fold(f64::INFINITY, f64::min);
        if args.structures {
            println!("  {name}: automatic / best forced {:.2}", times[0] / best);
        }
    }
    for (((tree, _), structure), text) in trees.iter().zip(&structures).zip(&table) {
        println!("  {structure:?}:{text}; {:.0} bytes per point", tree.statistics().bytes() as f64 / n as f64);
    }
    println!("      {}", trees[0].0.statistics().layers.last().map_or("", |l| &l.why));
}

/// Fits the time of searches for eight neighbours as a function of visited nodes and blocks and of the bytes of the
/// tree, for searches in spatial order and in random order, over forced structures of sets of all the sizes.
fn fit_costs(args: &Args) {
    // Nodes, blocks, bytes and time.
    let mut rows: Vec<[f64; 4]> = Vec::new();
    for &n in &args.points {
        for row in ["coherent 10%", "random 0.5x", "random 1x", "random 5x", "random 20x", "clustered"] {
            let points = moving_set(row, n);
            let mut rng = Random(99);
            let place = |(p, t): (&MovingPoint, f32)| (p.open.lerp(p.close, t), t);
            let at: Vec<_> = (0..args.queries).map(|i| place((&points[i * 7919 % n], rng.unit()))).collect();
            let mut ordered = at.clone();
            ordered.sort_by_key(|(q, _)| morton(*q));
            for slices in [1, 2, 4, 8, 16] {
                let (structure, mut buffer) = (PointStructure::TimeSlices(slices), NeighborBuffer::new());
                let tree = PointTree::build(&points, &PointParams { structure, ..PointParams::default() }).unwrap();
                let some = || at.iter().step_by(10);
                let work = some().map(|(q, t)| tree.query(*q, *t).work(8)).map(|w| [w.nodes as f64, w.blocks as f64]);
                let [nodes, blocks] = work.fold([0.0; 2], |sum, w| [sum[0] + w[0], sum[1] + w[1]]);
                let count = some().count() as f64;
                // Structures that no chooser would take are not relevant for the fit.
                if nodes > 50.0 * count {
                    continue;
                }
                for at in [&at, &ordered] {
                    let time = race(args.repeat, at.len(), &mut [&mut || k_nearest(&tree, at, 8, &mut buffer)])[0];
                    rows.push([nodes / count, blocks / count, 32.0 * (n * slices) as f64, time]);
                }
            }
        }
    }
    println!(
        "\nFitted costs from {} structures: bytes at which half is cold; ns per node; block and cold memory in nodes; error",
        rows.len()
    );
    for half_cold in [1e7, 2e7, 5e7, 1e8, 2e8, 5e8, 1e9] {
        let terms =
            |&[nodes, blocks, bytes, time]: &[f64; 4]| DVec3::new(nodes, blocks, bytes / (bytes + half_cold)) / time;
        // Least squares of relative errors.
        let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
        let (squares, sum) = rows.iter().map(terms).fold((DMat3::ZERO, DVec3::ZERO), |s, v| (s.0 + outer(v), s.1 + v));
        let cost = squares.inverse() * sum;
        let errors = rows.iter().map(|row| (terms(row).dot(cost) - 1.0).powi(2)).sum::<f64>();
        let [node, block, cold] = cost.to_array();
        let error = (errors / rows.len() as f64).sqrt();
        println!("  {half_cold:5.0e}: {node:.1}; {:.2} {:.0}; {error:.3}", block / node, cold / node);
    }
}

fn main() {
    let args: Args = options();
    println!(
        "queries on {}; compiled with avx2: {}, avx512f: {}",
        SimdLevel::best(),
        cfg!(target_feature = "avx2"),
        cfg!(target_feature = "avx512f")
    );
    let wants = |table: Table| args.tables.is_empty() || args.tables.contains(&table);
    // One thread for everything, builds included.
    on_one_thread(|| {
        if wants(Table::Static) {
            static_tables(&args);
        }
        if wants(Table::Moving) {
            moving_tables(&args);
        }
        if wants(Table::Active) {
            active_tables(&args);
        }
        if args.tables.contains(&Table::Builds) {
            build_tables(&args);
        }
        if args.tables.contains(&Table::Costs) {
            fit_costs(&args);
        }
    });
}
