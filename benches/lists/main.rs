//! Neighbour lists of whole sets, interleaved in one run, builds and output included: mbkd, linkcell, kiddo's tree
//! join, a plain grid of cells, and a grid of cells handwritten for AVX-512.
//!
//! `cargo bench --bench lists`, on one thread unless stated otherwise. Times are medians over interleaved repetitions,
//! in nanoseconds per particle; only their ratios are meaningful on another machine.

mod grids;

use clap::Parser;
use grids::{Grid, plain, vectors};
use kiddo::SquaredEuclidean;
use kiddo::batch::Executor;
use mbkd::glam::Vec3;
use mbkd::{
    Encounter, EncounterLists, MovingPoint, NeighborBuffer, NeighborLists, PointParams, PointStructure, PointTree,
    Radii, TimeInterval,
};
use mbkd_evidence::options;
use mbkd_evidence::point_sets::on_surfaces;
use mbkd_evidence::timing::{median, race, wall_seconds};
use mbkd_scenes::Random;
use std::hint::black_box;
use std::time::Instant;

#[derive(Parser)]
#[command(about = "Neighbour lists against other crates and grids of cells")]
struct Args {
    /// Number of particles.
    #[arg(long, default_value_t = 1_000_000)]
    points: usize,
    /// Neighbours of each.
    #[arg(long, default_value_t = 40)]
    neighbors: usize,
    /// Repetitions; the median is reported.
    #[arg(long, default_value_t = 5)]
    repeat: usize,
    /// Threads of the tables `threads` and `swept in parallel`.
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Only tables whose names contain this.
    #[arg(long, default_value = "")]
    only: String,
}

/// Around sixty centres, with density falling off as the inverse square of the distance, as in galaxies.
fn galaxy(random: &mut Random) -> Vec3 {
    let mut of = Random(random.below(60) as u64);
    of.in_cube() + random.direction() * (0.05 * random.unit() + 1e-4)
}

/// A timed closure and its name.
type Contestant<'a> = (&'a str, Box<dyn FnMut() + 'a>);

/// Prints the medians of times in turns, in nanoseconds per particle.
fn table(title: &str, args: &Args, count: usize, contestants: Vec<Contestant>) -> Vec<f64> {
    let (names, mut runs): (Vec<_>, Vec<_>) = contestants.into_iter().unzip();
    let times = race(wall_seconds, args.repeat, &mut runs);
    let times: Vec<f64> = times.iter().map(|times| times.median * 1e9 / count as f64).collect();
    println!("\n{title}");
    for (name, time) in names.iter().zip(&times) {
        println!("  {name:44} {time:8.1} ns  {:6.2} x", time / times[0]);
    }
    times
}

/// The radius within which particles of a sample have `neighbors` others on average.
fn radius(points: &[Vec3], neighbors: usize) -> f32 {
    let tree = PointTree::build(points, &PointParams::default()).unwrap();
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        let sample: Vec<_> = points.iter().step_by(points.len() / 500 + 1).collect();
        let found: usize = sample.iter().map(|p| tree.query(**p, 0.0).radius(middle).count() - 1).sum();
        if found < neighbors * sample.len() { low = middle } else { high = middle }
    }
    high
}

fn main() {
    let args: Args = options();
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let (one, several) = (pool(1), pool(args.threads));
    let wanted = |name: &str| name.contains(&args.only);
    one.install(|| {
        for (name, point) in [
            ("uniform", Random::in_cube as fn(&mut Random) -> Vec3),
            ("surfaces", on_surfaces as fn(&mut Random) -> Vec3),
            ("galaxies", galaxy as fn(&mut Random) -> Vec3),
        ] {
            if wanted(name) {
                all(&args, name, point);
            }
        }
        if wanted("radii") {
            radii(&args);
        }
        if wanted("swept") {
            swept(&args);
        }
        if wanted("skin") {
            skin(&args);
        }
        if wanted("bulk") {
            bulk(&args);
        }
        if wanted("growth") {
            growth(&args);
        }
    });
    if wanted("threads") {
        threads(&args, [&several, &one]);
    }
    if wanted("swept in parallel") {
        swept_threads(&args, [&several, &one]);
    }
}

