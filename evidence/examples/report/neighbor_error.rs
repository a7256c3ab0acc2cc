//! Neighbour searches among moving points: how many of the neighbours are wrong, and by how much, over the time that a query
//! takes. After the plots of ann-benchmarks (Aumüller, Bernhardsson and Faithfull, 2018).

use crate::fronts::{Family, claim, plot, short};
use crate::kiddo_peer::{Inflated, KiddoTree, Leaves, Snapshots};
use crate::memory::weigh;
use crate::page::{Item, Section, Table};
use crate::race::{Contestant, Effort, Ground, Outcome, on_one_thread, race, timed};
use crate::run::Run;
use mbkd::{MovingPoint, NeighborBuffer, PointParams, PointTree};
use mbkd_evidence::pareto::Measured;
use mbkd_evidence::point_sets::{MOTIONS, Motion, Query, moving_points, place, queries};
use std::error::Error;

/// Neighbours of a query.
const K: usize = 8;
/// Snapshots of kiddo.
const TIMES: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
/// How much farther than the exact answer ours may be.
const EPSILONS: [f32; 5] = [0.01, 0.03, 0.1, 0.3, 1.0];

/// How large everything is.
struct Size {
    points: usize,
    queries: usize,
    judged: usize,
    effort: Effort,
}

impl Size {
    fn of(run: &Run) -> Size {
        run.pick(
            Size { points: 30_000, queries: 10_000, judged: 500, effort: Effort { rounds: 5, turn: 0.012 } },
            Size { points: 300_000, queries: 100_000, judged: 1000, effort: Effort { rounds: 7, turn: 0.12 } },
        )
    }
}

/// The section: four kinds of motion, two errors each.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let size = Size::of(run);
    let moving: Vec<(&str, Motion)> = MOTIONS.into_iter().filter(|(_, motion)| *motion != Motion::Still).collect();
    run.begin("neighbor-error", moving.len());
    let mut items = vec![Item::Text(format!(
        "{} points in the unit cube; {} queries near them, each at its own time, in Morton order; {K} nearest \
         neighbours; one thread. A returned neighbour counts as wrong if it is missing, if that point does not exist \
         at the time, or if it is farther away than the true {K}th neighbour by more than rounding positions to f32 \
         explains (2.4e-7). The truth comes from comparing all points in f64, for {} of the queries. kiddo has no \
         notion of motion: its users query the nearest of T snapshots, rebuild when the time changes, or search a \
         larger radius and filter.",
        size.points, size.queries, size.judged
    ))];
    for (name, motion) in moving {
        run.step(name);
        let points = moving_points(motion, size.points, run.seed);
        let queries = queries(&points, size.queries, run.seed + 1);
        let ground = Ground::new(points, queries, K, size.judged);
        items.extend(on_one_thread(|| one_motion(&ground, size.effort, name, motion))?);
    }
    Ok(Section { id: "neighbor-error", title: "4. Neighbour error against time", items })
}

/// What is said about a kind of motion.
fn about(motion: Motion) -> &'static str {
    match motion {
        Motion::Still => "All points are static.",
        Motion::Coherent => {
            "Coherent motion: a smooth field that rotates and stretches the set, by up to a tenth of \
                             its size."
        }
        Motion::Random(_) => "Every point has a random velocity, up to five spacings along each axis.",
        Motion::Mixed => {
            "One point in twenty moves by up to twenty spacings along each axis, the others by up to a tenth."
        }
        Motion::ShortLived => "Static points, each of which exists for 2 to 10 % of the shutter.",
    }
}

/// One of the errors of an outcome.
type ErrorOf = fn(&Outcome) -> f64;

/// A structure that was built: name, milliseconds, bytes.
type Built = (String, f64, usize);

