//! The paper's ablations ([`mbkd_evidence::ablations`]) as one table.
//!
//! `cargo bench --bench ablations > ablations.md`

use clap::Parser;
use mbkd::KdParams;
use mbkd_evidence::ablations::{Row, measure, rays, variants};
use mbkd_evidence::options;
use mbkd_scenes as scene;

#[derive(Parser)]
#[command(about = "Writes the paper's ablation table as Markdown to standard output")]
struct Args {
    /// Scenes, comma-separated.
    #[arg(long, default_value = "hall,hairball,hand,tornado,coherent,needles", value_delimiter = ',')]
    scenes: Vec<String>,
    /// Triangles per scene.
    #[arg(long, default_value_t = 30_000)]
    triangles: usize,
    /// Rays per side of a square picture.
    #[arg(long, default_value_t = 128)]
    side: u32,
    /// Depth of the trees; by default that of the crate.
    #[arg(long)]
    depth: Option<u32>,
    /// References per triangle that a tree may have.
    #[arg(long, default_value_t = 40.0)]
    references: f32,
}

/// By how many percent `a` is less than `b`.
fn less(a: f64, b: f64) -> f64 {
    if b > 0.0 { 100.0 * (1.0 - a / b) } else { 0.0 }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Args = options();
    let paper = KdParams { max_references: args.references, max_depth: args.depth, ..KdParams::paper() };
    let variants = variants(paper);
    println!("About {} triangles per scene, {} camera rays.\n", args.triangles, args.side * args.side);
    println!("| scene | variant | references per triangle | duplicates % | steps per ray | tests per ray |");
    println!("|---|---|---|---|---|---|");
    let mut summary = Vec::new();
    for name in &args.scenes {
        let recipe = scene::find(name).ok_or_else(|| {
            let known: Vec<&str> = scene::CATALOGUE.iter().map(|recipe| recipe.name).collect();
            format!("no scene `{name}`; there are {}", known.join(", "))
        })?;
        let scene = (recipe.make)(args.triangles);
        let rays = rays(args.side, |x, y, time| scene.camera.ray(x, y, 1.0, time));
        let mut rows = Vec::new();
        for (variant, params) in &variants {
            let row = measure(&scene.meshes, &rays, *params)?;
            println!("{}", row.cells(name, variant));
            rows.push(row);
        }
        let ends = |value: fn(&Row) -> f64| 0.5 * (value(&rows[2]) + value(&rows[3]));
        summary.push([
            less(rows[0].references - 1.0, rows[1].references - 1.0),
            less(rows[0].tests, rows[1].tests),
            less(rows[0].tests, ends(|row| row.tests)),
            less(rows[0].steps, ends(|row| row.steps)),
        ]);
    }
    println!(
        "\n| scene | fewer duplicates by time weights % | fewer tests by time weights % | fewer tests at t = 0.5 % | fewer \
         steps at t = 0.5 % |"
    );
    println!("|---|---|---|---|---|");
    println!("| the paper, average | 7 | not given | 12 | 10 |");
    for (name, [duplicates, weighted, tests, steps]) in args.scenes.iter().zip(&summary) {
        println!("| {name} | {duplicates:.1} | {weighted:.1} | {tests:.1} | {steps:.1} |");
    }
    let mean = |i: usize| summary.iter().map(|row| row[i]).sum::<f64>() / summary.len().max(1) as f64;
    println!("| mean | {:.1} | {:.1} | {:.1} | {:.1} |", mean(0), mean(1), mean(2), mean(3));
    println!(
        "\nDuplicates are references beyond the first of each triangle; their share is of all references. A step is a \
         visit of an inner node or leaf. The gain of t = 0.5 is against the mean of t = 0 and t = 1. Trees \
         end where a split no longer pays or the reference budget is spent, so the variants differ in size as well; a \
         small budget (--references 6) compares trees of nearly equal size."
    );
    Ok(())
}
