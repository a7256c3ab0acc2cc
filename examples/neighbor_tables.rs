//! Prints the tables that compare neighbour queries with kiddo, side by side in one run, one thread.
//!
//! `cargo run --release --example neighbor_tables -- static moving lives --points 1000000`
//!
//! Times are medians over interleaved repetitions, in nanoseconds per query; only their ratios mean
//! something on another machine. kiddo is measured in two configurations (its default, arena leaves,
//! and flat leaves) and the faster one counts for each cell; build with `RUSTFLAGS=-Ctarget-cpu=native`
//! to give it the widest instructions that stable Rust offers. Its `simd` feature needs a nightly
//! compiler and is not part of this.

use clap::Parser;
use kiddo::SquaredEuclidean;
use kiddo::leaf_strategy::FlatVec;
use kiddo::stem_strategy::Eytzinger;
use mbkd::glam::Vec3;
use mbkd::{MovingPoint, NeighborBuffer, PointParams, PointStructure, PointTree, SimdLevel, TimeInterval};
use std::hint::black_box;
use std::num::NonZero;
use std::time::Instant;

type Arena = kiddo::ImmutableKdTree<f32, 3>;
type Flat = kiddo::KdTree<f32, u32, Eytzinger, FlatVec<f32, u32, 3, 32>, 3, 32>;

#[derive(Parser)]
#[command(about = "Neighbour queries against kiddo, in tables")]
struct Args {
    /// Which tables: static, moving, lives (default: all).
    tables: Vec<String>,
    /// Numbers of points.
    #[arg(long, value_delimiter = ',', default_values_t = [100_000, 1_000_000])]
    points: Vec<usize>,
    /// Queries per repetition.
    #[arg(long, default_value_t = 20_000)]
    queries: usize,
    /// Repetitions, of which the median counts.
    #[arg(long, default_value_t = 5)]
    repeat: usize,
    /// Show every forced structure in the moving tables, not just the automatic choice.
    #[arg(long)]
    structures: bool,
}

/// A small generator of numbers, so that every run sees the same points.
struct Rng(u64);

impl Rng {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }
    fn vec(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }
    fn signed(&mut self) -> Vec3 {
        self.vec() * 2.0 - 1.0
    }
    /// On the surfaces of forty spheres of very different size.
    fn surface(&mut self) -> Vec3 {
        let which = (self.unit() * 40.0) as u64;
        let mut of = Rng(which.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0xabcdef);
        of.unit();
        let (centre, radius) = (of.vec(), 0.01 + 0.2 * of.unit().powi(3));
        loop {
            let p = self.signed();
            if (0.01..1.0).contains(&p.length_squared()) {
                return centre + p.normalize() * radius;
            }
        }
    }
}

fn morton(p: Vec3) -> u64 {
    let spread = |x: f32| {
        let mut v = ((x + 1.0) * 300.0).clamp(0.0, 1023.0) as u64;
        v = (v | v << 16) & 0x0300_00ff;
        v = (v | v << 8) & 0x0300_f00f;
        v = (v | v << 4) & 0x030c_30c3;
        (v | v << 2) & 0x0924_9249
    };
    spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2
}

/// Medians of the interleaved times of all contestants, in nanoseconds per query.
fn race(repeat: usize, count: usize, contestants: &mut [&mut dyn FnMut()]) -> Vec<f64> {
    let mut times = vec![Vec::new(); contestants.len()];
    for _ in 0..repeat {
        for (times, run) in times.iter_mut().zip(contestants.iter_mut()) {
            let start = Instant::now();
            run();
            times.push(start.elapsed().as_nanos() as f64 / count as f64);
        }
    }
    times
        .into_iter()
        .map(|mut t| {
            t.sort_by(f64::total_cmp);
            t[t.len() / 2]
        })
        .collect()
}

