//! Section 8, rays: how build, memory and queries grow with the number of triangles, how far they move, the number of keys and
//! of threads.

use crate::cast::{Member, exact};
use crate::page::{Axis, Item, Plot, Section, Series, Style, Table};
use crate::run::Run;
use mbkd::glam::Vec3;
use mbkd::{BuildParams, KdParams, Ray, TriangleMesh};
use mbkd_evidence::peers::{Peer, PeerError, Structure};
use mbkd_evidence::timing::{Times, on_one_thread, race, seconds, timed, wall_seconds};
use mbkd_scenes::Random;
use rayon::prelude::*;
use std::error::Error;

/// References per triangle that trees with a budget may have, and the share of it at which it counts as hit.
const BUDGET: f64 = 8.0;
const HIT: f64 = 0.97;

/// What was measured of a structure at one place of an axis.
struct Figures {
    x: f64,
    build: f64,
    bytes: f64,
    /// Seconds per ray.
    ray: f64,
    at_budget: bool,
}

/// A structure with its figures along an axis.
struct Along {
    name: &'static str,
    ours: bool,
    figures: Vec<Figures>,
}

/// Makes the section.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let sizes: &[usize] = run.pick(&[1_000, 10_000], &[1_000, 10_000, 100_000, 1_000_000, 10_000_000]);
    let ways: &[f64] = run.pick(&[0.0, 1.0, 10.0], &[0.0, 0.1, 0.3, 1.0, 3.0, 10.0]);
    let keys: &[usize] = run.pick(&[2, 65], &[2, 5, 17, 65]);
    run.begin("scaling-rays", sizes.len() + ways.len() + keys.len() + 1);
    let (n, rays) = run.pick((4_000, 1_000), (30_000, 20_000));
    // No build is begun that is expected to take longer.
    let patience = run.pick(5.0, 60.0);
    let mut items = vec![Item::Text(format!(
        "Unconnected triangles fill a cube evenly; each has a random displacement, a multiple of the mean distance to \
         its neighbour. Rays cross the cube at random times. One thread, medians. The k-d trees may make {BUDGET} \
         references per triangle (MSBVH 2); the last column of the tables and marks without a line in the plots show \
         where that budget was exhausted, so that the tree is coarser than its cost model asks for. A build is skipped \
         if the previous one predicts that it would take more than {patience} s."
    ))];
    let mut random = Random(run.seed);
    let cast = members();
    let by_size = along(
        &cast,
        sizes.iter().map(|&n| n as f64),
        |n| {
            run.step(&format!("{n} triangles"));
            (cloud(n as usize, 1.0, 2, &mut random), patience * 0.1)
        },
        rays,
    )?;
    items.extend(plots("size", "triangles", true, "displacement of one spacing, 2 keys", by_size));
    let by_way = along(
        &cast,
        ways.iter().copied(),
        |way| {
            run.step(&format!("{way} times the spacing"));
            (cloud(n, way as f32, 2, &mut random), patience)
        },
        rays,
    )?;
    items.extend(plots("motion", "displacement / spacing", false, &format!("{n} triangles, 2 keys"), by_way));
    let by_keys = along(
        &cast,
        keys.iter().map(|&keys| keys as f64),
        |keys| {
            run.step(&format!("{keys} keys"));
            (cloud(n / 3, 1.0, keys as usize, &mut random), patience)
        },
        rays,
    )?;
    items.extend(plots("keys", "keys", true, &format!("{} triangles on curved paths", n / 3), by_keys));
    run.step("threads");
    items.push(Item::Table(threads(&cast, &cloud(n, 1.0, 2, &mut random), rays, &mut random)?));
    Ok(Section { id: "scaling-rays", title: "8. Scaling: rays", items })
}

/// Those whose curves are drawn.
fn members() -> Vec<Member> {
    let without_classic = exact()
        .into_iter()
        .filter(|member| member.structure != Structure::Library(BuildParams::kd(KdParams::classic())));
    without_classic.collect()
}