fn one_motion(ground: &Ground, effort: Effort, name: &str, motion: Motion) -> Result<Vec<Item>, Box<dyn Error>> {
    let Ground { points, queries, .. } = ground;
    let middle: Vec<[f32; 3]> = points.iter().map(|p| place(p, 0.5).to_array()).collect();
    let leaves = KiddoTree::faster_leaves(&middle, &queries[..queries.len().min(2000)], K)?;
    let mut built: Vec<Built> = Vec::new();
    let mut note = |name: String, (seconds, bytes): (f64, usize)| built.push((name, seconds * 1e3, bytes));

    let (seconds, _) = timed(2, || PointTree::build(points, &PointParams::default()));
    let (tree, bytes) = weigh(|| PointTree::build(points, &PointParams::default()));
    let tree = tree?;
    note("mbkd".into(), (seconds, bytes));
    let mut snapshots = Vec::new();
    // What building one snapshot takes, positions included.
    let (one, _) = timed(5, || Snapshots::build(points, 1, leaves));
    for times in TIMES {
        let ((seconds, made), bytes) = weigh(|| timed(1, || Snapshots::build(points, times, leaves)));
        snapshots.push((times, made?));
        note(format!("kiddo, T = {times}"), (if times == 1 { one } else { seconds }, bytes));
    }
    let ((seconds, inflated), bytes) = weigh(|| timed(1, || Inflated::build(points, leaves)));
    let mut inflated = inflated?;
    note("kiddo, inflated".into(), (seconds, bytes));

    let mut contestants = ours(&tree);
    for (times, snapshot) in &snapshots {
        let answer = |query: Query, found: &mut Vec<u32>| snapshot.nearest(query, K, found);
        contestants.push(Contestant { name: format!("kiddo, T = {times}"), answer: Box::new(answer) });
    }
    let answer = |query: Query, found: &mut Vec<u32>| inflated.nearest(query, K, found);
    contestants.push(Contestant { name: "kiddo, inflated radius".into(), answer: Box::new(answer) });
    let outcomes = race(ground, effort, &mut contestants);
    let mut rows: Vec<(String, Outcome)> = contestants.iter().map(|c| c.name.clone()).zip(outcomes).collect();
    let first = EPSILONS.len() + 1;
    for (i, times) in TIMES.into_iter().enumerate() {
        let snapshot = rows[first + i].1;
        let ns = snapshot.ns + times as f64 * one * 1e9 / queries.len() as f64;
        rows.push((format!("kiddo, rebuilt {times} times"), Outcome { ns, ..snapshot }));
    }
    rows.push(("kiddo, rebuilt for each query".into(), rebuilt(points, queries, leaves, one)?));

    let mut items = vec![Item::Text(format!(
        "{}. {} kiddo has {} leaves here, the faster of two kinds. Structure of ours: {}.",
        heading(name),
        about(motion),
        if leaves == Leaves::Flat { "flat" } else { "arena" },
        tree.statistics()
            .layers
            .iter()
            .map(|l| format!("{:?} ({} points)", l.kind, l.points))
            .collect::<Vec<_>>()
            .join(", ")
    ))];
    let errors: [(&str, &str, ErrorOf); 2] = [
        ("wrong", "share of wrong neighbours", |o| o.wrong),
        ("farther", "mean relative distance error", |o| o.farther),
    ];
    for (short_name, label, error) in errors {
        let families = families(&rows, error);
        let title = format!("{}: {label}", heading(name));
        let file = format!("{name}-{short_name}");
        items.push(Item::Plot(plot(file, title, "Lower left is better.", ["ns per query", label], &families)));
        items.push(claim(&format!("{}, {label}", heading(name)), "ns", &families));
    }
    items.push(Item::Table(times_table(name, &rows)));
    items.push(Item::Table(builds_table(name, &built, points.len())));
    Ok(items)
}

/// Ours, exact and with every epsilon.
fn ours(tree: &PointTree) -> Vec<Contestant<'_>> {
    let contestant = |epsilon: f32| {
        let mut buffer = NeighborBuffer::new();
        let answer = move |(at, time): Query, found: &mut Vec<u32>| {
            found.clear();
            let query = tree.query(at, time).approximate(epsilon);
            found.extend(query.nearest_n_into(K, &mut buffer).iter().map(|n| n.id));
        };
        let name = if epsilon == 0.0 { "mbkd, exact".to_string() } else { format!("mbkd, ε = {epsilon}") };
        Contestant { name, answer: Box::new(answer) }
    };
    [0.0].into_iter().chain(EPSILONS).map(contestant).collect()
}

/// A tree for the time of every single query. Exact; `one` is what building takes, a few queries show the rest.
fn rebuilt(points: &[MovingPoint], queries: &[Query], leaves: Leaves, one: f64) -> Result<Outcome, Box<dyn Error>> {
    let mut seconds = 0.0;
    let some: Vec<&Query> = queries.iter().step_by(queries.len() / 3).collect();
    for &&(at, time) in &some {
        let active = points.iter().filter(|p| p.active.contains(time));
        let places: Vec<[f32; 3]> = active.map(|p| place(p, time).to_array()).collect();
        let tree = KiddoTree::build(&places, leaves)?;
        seconds += timed(1, || tree.nearest(at, K, |id, _| _ = std::hint::black_box(id))).0 / some.len() as f64;
    }
    Ok(Outcome { ns: (one + seconds) * 1e9, wrong: 0.0, farther: 0.0 })
}

/// The lines of a plot.
fn families(rows: &[(String, Outcome)], error: ErrorOf) -> Vec<Family> {
    let kinds = [
        ("mbkd, exact and ε = 0.01 to 1", "mbkd", true),
        ("kiddo, nearest of T = 1 to 64 snapshots", "kiddo, T", false),
        ("kiddo, rebuilt 1 to 64 times and for each query", "kiddo, rebuilt", false),
        ("kiddo, inflated radius and filter", "kiddo, inflated", false),
    ];
    let family = |(label, begin, ours): (&str, &str, bool)| Family {
        label: label.into(),
        ours,
        settings: rows
            .iter()
            .filter(|(name, _)| name.starts_with(begin))
            .map(|(name, o)| Measured { name: name.clone(), cost: o.ns, error: error(o) })
            .collect(),
    };
    kinds.into_iter().map(family).collect()
}

fn times_table(name: &str, rows: &[(String, Outcome)]) -> Table {
    let exact = rows[0].1.ns;
    Table {
        name: format!("{name}-queries"),
        caption: format!(
            "{}: queries. Rebuilding is counted with what a tree takes to build, shared by all queries.",
            heading(name)
        ),
        columns: ["method", "ns per query", "times ours exact", "wrong neighbours", "relative distance error"]
            .map(String::from)
            .to_vec(),
        rows: rows
            .iter()
            .map(|(name, o)| vec![name.clone(), short(o.ns), short(o.ns / exact), short(o.wrong), short(o.farther)])
            .collect(),
    }
}

fn builds_table(name: &str, built: &[Built], points: usize) -> Table {
    Table {
        name: format!("{name}-builds"),
        caption: format!("{}: builds on one thread, and bytes counted at the allocator.", heading(name)),
        columns: ["structure", "build, ms", "bytes per point"].map(String::from).to_vec(),
        rows: built
            .iter()
            .map(|(name, ms, bytes)| vec![name.clone(), short(*ms), short(*bytes as f64 / points as f64)])
            .collect(),
    }
}

/// A name at the beginning of a line.
fn heading(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