/// Radius around points of a set that holds about `aim` others on average.
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
            tree.query(*q, *t).nearest_n_into(k, buffer)[0].id
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
    println!("\nStatic points: ns per query, ours / kiddo's best = ratio (wanted)");
    for &n in &args.points {
        for set in ["uniform", "surface"] {
            let mut rng = Rng(1);
            let mut point = || if set == "uniform" { rng.vec() } else { rng.surface() };
            let points: Vec<Vec3> = (0..n).map(|_| point()).collect();
            let arrays: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
            // On and near the points: where the queries of a gather are.
            let mut at: Vec<(Vec3, f32)> = (0..args.queries).map(|_| (point(), 0.0)).collect();
            let build = race(
                args.repeat.min(3),
                1_000_000,
                &mut [
                    &mut || drop(black_box(PointTree::build(&points, &params).unwrap())),
                    &mut || drop(black_box(Arena::new_from_slice(&arrays).unwrap())),
                    &mut || drop(black_box(Flat::new_from_slice(&arrays).unwrap())),
                ],
            );
            let tree = PointTree::build(&points, &params).unwrap();
            let (arena, flat) = (Arena::new_from_slice(&arrays).unwrap(), Flat::new_from_slice(&arrays).unwrap());
            println!(
                "{n} {set}: build {:.1} ms, kiddo {:.1}/{:.1} ms = {:.2}; {:.1} bytes per point",
                build[0],
                build[1],
                build[2],
                build[1].min(build[2]) / build[0],
                tree.stats().bytes() as f64 / n as f64
            );
            let radius = radius_for(&tree, &at, 40);
            for order in ["random", "morton"] {
                if order == "morton" {
                    at.sort_by_key(|(q, _)| morton(*q));
                }
                print!("  {order:7}");
                for (k, wanted) in [(1, 1.4), (8, 2.5), (32, 3.0), (64, 3.0), (0, 3.0)] {
                    let mut buffer = NeighborBuffer::new();
                    let times = race(
                        args.repeat,
                        at.len(),
                        &mut [
                            &mut || match k {
                                0 => in_radius(&tree, &at, radius, &mut buffer),
                                k => k_nearest(&tree, &at, k, &mut buffer),
                            },
                            &mut || kiddo_queries!(arena, &at, k, radius),
                            &mut || kiddo_queries!(flat, &at, k, radius),
                        ],
                    );
                    let peer = times[1].min(times[2]);
                    let name = if k == 0 { "radius".to_string() } else { format!("k={k}") };
                    print!("  {name} {:.0}/{peer:.0} = {:.2} ({wanted})", times[0], peer / times[0]);
                }
                println!();
            }
        }
    }
}

/// The rows of the moving table: points and what they are called.
fn moving_set(row: &str, n: usize) -> Vec<MovingPoint> {
    let mut rng = Rng(7);
    let spacing = 1.0 / (n as f32).cbrt();
    (0..n)
        .map(|_| {
            let p = if row == "clustered" { rng.surface() } else { rng.vec() };
            let random = rng.signed() * spacing;
            let way = match row {
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
                _ => unreachable!("{row}"),
            };
            MovingPoint::new(p, p + way)
        })
        .collect()
}

fn moving_tables(args: &Args) {
    let n = *args.points.last().unwrap();
    println!("\nMoving points, {n} of them, every query its own time: ns per query");
    let rows = [
        "coherent 10%",
        "random 0.5x",
        "random 1x",
        "random 5x",
        "random 20x",
        "5% fast",
        "5% fast, rest slow",
        "clustered",
    ];
    for row in rows {
        let points = moving_set(row, n);
        let mut rng = Rng(99);
        let mut at: Vec<(Vec3, f32)> = (0..args.queries)
            .map(|i| {
                let (p, t) = (&points[i * 7919 % n], rng.unit());
                (p.open.lerp(p.close, t) + rng.signed() * 0.3 / (n as f32).cbrt(), t)
            })
            .collect();
        at.sort_by_key(|(q, _)| morton(*q));
        let still: Vec<Vec3> = points.iter().map(|p| p.open.lerp(p.close, 0.5)).collect();
        let still = PointTree::build(&still, &PointParams::default()).unwrap();
        let snapshots: Vec<Arena> = (0..16)
            .map(|i| {
                let t = (i as f32 + 0.5) / 16.0;
                let at: Vec<[f32; 3]> = points.iter().map(|p| p.open.lerp(p.close, t).to_array()).collect();
                Arena::new_from_slice(&at).unwrap()
            })
            .collect();
        let mut structures = vec![PointStructure::Automatic];
        if args.structures {
            structures.extend([
                PointStructure::Linear,
                PointStructure::Slabs(2),
                PointStructure::Slabs(4),
                PointStructure::Slabs(8),
                PointStructure::CutFast,
                PointStructure::Mbkd,
            ]);
        }
        println!("{row}");
        for structure in structures {
            let params = PointParams { structure, ..PointParams::default() };
            let start = Instant::now();
            let tree = PointTree::build(&points, &params).unwrap();
            let build = start.elapsed().as_secs_f64() * 1e3;
            let radius = radius_for(&tree, &at, 40);
            let mut text = String::new();
            for k in [8, 0] {
                let mut buffers = [NeighborBuffer::new(), NeighborBuffer::new()];
                let [a, b] = &mut buffers;
                let times = race(
                    args.repeat,
                    at.len(),
                    &mut [
                        &mut || match k {
                            0 => in_radius(&tree, &at, radius, a),
                            k => k_nearest(&tree, &at, k, a),
                        },
                        &mut || match k {
                            0 => in_radius(&still, &at, radius, b),
                            k => k_nearest(&still, &at, k, b),
                        },
                        &mut || {
                            for pair in &at {
                                let snapshot = &snapshots[((pair.1 * 16.0) as usize).min(15)];
                                kiddo_queries!(snapshot, core::slice::from_ref(pair), k, radius);
                            }
                        },
                    ],
                );
                let name = if k == 0 { "radius" } else { "k=8" };
                text += &format!(
                    "  {name} {:.0}, own static {:.0} ({:.2}x), snapshots {:.0} ({:.2}x)",
                    times[0],
                    times[1],
                    times[0] / times[1],
                    times[2],
                    times[2] / times[0]
                );
            }
            let bytes = tree.stats().bytes() as f64 / n as f64;
            println!("  {structure:?}:{text}; build {build:.0} ms, {bytes:.0} bytes per point");
            for layer in &tree.stats().layers {
                if structure == PointStructure::Automatic {
                    println!("      {:?}, {} points: {}", layer.kind, layer.points, layer.why);
                }
            }
        }
    }
}

