//! The automatic choice of a structure for moving points against every number of time slices on request, over many kinds of motion
//! and of active intervals.
//!
//! Builds are in processor time, as medians of builds in turns, relative to static trees of as many points. The work of searches
//! for eight neighbours is counted, so it is the same in each run. Constants of the choice are fitted by the means at the end:
//!
//! `cargo bench --bench point_choices`; `--help` lists the options.

mod kind;
mod lifetimes;
mod measure;
mod motions;
mod summary;

use clap::{Parser, ValueEnum};
use kind::{Kind, queries};
use mbkd_evidence::options;
use mbkd_evidence::timing::on_one_thread;
use measure::Row;

#[derive(Parser)]
#[command(about = "Compares the automatic choice of a structure for moving points with every number of time slices")]
struct Args {
    /// Numbers of points.
    #[arg(long, value_delimiter = ',', default_values_t = [1000, 3000, 10_000, 30_000, 100_000],
        value_parser = clap::value_parser!(u32).range(1..))]
    points: Vec<u32>,
    /// Only points that exist throughout, or only those with active intervals.
    #[arg(long, value_enum)]
    kinds: Option<Kinds>,
    /// Only kinds whose names contain one of these, comma-separated.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Searches whose work is counted.
    #[arg(long, default_value_t = 4000, value_parser = clap::value_parser!(u32).range(1..))]
    queries: u32,
    /// Builds of 50 000 points and more, of which the median is taken; of fewer points, more builds.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    repeat: u32,
    /// The seed of random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print why each structure was chosen.
    #[arg(long)]
    why: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Kinds {
    /// Points that exist throughout
    Motion,
    /// Points with active intervals
    Active,
}

fn main() {
    let args: Args = options();
    on_one_thread(|| run(&args));
}

fn run(args: &Args) {
    println!(
        "Builds in static ones: of the automatic choice, of the same on request, of the best number of time slices within the budget;"
    );
    println!("work of a search in nodes, relative to that number of time slices, and to the best of any number\n");
    let (mut rows, mut parts) = (Vec::new(), Vec::new());
    for &count in &args.points {
        for (name, kinds) in tables(args) {
            let begin = rows.len();
            for kind in kinds {
                let points = kind.points(count as usize, args.seed);
                let at = queries(&points, args.queries as usize, args.seed);
                let row = Row::of(kind.name, &points, &at, args.repeat as usize);
                print(&row);
                if args.why {
                    row.why.iter().for_each(|why| println!("    {why}"));
                }
                rows.push(row);
            }
            parts.push((format!("{name}, {count} points"), begin..rows.len()));
        }
    }
    if rows.is_empty() {
        println!("no kind has such a name");
        return;
    }
    println!();
    for (title, range) in parts.into_iter().filter(|(_, range)| !range.is_empty()) {
        summary::means(&title, &rows[range].iter().collect::<Vec<_>>());
    }
    summary::means("all", &rows.iter().collect::<Vec<_>>());
    summary::worst(&rows);
}

/// The kinds that were asked for.
fn tables(args: &Args) -> Vec<(&'static str, Vec<&'static Kind>)> {
    const TABLES: [(Kinds, &str, &[Kind]); 2] =
        [(Kinds::Motion, "motion", &motions::KINDS), (Kinds::Active, "active intervals", &lifetimes::KINDS)];
    let wanted = |kind: &&Kind| args.only.is_empty() || args.only.iter().any(|part| kind.name.contains(part.as_str()));
    let tables = TABLES.iter().filter(|(table, ..)| args.kinds.is_none_or(|kinds| kinds == *table));
    tables.map(|(_, name, kinds)| (*name, kinds.iter().filter(wanted).collect())).collect()
}

fn print(row: &Row) {
    let requested = row.requested.map_or("     -".to_string(), |requested| format!("{requested:6.2}"));
    println!(
        "{:32}{:8}  build {:6.2} {requested} {:6.2}; work {:6.2} {:5.3} {:5.3}; chosen {}, best {}{}",
        row.kind,
        row.points,
        row.build,
        row.build_of_best,
        row.work,
        row.to_best,
        row.to_best_of_all,
        row.chosen,
        row.best[0],
        if row.best[1] == row.best[0] { String::new() } else { format!(", beyond the budget {}", row.best[1]) },
    );
}