/// Lists on one and on several threads.
fn threads(args: &Args, pools: [&rayon::ThreadPool; 2]) {
    let starts = uniform(args.points);
    let radius = radius(&starts, args.neighbors);
    let title = format!("{} threads, uniform, lists", args.threads);
    let (mut lists, mut more) = (NeighborLists::new(), NeighborLists::new());
    let run = |lists: &mut NeighborLists| ours(&starts, radius, lists);
    speed_up(&title, args, pools, [Box::new(|| run(&mut lists)), Box::new(|| run(&mut more))]);
}

/// Swept lists on one and on several threads.
fn swept_threads(args: &Args, pools: [&rayon::ThreadPool; 2]) {
    let starts = uniform(args.points);
    let (radius, points) = (radius(&starts, args.neighbors), moving(&starts));
    let title = format!("{} threads, uniform, swept lists", args.threads);
    let (mut lists, mut more) = (EncounterLists::new(), EncounterLists::new());
    let run = |lists: &mut EncounterLists| ours_swept(&points, radius, lists);
    speed_up(&title, args, pools, [Box::new(|| run(&mut lists)), Box::new(|| run(&mut more))]);
}

/// Uniform particles.
fn uniform(count: usize) -> Vec<Vec3> {
    let mut rng = Random(1);
    (0..count).map(|_| rng.in_cube()).collect()
}

/// The same work, with memory of its own, in the first pool and in the second, which has one thread.
fn speed_up(
    title: &str,
    args: &Args,
    [several, one]: [&rayon::ThreadPool; 2],
    work: [Box<dyn FnMut() + Send + '_>; 2],
) {
    let [mut first, mut second] = work;
    let contestants: Vec<Contestant> = vec![
        ("several threads", Box::new(|| several.install(&mut first))),
        ("one thread", Box::new(|| one.install(&mut second))),
    ];
    let times = table(title, args, args.points, contestants);
    println!("  speed-up {:.2}", times[1] / times[0]);
}

fn ours(points: &[Vec3], radius: f32, lists: &mut NeighborLists) {
    let tree = PointTree::build(points, &PointParams::default()).unwrap();
    tree.neighbor_lists(0.0, radius).run(lists).unwrap();
    black_box(lists.ids());
}

fn ours_swept(points: &[MovingPoint], radius: f32, lists: &mut EncounterLists) {
    let params = PointParams { structure: PointStructure::Linear, ..PointParams::default() };
    let tree = PointTree::build(points, &params).unwrap();
    tree.neighbor_lists_swept(TimeInterval::FULL, radius).run(lists).unwrap();
    black_box(lists.encounters());
}

/// Particles that move by one mean spacing, each in its own direction.
fn moving(starts: &[Vec3]) -> Vec<MovingPoint> {
    let mut rng = Random(9);
    let spacing = (1.0 / starts.len() as f32).cbrt();
    starts.iter().map(|p| MovingPoint::new(*p, *p + rng.direction() * spacing)).collect()
}

/// All methods for the lists of a set.
fn all(args: &Args, name: &str, point: fn(&mut Random) -> Vec3) {
    let mut rng = Random(1);
    let points: Vec<Vec3> = (0..args.points).map(|_| point(&mut rng)).collect();
    let count = points.len();
    let radius = radius(&points, args.neighbors);
    let arrays: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
    let wide: Vec<[f64; 3]> = arrays.iter().map(|p| p.map(f64::from)).collect();
    let size = wide.iter().flatten().fold(0.0f64, |most, x| most.max(x.abs())) * 2.0 + 1.0;
    let cell = linkcell::Cell::ortho(size, size, size).unwrap();

    let mut lists = NeighborLists::new();
    let (mut buffer, tree) = (NeighborBuffer::new(), PointTree::build(&points, &PointParams::default()).unwrap());
    let mut columns = linkcell::PairColumns::default();
    let (mut plain_grid, mut vector_grid) = (Grid::default(), Grid::default());
    let queries = &points[..count.min(200_000)];
    let mut k8 = 0.0;
    let mut contestants: Vec<Contestant> = vec![
        ("mbkd", Box::new(|| ours(&points, radius, &mut lists))),
        (
            "kiddo's tree join (one of two builds timed)",
            Box::new({
                let other = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&arrays).unwrap();
                let arrays = &arrays;
                move || {
                    let tree = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(arrays).unwrap();
                    let join = tree.query_tree(&other).within::<SquaredEuclidean<f32>>(radius * radius);
                    black_box(join.without_distances().with_executor(&Executor::serial()).execute().len());
                }
            }),
        ),
        ("grid of cells, plain", Box::new(|| plain(&points, radius, &mut plain_grid))),
        ("grid of cells, AVX-512 by hand", Box::new(|| vectors(&points, radius, &mut vector_grid))),
    ];
    let mut linkcell_run = || {
        linkcell::pairs_within_columns(&wide, &cell, radius.into(), None, None, false, &mut columns)
            .map(|()| columns.len())
    };
    match linkcell_run() {
        Ok(_) => contestants.push((
            "linkcell (f64 pairs with distances)",
            Box::new(move || {
                black_box(linkcell_run().unwrap());
            }),
        )),
        Err(refusal) => println!("linkcell refuses: {refusal:?}"),
    }
    contestants.push((
        "(mbkd's build alone)",
        Box::new(|| {
            black_box(PointTree::build(&points, &PointParams::default()).unwrap().len());
        }),
    ));
    contestants.push((
        "(k = 8 of a static tree, queries in any order)",
        Box::new(|| {
            let start = Instant::now();
            queries.iter().for_each(|p| {
                black_box(tree.query(*p, 0.0).nearest_n_into(8, &mut buffer));
            });
            k8 = start.elapsed().as_nanos() as f64 / queries.len() as f64;
        }),
    ));
    let title = format!("{name}: {count} particles, {} neighbours each", args.neighbors);
    let times = table(&title, args, count, contestants);
    println!(
        "  neighbours: mbkd {}, plain grid {}, vectors {}",
        lists.neighbors(),
        plain_grid.ids.len(),
        vector_grid.len
    );
    println!(
        "  bytes of lists {:.0} per particle, of the tree {:.1}",
        lists.bytes() as f64 / count as f64,
        tree.statistics().bytes() as f64 / count as f64
    );
    println!("  k = 8: {k8:.0} ns; lists, build included, relative to it {:.3}", times[0] / k8);
    let spacing = radius / (args.neighbors as f32 * 3.0 / (4.0 * core::f32::consts::PI)).cbrt();
    for sorted in [false, true] {
        steps(&points, radius, spacing, sorted, k8);
    }
}

