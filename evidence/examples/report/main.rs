//! The evidence on one page: what each structure for moving geometry costs, and how far its answers are off.
//!
//! `cargo run --release --example report` writes a folder with `index.html`, a CSV file of every table and plot, and the
//! plots as SVG; `--quick` takes less than two minutes. docs/report.md says what each section shows.

mod arithmetic;
mod cast;
mod fronts;
mod heat_maps;
mod html;
mod kiddo_peer;
mod measure;
mod memory;
mod neighbor_error;
mod neighbor_lists;
mod page;
mod particle_walk;
mod photon_error;
mod photon_scene;
mod plot;
mod race;
mod render_error;
mod run;
mod sah_models;
mod scaling_points;
mod scaling_rays;
mod shading;
mod tables;
mod time_weights;
mod wide_table;

use clap::Parser;
use mbkd::SimdLevel;
use page::{Item, Section};
use run::Run;
use std::error::Error;
use std::path::{Path, PathBuf};

/// A section: its name, how long it takes in a quick and in a full run (in seconds, for the time left), and how it is
/// made.
struct Recipe {
    id: &'static str,
    seconds: [u64; 2],
    make: fn(&Run) -> Result<Section, Box<dyn Error>>,
}

/// The sections in the order of the page.
const SECTIONS: &[Recipe] = &[
    Recipe { id: "tables", seconds: [10, 60], make: tables::run },
    Recipe { id: "heat-maps", seconds: [3, 60], make: heat_maps::run },
    Recipe { id: "render-error", seconds: [10, 150], make: render_error::run },
    Recipe { id: "neighbor-error", seconds: [6, 80], make: neighbor_error::run },
    Recipe { id: "photon-error", seconds: [4, 60], make: photon_error::run },
    Recipe { id: "neighbor-lists", seconds: [10, 150], make: neighbor_lists::run },
    Recipe { id: "arithmetic", seconds: [2, 15], make: arithmetic::run },
    Recipe { id: "scaling-rays", seconds: [10, 300], make: scaling_rays::run },
    Recipe { id: "scaling-points", seconds: [17, 250], make: scaling_points::run },
];

#[derive(Parser)]
#[command(about = "Measures structures for moving geometry and writes one page: run time against error")]
struct Args {
    /// Smaller scenes and fewer repetitions: less than two minutes on two cores.
    #[arg(long)]
    quick: bool,
    /// Only this section; may be given several times.
    #[arg(long, value_name = "SECTION", value_parser = section_id)]
    only: Vec<String>,
    /// The folder that is written.
    #[arg(short, long, value_name = "DIR", default_value = "report")]
    out: PathBuf,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// The name of a section, or an error that lists them.
fn section_id(name: &str) -> Result<String, String> {
    let ids: Vec<&str> = SECTIONS.iter().map(|recipe| recipe.id).collect();
    if ids.contains(&name) { Ok(name.to_string()) } else { Err(format!("sections are {}", ids.join(", "))) }
}

fn main() -> Result<(), Box<dyn Error>> {
    let args = Args::parse();
    let chosen: Vec<&Recipe> = SECTIONS
        .iter()
        .filter(|recipe| args.only.is_empty() || args.only.iter().any(|name| name == recipe.id))
        .collect();
    std::fs::create_dir_all(&args.out).map_err(|e| format!("{}: {e}", args.out.display()))?;
    let expected = |recipe: &Recipe| recipe.seconds[usize::from(!args.quick)];
    let run = Run::new(args.quick, args.seed, chosen.iter().map(|recipe| expected(recipe)).sum())?;
    let mut sections = Vec::new();
    for recipe in &chosen {
        run.expect(expected(recipe));
        sections.push((recipe.make)(&run).map_err(|e| format!("section {}: {e}", recipe.id))?);
        run.end();
    }
    run.finish();
    let index = write(&args.out, &facts(&args, &run), &sections)?;
    println!("wrote {}", index.display());
    Ok(())
}

/// What the page says about the run.
fn facts(args: &Args, run: &Run) -> Vec<(&'static str, String)> {
    let manifest = include_str!("../../../Cargo.toml");
    let version = manifest.lines().find_map(|line| line.strip_prefix("version = ")).unwrap_or("unknown");
    let mut command = "cargo run --release --example report".to_string();
    let options = args.only.iter().map(|id| format!("--only {id}")).chain(args.quick.then(|| "--quick".to_string()));
    let options: Vec<String> = options.chain((args.seed != 1).then(|| format!("--seed {}", args.seed))).collect();
    if !options.is_empty() {
        command += &format!(" -- {}", options.join(" "));
    }
    vec![
        ("Command", command),
        ("Run", if run.quick { "quick: small scenes, few repetitions".into() } else { "full".into() }),
        ("Processor", processor()),
        ("Instruction set", format!("{} (the library), {} (the peers)", SimdLevel::best(), cast::compiled_for())),
        ("Threads", rayon::current_num_threads().to_string()),
        ("Version of mbkd", version.trim_matches('"').to_string()),
        ("Seed", args.seed.to_string()),
    ]
}

/// The processor's name as the system gives it.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name =
        info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':').map(|(_, name)| name.trim()));
    name.unwrap_or(std::env::consts::ARCH).to_string()
}

/// Writes the page, and each table, plot and picture as a file of its own.
fn write(out: &Path, facts: &[(&str, String)], sections: &[Section]) -> Result<PathBuf, Box<dyn Error>> {
    let save = |name: String, bytes: &[u8]| {
        let path = out.join(name);
        std::fs::write(&path, bytes).map_err(|e| format!("{}: {e}", path.display())).map(|()| path)
    };
    let mut drawings = Vec::new();
    for section in sections {
        let id = section.id;
        for item in &section.items {
            match item {
                Item::Text(_) | Item::Claim { .. } => {}
                Item::Table(table) => {
                    let rows = std::iter::once(&table.columns).chain(&table.rows);
                    save(
                        format!("{id}-{}.csv", table.name),
                        csv(rows.map(|row| row.iter().map(String::as_str))).as_bytes(),
                    )?;
                }
                Item::Plot(plot) => {
                    let heads = vec!["series".to_string(), plot.x.label.clone(), plot.y.label.clone()];
                    let points = plot.series.iter().flat_map(|series| {
                        series.points.iter().map(|(x, y)| vec![series.label.clone(), x.to_string(), y.to_string()])
                    });
                    let rows: Vec<Vec<String>> = std::iter::once(heads).chain(points).collect();
                    let rows = rows.iter().map(|row| row.iter().map(String::as_str));
                    save(format!("{id}-{}.csv", plot.name), csv(rows).as_bytes())?;
                    let drawing = plot::svg(plot)?;
                    save(format!("{id}-{}.svg", plot.name), drawing.as_bytes())?;
                    drawings.push(drawing);
                }
                Item::Picture(picture) => _ = save(format!("{id}-{}.png", picture.name), &picture.png)?,
            }
        }
    }
    Ok(save("index.html".to_string(), html::page(facts, sections, &drawings).as_bytes())?)
}

/// Rows of comma-separated values; what needs quotes has them (RFC 4180).
fn csv<'a>(rows: impl Iterator<Item = impl Iterator<Item = &'a str>>) -> String {
    let mut out = String::new();
    for row in rows {
        let quoted = |cell: &str| match cell.contains([',', '"', '\n']) {
            true => format!("\"{}\"", cell.replace('"', "\"\"")),
            false => cell.to_string(),
        };
        out += &row.map(quoted).collect::<Vec<_>>().join(",");
        out.push('\n');
    }
    out
}