/// Loose triangles in the unit cube, each moving on a parabola.
fn cloud(n: usize, way: f32, keys: usize, random: &mut Random) -> Vec<TriangleMesh> {
    let spacing = (n.max(1) as f32).powf(-1.0 / 3.0);
    let mut positions = vec![Vec::with_capacity(3 * n); keys];
    for _ in 0..n {
        let mut vec = || random.dvec().as_vec3();
        let (at, aim, bend) = (vec() * 0.5, vec().normalize_or(Vec3::X), vec().normalize_or(Vec3::Y));
        let corners = [vec(), vec(), vec()].map(|c| at + c * 0.5 * spacing);
        for (key, positions) in positions.iter_mut().enumerate() {
            let t = key as f32 / (keys - 1).max(1) as f32;
            let moved = (aim * t + bend * (t * (1.0 - t))) * (way * spacing);
            positions.extend(corners.map(|c| c + moved));
        }
    }
    vec![TriangleMesh::new((0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), positions)]
}

/// Rays from around the cube to somewhere in it.
fn crossing(n: usize, random: &mut Random) -> Vec<Ray> {
    let ray = |_| {
        let from = random.dvec().as_vec3().normalize_or(Vec3::X) * 1.5;
        let to = random.dvec().as_vec3() * 0.5;
        Ray::new(from, to - from).at_time(random.unit_f64() as f32)
    };
    (0..n).map(ray).collect()
}

/// Measures all structures along an axis; `make` gives the triangles and the longest build that may go before one.
fn along(
    cast: &[Member],
    axis: impl Iterator<Item = f64>,
    mut make: impl FnMut(f64) -> (Vec<TriangleMesh>, f64),
    rays: usize,
) -> Result<Vec<Along>, PeerError> {
    let of = |member: &Member| Along { name: member.name, ours: member.ours, figures: Vec::new() };
    let mut all: Vec<Along> = cast.iter().map(of).collect();
    for x in axis {
        let (meshes, patience) = make(x);
        let rays = crossing(rays, &mut Random(7));
        on_one_thread(|| {
            let mut measured: Vec<(usize, Peer, f64)> = Vec::new();
            for (i, member) in cast.iter().enumerate() {
                if all[i].figures.last().is_some_and(|before| before.build > patience) {
                    continue;
                }
                let (peer, build) = timed(|| Peer::build(&member.structure, &meshes));
                measured.push((i, peer?, build));
            }
            let mut tasks: Vec<Box<dyn FnMut() + '_>> = Vec::new();
            for (_, peer, _) in &measured {
                tasks.push(Box::new(|| crate::cast::run(peer, &rays)));
            }
            let times = race(seconds, 3, &mut tasks);
            for ((i, peer, build), time) in measured.iter().zip(times) {
                let statistics = peer.statistics();
                let limit = match cast[*i].structure {
                    Structure::Msbvh(params) => f64::from(params.max_references),
                    Structure::FourD(params) => f64::from(params.max_references),
                    Structure::Library(BuildParams { policy: mbkd::Policy::Kd(params) }) => {
                        f64::from(params.max_references)
                    }
                    _ => f64::INFINITY,
                };
                all[*i].figures.push(Figures {
                    x,
                    build: *build,
                    bytes: statistics.bytes() as f64 / statistics.triangles.max(1) as f64,
                    ray: time.median / rays.len() as f64,
                    at_budget: statistics.references as f64 >= HIT * limit * statistics.triangles as f64,
                });
            }
            Ok::<(), PeerError>(())
        })?;
    }
    Ok(all)
}

