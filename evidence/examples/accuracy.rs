//! How accurate the library is: its answers against exact ones, and how watertight: rays from inside closed meshes.
//!
//! `cargo run --release --example accuracy -- --quick` takes seconds; `--write docs/accuracy.md` replaces the tables of that page,
//! and with `--rays 1000000000` the watertight run is the long one.

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use mbkd::RayTree;
use mbkd_evidence::accuracy::*;
use mbkd_scenes::Random;
use rayon::prelude::*;
use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;

#[derive(Parser)]
#[command(
    about = "Compares the library's answers with exact arithmetic and writes a table; traces rays inside closed meshes"
)]
struct Args {
    /// Total number of rays from inside closed moving meshes.
    #[arg(long, default_value_t = 10_000_000)]
    rays: u64,
    /// Rays, or neighbour queries, compared with exact answers for each row of the tables.
    #[arg(long, default_value_t = 20_000)]
    samples: usize,
    /// Use a hundredth of all samples and rays.
    #[arg(long)]
    quick: bool,
    /// Only rows of families whose name contains this, and no rays from inside closed meshes.
    #[arg(long, conflicts_with = "write", value_name = "FAMILY")]
    only: Option<String>,
    /// Random seed of all scenes, rays and queries.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write the tables here instead of printing them; the text in the file between the marks
    /// `<!-- accuracy: begin -->` and `<!-- accuracy: end -->` is replaced, if it has them.
    #[arg(long)]
    write: Option<PathBuf>,
}

impl Args {
    /// The cases that are asked for. A row is the same with and without the others.
    fn wanted<C>(&self, cases: Vec<C>, family: fn(&C) -> &str) -> Vec<(usize, C)> {
        let wanted = |case: &C| self.only.as_ref().is_none_or(|only| family(case).contains(only));
        cases.into_iter().enumerate().filter(|(_, case)| wanted(case)).collect()
    }
}

/// What the command has to say: tables, and whether everything is right.
#[derive(Default)]
struct Report {
    text: String,
    faults: Vec<String>,
}

impl Report {
    fn line(&mut self, line: impl AsRef<str>) {
        self.text.push_str(line.as_ref());
        self.text.push('\n');
    }

    /// Notes what is wrong with answers in order of distance; `of` names what gave them.
    fn judge(&mut self, tally: &OrderTally, of: impl FnOnce() -> String) {
        if !tally.is_right() {
            self.faults.push(format!(
                "{}: {} in wrong order (worst by {} units), {} wrong counts, {} broken promises in {} queries",
                of(),
                tally.wrong_order,
                short(tally.worst_order),
                tally.wrong_count,
                tally.broken_promises,
                tally.queries
            ));
        }
    }
}

/// `n` with points of thousands left out, short.
fn short(x: f64) -> String {
    match x {
        x if x.is_infinite() => "∞".into(),
        x if x >= 1000.0 => format!("{x:.0e}"),
        x if x >= 10.0 => format!("{x:.0}"),
        x => format!("{x:.1}"),
    }
}

/// Worst and 99th percentile in ulp of well-conditioned answers, their share, worst in units.
fn errors(e: &Errors) -> String {
    if e.is_empty() {
        return "– | – | –".into();
    }
    let well = if e.well() > 0.0 {
        format!("{} / {}", short(e.quantile_ulps(0.99)), short(e.worst_ulps()))
    } else {
        "–".into()
    };
    format!("{:.0} % | {well} | {}", e.well() * 100.0, short(e.worst_units()))
}

fn bar(length: usize, what: &str) -> Result<ProgressBar, Box<dyn Error>> {
    let style = ProgressStyle::with_template("{msg:22} {bar:30} {percent}% {eta} left")?;
    Ok(ProgressBar::new(length as u64).with_style(style).with_message(what.to_string()))
}

