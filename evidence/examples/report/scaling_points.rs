//! How structures for points grow: with their number, with how far they move, and with the keys of their motion.

use crate::fronts::short;
use crate::kiddo_peer::{KiddoTree, Leaves};
use crate::memory::weigh;
use crate::page::{Axis, Item, Plot, Section, Series, Style, Table};
use crate::race::{on_one_thread, timed};
use crate::run::Run;
use mbkd::glam::Vec3;
use mbkd::{MovingPoint, NeighborBuffer, PointArrays, PointParams, PointSet, PointStructure, PointTree};
use mbkd_evidence::point_sets::{Motion, Query, moving_points, place, queries, spacing};
use mbkd_scenes::Random;
use std::error::Error;
use std::hint::black_box;

/// Neighbours of a query.
const K: usize = 8;

/// What a structure over some points costs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cost {
    /// Nanoseconds of building, per point.
    build: f64,
    /// Nanoseconds per query.
    query: f64,
    /// Bytes per point.
    bytes: f64,
    /// References per point.
    references: f64,
}

/// Costs over something, of one structure.
struct Curve {
    label: String,
    ours: bool,
    style: Style,
    costs: Vec<(f64, Cost)>,
}

impl Curve {
    fn new(label: &str, ours: bool) -> Curve {
        Curve { label: label.into(), ours, style: Style::LineAndPoints, costs: Vec::new() }
    }
}

/// How large everything is.
struct Size {
    numbers: Vec<usize>,
    /// Points where their number is not what changes.
    points: usize,
    queries: usize,
    /// The most points with which the k-d tree is built.
    planes: usize,
}

/// The section.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let size = run.pick(
        Size { numbers: vec![1000, 10_000, 100_000, 1_000_000], points: 10_000, queries: 4000, planes: 100_000 },
        Size {
            numbers: vec![1000, 10_000, 100_000, 1_000_000, 10_000_000],
            points: 100_000,
            queries: 20_000,
            planes: 1_000_000,
        },
    );
    let keys = [2, 3, 5, 9, 17, 33, 65];
    let spacings = [0.0, 0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0];
    run.begin("scaling-points", size.numbers.len() + spacings.len() + keys.len());
    let mut items = vec![Item::Text(format!(
        "Points in the unit cube with random velocities; {K} nearest neighbours, {} queries, each at its own time; \
         one thread unless stated otherwise. kiddo indexes the points at mid-shutter, so its answers are wrong at all \
         other times: it shows what a tree without motion costs.",
        size.queries
    ))];
    let over_number = over_number(run, &size)?;
    plots(&mut items, "points", "number of points", true, &over_number);
    plots(&mut items, "displacement", "displacement, spacings", false, &over_displacement(run, &size, &spacings)?);
    plots(&mut items, "keys", "keys of the motion", false, &over_keys(run, &size, &keys)?);
    Ok(Section { id: "scaling-points", title: "9. Scaling: points", items })
}

/// Rounds of a build.
fn rounds(points: usize) -> usize {
    if points < 5_000_000 { 3 } else { 1 }
}

/// Builds and asks a tree, on the threads of the caller's pool. Queries run one after the other, or all at once.
fn cost<P: PointSet + ?Sized>(
    points: &P,
    structure: PointStructure,
    queries: &[Query],
    at_once: bool,
) -> Result<Cost, Box<dyn Error>> {
    let n = points.len() as f64;
    let params = PointParams { structure, ..PointParams::default() };
    // First the build that is kept: the first ones in a process also fetch its memory.
    let (tree, bytes) = weigh(|| PointTree::build(points, &params));
    let tree = tree?;
    let (build, _) = timed(rounds(points.len()), || PointTree::build(points, &params));
    let mut buffer = NeighborBuffer::new();
    let (seconds, ()) = timed(5, || {
        if at_once {
            black_box(tree.nearest_n_batch(queries, K));
            return;
        }
        for (at, time) in queries {
            black_box(tree.query(*at, *time).nearest_n_into(K, &mut buffer));
        }
    });
    Ok(Cost {
        build: build * 1e9 / n,
        query: seconds * 1e9 / queries.len() as f64,
        bytes: bytes as f64 / n,
        references: tree.statistics().references_per_point(),
    })
}

