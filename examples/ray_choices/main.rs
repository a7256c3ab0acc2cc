//! How good the automatic choices of the wide tree are, and what each technique brings: every scene built with the
//! choices left to the build, and with each of them made by hand, single rays and batches in turns.
//!
//! `cargo run --release --example ray_choices > choices.md`; `--help` lists what can be chosen.

#[path = "../../benches/embree/clock.rs"]
mod clock;
#[path = "../../benches/embree/geometry.rs"]
#[allow(dead_code)] // its referee is the other program's
mod geometry;
mod measure;
#[path = "../../benches/embree/rays.rs"]
mod rays;

use clap::Parser;
use mbkd::scene::{self, Scene};
use mbkd::{BuildError, BuildParams, Division};
use measure::{Built, COLUMNS, Row};

#[derive(Parser)]
#[command(about = "Compares the wide tree's automatic choices with all that hand settings reach")]
struct Args {
    /// Scenes, comma-separated.
    #[arg(long, default_value = "hall,coherent,debris,needles,hand,tornado,hairball", value_delimiter = ',')]
    scenes: Vec<String>,
    /// Share of each scene's full number of triangles.
    #[arg(long, default_value_t = 1.0)]
    scale: f32,
    /// Width and height of the picture in pixels.
    #[arg(long, default_value_t = 128)]
    side: u32,
    /// Timed rounds; each times the automatic tree and the other, and their median ratio counts.
    #[arg(long, default_value_t = 5)]
    runs: u32,
    /// Only hand settings whose name contains one of these, comma-separated.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
}

/// Every way to divide the shutter by hand, and cuts forbidden or freer.
fn by_hand() -> Vec<(String, BuildParams)> {
    let divisions = [
        Division::Whole,
        Division::Segments(2),
        Division::Segments(4),
        Division::Segments(8),
        Division::Copies(2),
        Division::Copies(4),
        Division::Copies(8),
        Division::Copies(16),
    ];
    let mut all = Vec::new();
    for division in divisions {
        let name = match division {
            Division::Segments(n) => format!("{n} segments"),
            Division::Copies(n) => format!("{n} copies"),
            _ => "whole".into(),
        };
        let params = BuildParams { division, ..BuildParams::default() };
        all.push((format!("{name} without cuts"), BuildParams { wide_references: 1.0, ..params.clone() }));
        all.push((name, params));
    }
    all
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args = Args::parse();
    // One thread builds, asks, and answers batches.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    for name in &args.scenes {
        let recipe = scene::find(name).ok_or_else(|| {
            let known: Vec<&str> = scene::CATALOGUE.iter().map(|recipe| recipe.name).collect();
            format!("no scene `{name}`; there are {}", known.join(", "))
        })?;
        let scene = (recipe.make)((recipe.full as f32 * args.scale) as usize);
        pool.install(|| compare(&args, &scene)).map_err(|error| error.to_string())?;
    }
    Ok(())
}

fn compare(args: &Args, scene: &Scene) -> Result<(), BuildError> {
    let automatic = Built::new(&scene.meshes, &BuildParams::default())?;
    let rays = rays::generate(&scene.meshes, &scene.camera, args.side, |ray| automatic.tree.closest_hit(ray));
    println!("\n## {}, {} triangles\n", scene.name, scene.triangles());
    println!("| | MB | build s | {COLUMNS} |");
    println!("|---|---|---|---|---|---|---|---|---|");
    println!("| automatic | {:.0} | {:.2} |", automatic.megabytes(), automatic.seconds);
    let mut best = Row::default();
    let mut last = None;
    let wanted = |name: &str| args.only.is_empty() || args.only.iter().any(|part| name.contains(part.as_str()));
    for (name, params) in by_hand().into_iter().filter(|(name, _)| wanted(name)) {
        let built = match Built::new(&scene.meshes, &params) {
            Ok(built) => built,
            Err(error) => {
                println!("| {name} | {error} |");
                continue;
            }
        };
        // Without anything to cut both are the same tree.
        let work = built.work(&rays);
        if last.replace(work) == Some(work) {
            continue;
        }
        let speed = Row::speed(&built, &automatic, &rays, args.runs);
        println!("| {name} | {:.0} | {:.2} | {speed} |", built.megabytes(), built.seconds);
        best = best.max(speed);
    }
    println!("| best | | | {best} |");
    Ok(())
}