fn triangles(args: &Args, samples: usize, report: &mut Report) -> Result<(), Box<dyn Error>> {
    report.line("### Rays against moving triangles\n");
    report.line(format!(
        "{samples} rays per row at 82 triangles, each policy. Wrong verdicts: false misses, false hits, wrong closest \
         hits, hits out of range; beside them the worst, in units, of all verdicts that differ from the exact one.\n"
    ));
    report.line(
        "| | | hits | wrong verdicts | t: well conditioned | t: ulp, 99 % / worst | t: units | barycentrics: units |",
    );
    report.line("|---|---|---|---|---|---|---|---|");
    let cases = args.wanted(ray_cases(), |case| case.name.0);
    let bar = bar(cases.len(), "triangles")?;
    let rows: Vec<Result<Vec<(&str, RayTally)>, String>> = cases
        .par_iter()
        .map(|(i, case)| {
            let scene = SceneUnderTest::new(case, args.seed + *i as u64);
            let build = |p| RayTree::build(&scene.meshes, p).map_err(|e| format!("{:?}: {e}", case.name));
            let trees = policies().iter().map(|(_, p)| build(p)).collect::<Result<Vec<_>, _>>()?;
            let mut random = Random(args.seed.wrapping_mul(7919) + *i as u64);
            let tallies = compare_rays(&scene, &trees, samples, &mut random, |_| ());
            bar.inc(1);
            Ok(policies().into_iter().map(|(name, _)| name).zip(tallies).collect())
        })
        .collect();
    bar.finish_and_clear();
    for ((_, case), row) in cases.iter().zip(rows) {
        rays_row(&case.name, case.is_promised(), row, report);
    }
    Ok(())
}

/// One row for all policies where they agree, as they should; whether the library promises to be right there.
fn rays_row(name: &(&str, String), promised: bool, row: Result<Vec<(&str, RayTally)>, String>, report: &mut Report) {
    let row = match row {
        Ok(row) => row,
        Err(error) => return report.line(format!("| {} | {} | {error} | | | | | |", name.0, name.1)),
    };
    let mut all = RayTally::default();
    for (policy, tally) in row {
        if promised && !tally.is_right() {
            report.faults.push(format!(
                "{} {}, {policy}: {} false misses, {} false hits, {} wrong closest, {} out of range, {} contradictions \
                 of {} hits",
                name.0,
                name.1,
                tally.false_misses,
                tally.false_hits,
                tally.wrong_closest,
                tally.outside_range,
                tally.contradictions,
                tally.hits
            ));
        }
        all.merge(tally);
    }
    let wrong = all.false_misses + all.false_hits + all.wrong_closest + all.outside_range + all.contradictions;
    report.line(format!(
        "| {} | {} | {} | {wrong}; {} | {} | {} |",
        name.0,
        name.1,
        all.hits / 3,
        short(all.worst_verdict),
        errors(&all.t),
        if all.weights.is_empty() { "–".into() } else { short(all.weights.worst_units()) }
    ));
}

fn spheres(args: &Args, samples: usize, report: &mut Report) -> Result<(), Box<dyn Error>> {
    report.line("\n### Rays against moving spheres\n");
    report.line("| | | hits | wrong verdicts | t: well conditioned | t: ulp, 99 % / worst | t: units | |");
    report.line("|---|---|---|---|---|---|---|---|");
    let cases = args.wanted(sphere_cases(), |case| case.name.0);
    let bar = bar(cases.len(), "spheres")?;
    let params: Vec<_> = policies().into_iter().map(|(_, p)| p).collect();
    let rows: Vec<_> = cases
        .par_iter()
        .map(|(i, case)| {
            let mut random = Random(args.seed.wrapping_mul(104_729) + *i as u64);
            let tallies = compare_spheres(case, &params, samples, &mut random);
            bar.inc(1);
            tallies.map(|t| policies().into_iter().map(|(name, _)| name).zip(t).collect()).map_err(|e| e.to_string())
        })
        .collect();
    bar.finish_and_clear();
    for ((_, case), row) in cases.iter().zip(rows) {
        rays_row(&case.name, true, row, report);
    }
    Ok(())
}