/// Steps that move each particle by a tenth of the mean spacing, with arrays in the order of the tree or in any: time relative to
/// that of `k8`, a search for eight neighbours.
fn steps(points: &[Vec3], radius: f32, spacing: f32, sorted: bool, k8: f64) {
    let mut moving = points.to_vec();
    let mut tree = PointTree::build(&moving, &PointParams::default()).unwrap();
    let (mut lists, mut rng, mut kept) = (NeighborLists::new(), Random(5), 0);
    tree.neighbor_lists(0.0, radius).run(&mut lists).unwrap();
    if sorted {
        moving = tree.take_order().iter().map(|&id| moving[id as usize]).collect();
    }
    let rounds = 12;
    let (mut times, mut builds) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        moving.iter_mut().for_each(|p| *p += rng.direction() * (0.1 * spacing));
        let start = Instant::now();
        kept += usize::from(tree.rebuild(&moving, &PointParams::default()).unwrap());
        builds.push(start.elapsed().as_nanos() as f64 / points.len() as f64);
        tree.neighbor_lists(0.0, radius).run(&mut lists).unwrap();
        times.push(start.elapsed().as_nanos() as f64 / points.len() as f64);
    }
    let (time, build) = (median(times), median(builds));
    let arrays = if sorted { "in the tree's order" } else { "in any order" };
    println!(
        "  steps of a tenth of the spacing, arrays {arrays}: {time:.1} ns, {build:.1} of it rebuilding; {:.3} of k = 8 (order kept in {kept} of {rounds})",
        time / k8
    );
}