fn lives_tables(args: &Args) {
    let n = *args.points.last().unwrap();
    println!("\nPoints that live for 2-10 % of the shutter, {n} of them: ns per query");
    let mut rng = Rng(5);
    let points: Vec<MovingPoint> = (0..n)
        .map(|_| {
            let (begin, length) = (rng.unit() * 0.98, 0.02 + 0.08 * rng.unit());
            let alive = TimeInterval::new(begin, (begin + length).min(1.0)).unwrap();
            MovingPoint::fixed(rng.vec()).alive(alive)
        })
        .collect();
    let all: Vec<Vec3> = points.iter().map(|p| p.open).collect();
    let all = PointTree::build(&all, &PointParams::default()).unwrap();
    let mut at: Vec<(Vec3, f32)> = (0..args.queries).map(|_| (rng.vec(), rng.unit())).collect();
    at.sort_by_key(|(q, _)| morton(*q));
    let mut structures = vec![PointStructure::Automatic];
    if args.structures {
        structures.extend([PointStructure::Linear, PointStructure::LifeLevels(2), PointStructure::LifeLevels(3)]);
        structures.extend([4, 8, 16, 32].map(PointStructure::Slabs));
    }
    for structure in structures {
        let tree = PointTree::build(&points, &PointParams { structure, ..PointParams::default() }).unwrap();
        let radius = radius_for(&tree, &at, 40);
        print!("  {structure:?}:");
        for k in [8usize, 0] {
            let [mut a, mut b] = [NeighborBuffer::new(), NeighborBuffer::new()];
            let times = race(
                args.repeat,
                at.len(),
                &mut [
                    &mut || match k {
                        0 => in_radius(&tree, &at, radius, &mut a),
                        k => k_nearest(&tree, &at, k, &mut a),
                    },
                    &mut || {
                        for (q, t) in &at {
                            let query = all.query(*q, *t).filter(|id| points[id as usize].alive.contains(*t));
                            black_box(match k {
                                0 => query.radius(radius).collect_into(&mut b).len(),
                                k => query.nearest_n_into(k, &mut b).len(),
                            });
                        }
                    },
                ],
            );
            let name = if k == 0 { "radius" } else { "k=8" };
            print!("  {name} {:.0}, filtered static {:.0} = {:.2}x", times[0], times[1], times[1] / times[0]);
        }
        println!("; {:.0} bytes per point", tree.stats().bytes() as f64 / n as f64);
        if structure == PointStructure::Automatic {
            println!("      {}", tree.stats().layers.last().map_or("", |l| &l.why));
        }
    }
}

fn main() {
    let args = Args::parse();
    println!(
        "queries on {}; compiled with avx2: {}, avx512f: {}",
        SimdLevel::best(),
        cfg!(target_feature = "avx2"),
        cfg!(target_feature = "avx512f")
    );
    let wants = |table: &str| args.tables.is_empty() || args.tables.iter().any(|t| t == table);
    // One thread for everything, builds included.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    pool.install(|| {
        if wants("static") {
            static_tables(&args);
        }
        if wants("moving") {
            moving_tables(&args);
        }
        if wants("lives") {
            lives_tables(&args);
        }
    });
}