fn closest_points(args: &Args, samples: usize, report: &mut Report) -> Result<(), Box<dyn Error>> {
    report.line("\n### Nearest points on moving triangles\n");
    report.line(format!(
        "{} queries per row at 82 triangles, each policy. Wrong: on a triangle that is farther than another one beyond doubt; nothing \
         found, or something, where that is wrong; a place that is not as far away as is said. Beside it the worst order, in units.\n",
        samples / 20
    ));
    report.line("| | | wrong | d: well conditioned | d: ulp, 99 % / worst | d: units |");
    report.line("|---|---|---|---|---|---|");
    let cases = args.wanted(closest_point_cases(), |case| case.name.0);
    let bar = bar(cases.len(), "nearest points")?;
    let rows: Vec<Result<Vec<OrderTally>, String>> = cases
        .par_iter()
        .map(|(i, case)| {
            let scene = SceneUnderTest::new(case, args.seed + *i as u64);
            let build = |p| RayTree::build(&scene.meshes, p).map_err(|e| e.to_string());
            let trees = policies().iter().map(|(_, p)| build(p)).collect::<Result<Vec<_>, _>>()?;
            let mut random = Random(args.seed.wrapping_mul(15_485_863) + *i as u64);
            let tallies = compare_closest_points(&scene, &trees, samples / 20, &mut random, |_| ());
            bar.inc(1);
            Ok(tallies)
        })
        .collect();
    bar.finish_and_clear();
    for ((_, case), row) in cases.iter().zip(rows) {
        let (family, value) = &case.name;
        let row = match row {
            Ok(row) => row,
            Err(error) => {
                report.line(format!("| {family} | {value} | {error} | | | |"));
                continue;
            }
        };
        let mut all = OrderTally::default();
        for ((policy, _), tally) in policies().iter().zip(row) {
            report.judge(&tally, || format!("{family} {value}, nearest points, {policy}"));
            all.merge(tally);
        }
        let wrong = all.wrong_order + all.wrong_count + all.broken_promises;
        report.line(format!(
            "| {family} | {value} | {wrong}; {} | {} |",
            short(all.worst_order),
            errors(&all.distance)
        ));
    }
    Ok(())
}

fn neighbors(args: &Args, samples: usize, report: &mut Report) -> Result<(), Box<dyn Error>> {
    report.line("\n### Neighbours and closest approaches of moving points\n");
    report.line(format!(
        "{} queries per row among 200 points, each structure. Wrong: farther than the exact neighbour of the same place \
         beyond doubt; points missing; broken promises of approximate answers. Beside it the worst order, in units. Squared \
         distances, then the same for closest approaches.\n",
        samples / 10
    ));
    report.line(
        "| | | wrong | d²: well conditioned | d²: ulp, 99 % / worst | d²: units | approaches wrong | d²: well conditioned | \
         d²: ulp, 99 % / worst | d²: units | time: units |",
    );
    report.line("|---|---|---|---|---|---|---|---|---|---|---|");
    let cases = args.wanted(point_cases(), |case| case.name.0);
    let bar = bar(cases.len(), "points")?;
    type Rows = Result<[Vec<OrderTally>; 2], String>;
    let rows: Vec<Rows> = cases
        .par_iter()
        .map(|(i, case)| {
            let list: Vec<_> = structures(case.wide).into_iter().map(|(_, s)| s).collect();
            let mut random = Random(args.seed.wrapping_mul(1_299_709) + *i as u64);
            let found = compare_neighbors(case, &list, samples / 10, &mut random, |_| ()).map_err(|e| e.to_string())?;
            let approaches = compare_approaches(case, &list, samples / 50, &mut random).map_err(|e| e.to_string())?;
            bar.inc(1);
            Ok([found, approaches])
        })
        .collect();
    bar.finish_and_clear();
    for ((_, case), row) in cases.iter().zip(rows) {
        let (family, value) = &case.name;
        let kinds = match row {
            Ok(kinds) => kinds,
            Err(error) => {
                report.line(format!("| {family} | {value} | {error} | | | | | | | | |"));
                continue;
            }
        };
        let mut cells = format!("| {family} | {value} |");
        for (kind, tallies) in ["neighbours", "approaches"].iter().zip(kinds) {
            let mut all = OrderTally::default();
            for ((structure, _), tally) in structures(case.wide).iter().zip(tallies) {
                report.judge(&tally, || format!("{family} {value}, {kind}, {structure}"));
                all.merge(tally);
            }
            let wrong = all.wrong_order + all.wrong_count + all.broken_promises;
            write!(cells, " {wrong}; {} | {} |", short(all.worst_order), errors(&all.distance))?;
            if *kind == "approaches" {
                write!(cells, " {} |", if all.time.is_empty() { "–".into() } else { short(all.time.worst_units()) })?;
            }
        }
        report.line(cells);
    }
    Ok(())
}

/// Rays per block of the watertight run, the unit of parallel work.
const BLOCK: u64 = 1 << 16;