/// kiddo over the places at mid-shutter.
fn cost_of_kiddo(points: &[Vec3], queries: &[Query]) -> Result<Cost, Box<dyn Error>> {
    let places: Vec<[f32; 3]> = points.iter().map(|p| p.to_array()).collect();
    let n = points.len() as f64;
    let (tree, bytes) = weigh(|| KiddoTree::build(&places, Leaves::Arena));
    let tree = tree?;
    let (build, _) = timed(rounds(points.len()), || KiddoTree::build(&places, Leaves::Arena));
    let (seconds, ()) = timed(5, || queries.iter().for_each(|(at, _)| tree.nearest(*at, K, |id, _| _ = black_box(id))));
    let query = seconds * 1e9 / queries.len() as f64;
    Ok(Cost { build: build * 1e9 / n, query, bytes: bytes as f64 / n, references: 1.0 })
}

/// Where points are at mid-shutter.
fn middles(points: &[MovingPoint]) -> Vec<Vec3> {
    points.iter().map(|p| place(p, 0.5)).collect()
}

fn over_number(run: &Run, size: &Size) -> Result<Vec<Curve>, Box<dyn Error>> {
    let mut curves = vec![
        Curve::new("mbkd, moving by up to a spacing", true),
        Curve::new("mbkd, all threads, queries at once", true),
        Curve::new("mbkd, standing still", true),
        Curve::new("the paper's k-d tree", false),
        Curve::new("kiddo, standing still", false),
    ];
    for &n in &size.numbers {
        run.step(&format!("{n} points"));
        let points = moving_points(Motion::Random(1.0), n, run.seed);
        let queries = queries(&points, size.queries, run.seed + 1);
        let still = middles(&points);
        let mut costs = on_one_thread(|| {
            let mut costs = vec![
                (0, cost(&points, PointStructure::Automatic, &queries, false)?),
                (2, cost(&still, PointStructure::Automatic, &queries, false)?),
                (4, cost_of_kiddo(&still, &queries)?),
            ];
            if n <= size.planes {
                costs.push((3, cost(&points, PointStructure::Kd, &queries, false)?));
            }
            Ok(costs)
        })?;
        costs.push((1, cost(&points, PointStructure::Automatic, &queries, true)?));
        for (curve, cost) in costs {
            curves[curve].costs.push((n as f64, cost));
        }
    }
    Ok(curves)
}

fn over_displacement(run: &Run, size: &Size, spacings: &[f32]) -> Result<Vec<Curve>, Box<dyn Error>> {
    let structures = [
        ("mbkd, automatic", PointStructure::Automatic),
        ("mbkd, linear boxes", PointStructure::Linear),
        ("mbkd, linear boxes in 4 time slices", PointStructure::TimeSlices(4)),
        ("the paper's k-d tree", PointStructure::Kd),
    ];
    let mut curves: Vec<Curve> =
        structures.iter().enumerate().map(|(i, (label, _))| Curve::new(label, i == 0)).collect();
    curves
        .push(Curve { style: Style::Points, ..Curve::new("the paper's k-d tree, at its budget of references", false) });
    curves.push(Curve::new("kiddo at mid-shutter", false));
    for &displacement in spacings {
        run.step(&format!("{displacement} spacings"));
        let points = moving_points(Motion::Random(displacement), size.points, run.seed);
        let queries = queries(&points, size.queries, run.seed + 1);
        let still = middles(&points);
        let costs = on_one_thread(|| {
            let mut costs = Vec::new();
            for (i, (_, structure)) in structures.into_iter().enumerate() {
                costs.push((i, cost(&points, structure, &queries, false)?));
            }
            let planes = costs[3].1;
            let params = PointParams::default();
            let most = 2.0 * params.max_references;
            let params = PointParams { structure: PointStructure::Kd, max_references: most, ..params };
            // With more to spend it would cut more.
            if PointTree::build(&points, &params)?.statistics().references_per_point() > planes.references {
                costs.push((4, planes));
            }
            costs.push((5, cost_of_kiddo(&still, &queries)?));
            Ok(costs)
        })?;
        for (curve, cost) in costs {
            curves[curve].costs.push((displacement.into(), cost));
        }
    }
    Ok(curves)
}