/// Radii that vary tenfold within one set: each particle lists its neighbours within its own radius.
fn radii(args: &Args) {
    let mut rng = Random(3);
    let points: Vec<Vec3> = (0..args.points).map(|_| rng.in_cube()).collect();
    let mean = radius(&points, args.neighbors);
    let own: Vec<f32> = points.iter().map(|_| mean * 10f32.powf(rng.unit() - 0.75)).collect();
    let arrays: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
    let (mut lists, mut grid, mut ids) = (NeighborLists::new(), Grid::default(), Vec::new());
    let contestants: Vec<Contestant> = vec![
        (
            "mbkd",
            Box::new(|| {
                let tree = PointTree::build(&points, &PointParams::default()).unwrap();
                tree.neighbor_lists(0.0, Radii::Own(&own)).run(&mut lists).unwrap();
            }),
        ),
        (
            "kiddo, a query for each",
            Box::new(|| {
                let tree = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&arrays).unwrap();
                ids.clear();
                for (p, r) in arrays.iter().zip(&own) {
                    let found = tree.query(p).within::<SquaredEuclidean<f32>>(r * r).unsorted().execute();
                    ids.extend(found.iter().map(|n| n.item));
                }
            }),
        ),
        ("grid of cells as wide as the largest, plain", Box::new(|| grids::plain_own(&points, &own, &mut grid))),
    ];
    table(&format!("radii that vary tenfold: {} particles", points.len()), args, points.len(), contestants);
    println!("  neighbours: mbkd {}, kiddo {} with themselves, grid {}", lists.neighbors(), ids.len(), grid.ids.len());
}

/// All encounters while each particle moves by one spacing.
fn swept(args: &Args) {
    let mut rng = Random(4);
    let starts: Vec<Vec3> = (0..args.points).map(|_| rng.in_cube()).collect();
    let radius = radius(&starts, args.neighbors);
    let spacing = (1.0 / args.points as f32).cbrt();
    let points = moving(&starts);
    let (mut meetings, mut lists, mut found) = (EncounterLists::new(), NeighborLists::new(), Vec::new());
    let contestants: Vec<Contestant> = vec![
        ("mbkd", Box::new(|| ours_swept(&points, radius, &mut meetings))),
        (
            "mbkd's lists at mid-time, inflated, filtered",
            Box::new(|| {
                let middles: Vec<Vec3> = points.iter().map(|p| (p.open + p.close) * 0.5).collect();
                let tree = PointTree::build(&middles, &PointParams::default()).unwrap();
                tree.neighbor_lists(0.0, (radius + spacing) * 1.000_01).run(&mut lists).unwrap();
                found.clear();
                for (id, row) in lists.iter() {
                    let own = &points[id as usize];
                    found.extend(row.iter().filter_map(|&other| pass(own, &points[other as usize], other, radius)));
                }
            }),
        ),
    ];
    table(&format!("swept over one spacing: {} particles", points.len()), args, points.len(), contestants);
    println!("  encounters: mbkd {}, by filtering {}", meetings.encounters().len(), found.len());
}

/// Lists with a skin of a fifth of the radius, with and without the time until which they are valid, over a motion of a
/// tenth of the spacing.
fn skin(args: &Args) {
    let mut rng = Random(8);
    let starts: Vec<Vec3> = (0..args.points).map(|_| rng.in_cube()).collect();
    let radius = radius(&starts, args.neighbors) / 1.2;
    let params = PointParams { structure: PointStructure::Linear, ..PointParams::default() };
    let tree = PointTree::build(&moving(&starts), &params).unwrap();
    let (mut lists, mut more, mut until) = (NeighborLists::new(), NeighborLists::new(), 0.0);
    let contestants: Vec<Contestant> = vec![
        (
            "mbkd, lists with a certificate",
            Box::new(|| until = tree.neighbor_lists_with_skin(0.0, radius, 0.2 * radius, 0.1, &mut lists).unwrap()),
        ),
        ("mbkd, the lists alone", Box::new(|| tree.neighbor_lists(0.0, 1.2 * radius).run(&mut more).unwrap())),
    ];
    table(&format!("lists with a skin: {} particles", starts.len()), args, starts.len(), contestants);
    println!("  neighbours {} and {}, certified until {until}", lists.neighbors(), more.neighbors());
}