/// Rays of the watertight run that each k-d tree is asked at most.
const MOST_OF_KD: u64 = 10_000_000;

fn watertight(args: &Args, rays: u64, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let meshes = closed_meshes(args.seed);
    report.line("\n### Rays from inside closed moving meshes\n");
    report.line("Aimed at corners, edges, anywhere, along walls and along edges of walls; at random times, 0, 1, keys and an ulp beside.\n");
    report.line("| mesh | triangles | rays | leaks |");
    report.line("|---|---|---|---|");
    let each = rays.div_ceil(meshes.len() as u64);
    let bar = ProgressBar::new(rays)
        .with_style(ProgressStyle::with_template("{msg:22} {bar:30} {human_pos} rays, {per_sec}, {eta} left")?)
        .with_message("watertight");
    let mut total = 0;
    for closed in &meshes {
        // A fifth for each k-d tree, of a long run less: on meshes that move like these they take twenty times as long for each
        // ray.
        let of_kd = (each / 5).min(MOST_OF_KD / meshes.len() as u64);
        let mut row = (0, Vec::new());
        for ((policy, params), rays) in policies().iter().zip([each - 2 * of_kd, of_kd, of_kd]) {
            let tree = RayTree::build(&closed.meshes, params)?;
            let blocks = (0..rays.div_ceil(BLOCK)).into_par_iter().map(|block| {
                let seed = args.seed.wrapping_mul(0x2545_f491_4f6c_dd1d).wrapping_add(block);
                let count = BLOCK.min(rays - block * BLOCK);
                let (shot, leaks) = shoot(closed, std::slice::from_ref(&tree), count as usize, seed);
                bar.inc(count);
                (shot, leaks.into_iter().flatten().collect())
            });
            let join = |mut a: (usize, Vec<Leak>), b: (usize, Vec<Leak>)| {
                a.0 += b.0;
                a.1.extend(b.1);
                a
            };
            let (shot, leaks) = blocks.reduce(|| (0, Vec::new()), join);
            if let Some(leak) = leaks.first() {
                report.faults.push(format!(
                    "{}, {policy}: {} leaks of {shot} rays, such as {leak:?}",
                    closed.name,
                    leaks.len()
                ));
            }
            row = join(row, (shot, leaks));
        }
        total += row.0;
        report.line(format!("| {} | {} | {} | {} |", closed.name, closed.meshes[0].len(), row.0, row.1.len()));
    }
    bar.finish_and_clear();
    report.line(format!("\n{total} rays altogether."));
    Ok(())
}

const BEGIN: &str = "<!-- accuracy: begin -->";
const END: &str = "<!-- accuracy: end -->";

/// The text with the part between the marks replaced; all of it where there are none.
fn merged(old: &str, new: &str) -> String {
    match (old.find(BEGIN), old.find(END)) {
        (Some(begin), Some(end)) if begin < end => {
            format!("{}\n{new}{}", &old[..begin + BEGIN.len()], &old[end..])
        }
        _ => new.to_string(),
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let args = Args::parse();
    let (rays, samples) = if args.quick { (args.rays / 100, args.samples / 100) } else { (args.rays, args.samples) };
    let mut report = Report::default();
    let quick = if args.quick { " --quick" } else { "" };
    report.line(format!(
        "Written by `cargo run --release --example accuracy -- --rays {} --samples {} --seed {}{quick}`.\n",
        args.rays, args.samples, args.seed
    ));
    triangles(&args, samples, &mut report)?;
    spheres(&args, samples / 4, &mut report)?;
    closest_points(&args, samples, &mut report)?;
    neighbors(&args, samples, &mut report)?;
    if args.only.is_none() {
        watertight(&args, rays, &mut report)?;
    }
    match &args.write {
        Some(path) => {
            let old = if path.exists() { std::fs::read_to_string(path)? } else { String::new() };
            std::fs::write(path, merged(&old, &report.text))?;
            println!("wrote {}", path.display());
        }
        None => println!("{}", report.text),
    }
    println!("seed {}", args.seed);
    if report.faults.is_empty() {
        return Ok(());
    }
    for fault in &report.faults {
        println!("FAULT {fault}");
    }
    Err(format!("{} rows have wrong answers", report.faults.len()).into())
}
