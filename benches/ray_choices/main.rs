//! The quality of the automatic choices of the wide tree, and the gain of each technique.
//!
//! Every scene is built with automatic choices, and with each of them set manually or switched off; two trees at a time
//! answer the same rays in alternation, on one thread. Single rays and batches, medians of ratios.
//!
//! `cargo bench --bench ray_choices > choices.md`; `--help` lists the options. For figures to publish give it an idle
//! core (`taskset -c 1`). All scenes take about half an hour and 2 GB.

mod choices;
mod measure;
mod techniques;

use clap::Parser;
use mbkd::BuildParams;
use mbkd_evidence::options;
use mbkd_evidence::scene_rays::generate;
use mbkd_evidence::timing::on_one_thread;
use mbkd_scenes as scene;
use measure::{Built, COLUMNS};
use rand::SeedableRng;
use rand::rngs::StdRng;
use rand::seq::SliceRandom;

#[derive(Parser)]
#[command(about = "Compares the wide tree's automatic choices with all forced settings")]
struct Args {
    /// Scenes, comma-separated.
    #[arg(long, default_value = "hall,coherent,debris,needles,tornado,mixed,hairball", value_delimiter = ',')]
    scenes: Vec<String>,
    /// Share of each scene's full number of triangles.
    #[arg(long, default_value_t = 1.0)]
    scale: f32,
    /// Width and height of the picture in pixels.
    #[arg(long, default_value_t = 128)]
    side: u32,
    /// Rays in random order instead of tiles of pixels.
    #[arg(long)]
    shuffled: bool,
    /// Timed rounds; each times the automatic tree and another one, and the median of their ratios is used.
    #[arg(long, default_value_t = 7)]
    runs: u32,
    /// Only forced settings whose name contains one of these, comma-separated.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Leave out the table of techniques.
    #[arg(long)]
    no_techniques: bool,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Args = options();
    // One thread for builds, queries and batches.
    let mut techniques = Vec::new();
    for name in &args.scenes {
        let recipe = scene::find(name).ok_or_else(|| {
            let known: Vec<&str> = scene::CATALOGUE.iter().map(|recipe| recipe.name).collect();
            format!("no scene `{name}`; there are {}", known.join(", "))
        })?;
        let scene = (recipe.make)((recipe.full as f32 * args.scale) as usize);
        on_one_thread(|| {
            let automatic = Built::new(&scene.meshes, &BuildParams::default())?;
            let mut rays = generate(&scene.meshes, &scene.camera, args.side, |ray| automatic.tree.closest_hit(ray));
            if args.shuffled {
                let mut random = StdRng::seed_from_u64(0x5eed);
                for kind in [&mut rays.primary, &mut rays.bounce, &mut rays.ao] {
                    kind.shuffle(&mut random);
                }
            }
            choices::compare(&args, &scene, &automatic, &rays);
            if !args.no_techniques {
                techniques.extend(techniques::switched_off(&args, &scene, &automatic, &rays)?);
            }
            Ok::<(), mbkd::BuildError>(())
        })?;
    }
    if !args.no_techniques {
        println!("\n## Gain of each technique\n\nSpeed with it, relative to the speed without.\n");
        println!("| technique | scene | {COLUMNS} |\n|---|---|---|---|---|---|---|---|");
        techniques.sort_by_key(|t| t.order);
        for t in &techniques {
            println!("| {} | {} | {} |", t.name, t.scene, t.speed);
        }
    }
    Ok(())
}