/// The encounter of two points in f32, if there is one.
fn pass(a: &MovingPoint, b: &MovingPoint, id: u32, radius: f32) -> Option<Encounter> {
    let (first, last) = (b.open - a.open, b.close - a.close);
    let displacement = last - first;
    let (speed, approach) = (displacement.length_squared(), -first.dot(displacement));
    let closest = if speed > 0.0 { (approach / speed).clamp(0.0, 1.0) } else { 0.0 };
    let distance_squared = (first + displacement * closest).length_squared();
    if distance_squared > radius * radius {
        return None;
    }
    let outside = first.length_squared() - radius * radius;
    let root = (approach * approach - speed * outside).max(0.0).sqrt();
    let enter = if outside <= 0.0 { 0.0 } else { (outside / (approach + root)).clamp(0.0, closest) };
    let inside = last.length_squared() <= radius * radius;
    let leave = if inside { 1.0 } else { ((approach + root) / speed).clamp(closest, 1.0) };
    Some(Encounter { id, enter, leave, closest, distance_squared })
}

/// The cost of keeping the order of the first step, compared with reordering the particles: a random walk by a tenth of
/// the spacing.
fn growth(args: &Args) {
    let mut rng = Random(7);
    let mut points: Vec<Vec3> = (0..args.points).map(|_| rng.in_cube()).collect();
    let radius = radius(&points, args.neighbors);
    let spacing = (1.0 / args.points as f32).cbrt();
    let mut kept = PointTree::build(&points, &PointParams::default()).unwrap();
    let (mut lists, mut more) = (NeighborLists::new(), NeighborLists::new());
    println!("\na random walk by a tenth of the spacing, ns per particle: rebuilding and lists, building and lists");
    for step in 1..=20 {
        points.iter_mut().for_each(|p| *p += rng.direction() * (0.1 * spacing));
        let mut times = [Vec::new(), Vec::new(), Vec::new(), Vec::new()];
        let mut time = |place: usize, begin: Instant| {
            times[place].push(begin.elapsed().as_nanos() as f64 / args.points as f64);
        };
        let begin = Instant::now();
        let order_kept = kept.rebuild(&points, &PointParams::default()).unwrap();
        time(0, begin);
        for _ in 0..3 {
            let begin = Instant::now();
            let afresh = PointTree::build(&points, &PointParams::default()).unwrap();
            time(2, begin);
            let begin = Instant::now();
            kept.neighbor_lists(0.0, radius).run(&mut lists).unwrap();
            time(1, begin);
            let begin = Instant::now();
            afresh.neighbor_lists(0.0, radius).run(&mut more).unwrap();
            time(3, begin);
        }
        let [rebuilding, lists, building, fresh_lists] = times.map(median);
        let slower = lists / fresh_lists;
        let what = if order_kept { "kept" } else { "rebuilt" };
        println!(
            "  step {step:2}: {rebuilding:.0} + {lists:.0}, {building:.0} + {fresh_lists:.0}, {slower:.3} x ({what})"
        );
    }
}

/// Radius queries in bulk against a loop of single ones.
fn bulk(args: &Args) {
    let mut rng = Random(6);
    let points: Vec<Vec3> = (0..args.points).map(|_| rng.in_cube()).collect();
    let radius = radius(&points, args.neighbors);
    let tree = PointTree::build(&points, &PointParams::default()).unwrap();
    let mut lists = NeighborLists::new();
    tree.neighbor_lists(0.0, radius).run(&mut lists).unwrap();
    let sorted: Vec<Vec3> = lists.points().iter().map(|&id| points[id as usize]).collect();
    for (name, queries) in [("in random order", &points), ("in the order of the tree", &sorted)] {
        let (mut lists, mut buffer, mut ids, mut ends) = (NeighborLists::new(), NeighborBuffer::new(), vec![], vec![]);
        let contestants: Vec<Contestant> = vec![
            ("mbkd, within_lists", Box::new(|| tree.within_lists(queries, 0.0, radius).run(&mut lists).unwrap())),
            (
                "mbkd, a loop of queries",
                Box::new(|| {
                    ids.clear();
                    ends.clear();
                    for p in queries {
                        ids.extend(tree.query(*p, 0.0).radius(radius).collect_into(&mut buffer).iter().map(|n| n.id));
                        ends.push(ids.len());
                    }
                }),
            ),
        ];
        table(&format!("bulk queries {name}"), args, queries.len(), contestants);
    }
}