/// The plots of an axis and their table.
fn plots(name: &str, label: &str, log: bool, of: &str, all: Vec<Along>) -> Vec<Item> {
    let mut items = Vec::new();
    type Value = fn(&Figures) -> f64;
    let kinds: [(&str, &str, Value); 3] = [
        ("build", "build, s", |f| f.build),
        ("memory", "bytes per triangle", |f| f.bytes),
        ("ray", "µs per ray", |f| 1e6 * f.ray),
    ];
    for (kind, y, value) in kinds {
        let mut series = Vec::new();
        for along in &all {
            let points = |which: &dyn Fn(&Figures) -> bool| -> Vec<(f64, f64)> {
                along.figures.iter().filter(|f| which(f)).map(|f| (f.x, value(f))).collect()
            };
            series.push(Series {
                label: along.name.into(),
                points: points(&|_| true),
                style: Style::LineAndPoints,
                ours: along.ours,
            });
        }
        // One mark for all that are at their budgets.
        let at_budget: Vec<(f64, f64)> = all
            .iter()
            .flat_map(|along| along.figures.iter().filter(|f| f.at_budget).map(|f| (f.x, value(f))))
            .collect();
        if !at_budget.is_empty() {
            let label = "reference budget exhausted".into();
            series.push(Series { label, points: at_budget, style: Style::Points, ours: false });
        }
        items.push(Item::Plot(Plot {
            name: format!("{name}-{kind}"),
            title: format!("{y} over {label}"),
            caption: format!("{of}."),
            x: Axis { label: label.into(), log },
            y: Axis { label: y.into(), log: true },
            series,
        }));
    }
    let row = |along: &Along, f: &Figures| {
        vec![
            along.name.to_string(),
            f.x.to_string(),
            format!("{:.4}", f.build),
            format!("{:.0}", f.bytes),
            format!("{:.3}", 1e6 * f.ray),
            if f.at_budget { "hit".into() } else { String::new() },
        ]
    };
    items.push(Item::Table(Table {
        name: name.into(),
        caption: format!("The same in figures: {of}."),
        columns: ["structure", label, "build, s", "bytes per triangle", "µs per ray", "budget"]
            .map(String::from)
            .to_vec(),
        rows: all.iter().flat_map(|along| along.figures.iter().map(|f| row(along, f))).collect(),
    }));
    items
}

/// Builds and queries on one thread and on all.
fn threads(cast: &[Member], meshes: &[TriangleMesh], rays: usize, random: &mut Random) -> Result<Table, PeerError> {
    let rays = crossing(rays, random);
    let all = rayon::current_num_threads();
    let mut rows = Vec::new();
    for member in cast {
        let peer = Peer::build(&member.structure, meshes)?;
        let build = || std::hint::black_box(Peer::build(&member.structure, meshes).is_ok());
        let run = || {
            let hits = rays.par_chunks(256).map(|rays| rays.iter().filter(|r| peer.closest_hit(r).is_some()).count());
            std::hint::black_box(hits.sum::<usize>());
        };
        let mut tasks: Vec<Box<dyn FnMut() + '_>> = vec![
            Box::new(|| on_one_thread(|| _ = build())),
            Box::new(|| _ = build()),
            Box::new(|| on_one_thread(run)),
            Box::new(run),
        ];
        let times: Vec<Times> = race(wall_seconds, 3, &mut tasks);
        let mut row = vec![member.name.to_string()];
        row.extend(times.iter().map(|time| format!("{:.4}", time.median)));
        row.push(format!("{:.2}", times[0].median / times[1].median));
        row.push(format!("{:.2}", times[2].median / times[3].median));
        rows.push(row);
    }
    let heads = [
        "structure",
        "build, 1 thread, s",
        "build, all, s",
        "rays, 1 thread, s",
        "rays, all, s",
        "build, faster by",
        "rays, faster by",
    ];
    Ok(Table {
        name: "threads".into(),
        caption: format!(
            "One thread and all threads ({all}): displacement of one spacing, 2 keys, {} rays.",
            rays.len()
        ),
        columns: heads.map(String::from).to_vec(),
        rows,
    })
}