fn over_keys(run: &Run, size: &Size, numbers: &[usize]) -> Result<Vec<Curve>, Box<dyn Error>> {
    let n = size.points / 2;
    let mut curves = vec![
        Curve::new("mbkd, automatic", true),
        Curve::new("mbkd, linear boxes", false),
        Curve::new("kiddo at mid-shutter", false),
    ];
    for &count in numbers {
        run.step(&format!("{count} keys"));
        let keys = wandering(n, count, run.seed);
        let arrays: Vec<&[Vec3]> = keys.iter().map(|key| &key[..]).collect();
        let points = PointArrays { keys: &arrays, active: &[], ids: &[] };
        let ends: Vec<MovingPoint> =
            keys[0].iter().zip(&keys[count - 1]).map(|(open, close)| MovingPoint::new(*open, *close)).collect();
        let queries = queries(&ends, size.queries, run.seed + 1);
        let middle = &keys[count / 2];
        let costs = on_one_thread(|| {
            Ok([
                cost(&points, PointStructure::Automatic, &queries, false)?,
                cost(&points, PointStructure::Linear, &queries, false)?,
                cost_of_kiddo(middle, &queries)?,
            ])
        })?;
        for (curve, cost) in curves.iter_mut().zip(costs) {
            curve.costs.push((count as f64, cost));
        }
    }
    Ok(curves)
}

/// Points that wander: a random step from key to key, so that a point ends about a spacing from where it began.
fn wandering(n: usize, keys: usize, seed: u64) -> Vec<Vec<Vec3>> {
    let mut random = Random(seed);
    let step = f64::from(spacing(n)) / ((keys - 1) as f64).sqrt();
    let mut at: Vec<Vec3> = (0..n).map(|_| (random.dvec() * 0.5).as_vec3() + 0.5).collect();
    let mut all = vec![at.clone()];
    for _ in 1..keys {
        at.iter_mut().for_each(|p| *p += (random.dvec() * step).as_vec3());
        all.push(at.clone());
    }
    all
}

/// The plots of all costs, and the table of them.
fn plots(items: &mut Vec<Item>, name: &str, label: &str, log: bool, curves: &[Curve]) {
    type Kind<'a> = (&'a str, &'a str, Axis, fn(&Cost) -> f64);
    let axis = |label: &str, log: bool| Axis { label: label.into(), log };
    let kinds: [Kind; 3] = [
        ("query", "Time of a query", axis("ns per query", true), |c| c.query),
        ("build", "Time of a build", axis("ns per point", true), |c| c.build),
        ("memory", "Memory", axis("bytes per point", false), |c| c.bytes),
    ];
    for (kind, title, y, of) in kinds {
        let series = curves.iter().map(|curve| Series {
            label: curve.label.clone(),
            points: curve.costs.iter().map(|(x, cost)| (*x, of(cost))).collect(),
            style: curve.style,
            ours: curve.ours,
        });
        items.push(Item::Plot(Plot {
            name: format!("{name}-{kind}"),
            title: format!("{title} over {label}"),
            caption: String::new(),
            x: Axis { label: label.into(), log },
            y,
            series: series.filter(|series| !series.points.is_empty()).collect(),
        }));
    }
    let row = |curve: &Curve, (x, c): &(f64, Cost)| {
        vec![curve.label.clone(), short(*x), short(c.query), short(c.build), short(c.bytes), short(c.references)]
    };
    items.push(Item::Table(Table {
        name: format!("over-{name}"),
        caption: format!("Over {label}."),
        columns: ["structure", label, "ns per query", "build, ns per point", "bytes per point", "references per point"]
            .map(String::from)
            .to_vec(),
        rows: curves.iter().flat_map(|curve| curve.costs.iter().map(|at| row(curve, at))).collect(),
    }));
}
