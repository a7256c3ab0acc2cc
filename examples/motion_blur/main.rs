//! A small renderer with motion blur: `cargo run --release --example motion_blur`, `--help` for the rest.
//!
//! Data flows through the modules in this order: `options` (the command line), `staging` (a procedural scene
//! or `readers` of files become a `stage`), `world` (the tree), `render` (tiles) with `integrator` (light along a ray),
//! `sampling`, `sky` and `materials`, and at last `film` (pictures and files), `heatmap` or `animation`.

mod film;
mod integrator;
mod materials;
mod options;
mod render;
mod sampling;
mod sky;
mod stage;
mod staging;
mod world;

use clap::Parser;
use film::{Film, save_linear};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mbkd::BuildParams;
use options::{Options, policy_name};
use render::{Cost, Job, render};
use stage::Stage;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use world::World;

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    if let Some(threads) = options.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads as usize);
        pool.build_global().map_err(|e| format!("cannot start {threads} threads: {e}"))?;
    }
    let outputs = outputs(options)?;
    let stop = stop_on_interrupt()?;
    picture(options, &outputs, &stop)
}

/// The files to write, after looking at their extensions before any work is done.
fn outputs(options: &Options) -> Result<Vec<PathBuf>, String> {
    let outputs = if options.output.is_empty() { vec!["motion_blur.png".into()] } else { options.output.clone() };
    for path in &outputs {
        let known = ["png", "exr", "pfm"].iter().any(|e| path.extension().is_some_and(|p| p.eq_ignore_ascii_case(e)));
        if !known {
            return Err(format!("{}: pictures are written as .png, .exr or .pfm", path.display()));
        }
    }
    Ok(outputs)
}

/// A flag that the first Ctrl-C sets; the second ends the program at once.
fn stop_on_interrupt() -> Result<Arc<AtomicBool>, String> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    let handler = move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(handler).map_err(|e| format!("cannot listen to Ctrl-C: {e}"))?;
    Ok(stop)
}

/// One picture.
fn picture(options: &Options, outputs: &[PathBuf], stop: &AtomicBool) -> Result<(), String> {
    let stage = staging::stage(options)?;
    let world = build(options, &stage)?;
    let job = job(options);
    let bar = bar(job.steps());
    let begin = Instant::now();
    let (film, cost) = render(&world, &stage, &job, stop, &bar);
    let spent = begin.elapsed();
    bar.finish_and_clear();
    if stop.load(Ordering::Relaxed) {
        println!("interrupted: writing what is done");
    }
    report(&cost, spent);
    for path in outputs {
        save(&film, &stage, path)?;
    }
    Ok(())
}

/// The tree of a stage, with a line about it.
fn build(options: &Options, stage: &Stage) -> Result<World, String> {
    let params = match options.policy {
        Some(policy) => BuildParams { policy, ..BuildParams::default() },
        None => BuildParams::default(),
    };
    let begin = Instant::now();
    let world = World::build(&stage.things, &params).map_err(|e| format!("{}: {e}", stage.name))?;
    let (spent, statistics) = (begin.elapsed(), world.statistics());
    println!(
        "{}: {} {}, {} tree built in {:.2} s, {:.2} references each, {:.1} MB",
        stage.name,
        stage.things.count(),
        stage.things.noun(),
        policy_name(params.policy),
        spent.as_secs_f64(),
        statistics.references_per_primitive(),
        (statistics.bytes + statistics.primitive_bytes) as f64 / 1e6,
    );
    Ok(world)
}

fn job(options: &Options) -> Job {
    Job {
        width: options.width as usize,
        height: options.height as usize,
        samples: options.spp,
        bounces: options.bounces,
        seed: options.seed,
        shutter: (0.0, 1.0),
    }
}

fn bar(steps: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {elapsed} spent, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

/// Speed, and work per ray.
fn report(cost: &Cost, spent: Duration) {
    let counted = cost.counted_rays.max(1) as f64;
    println!(
        "{:.1} M rays in {:.1} s: {:.2} Mrays/s, {:.1} steps and {:.1} tests per ray",
        cost.rays as f64 / 1e6,
        spent.as_secs_f64(),
        cost.rays as f64 / 1e6 / spent.as_secs_f64().max(1e-9),
        cost.counters.steps() as f64 / counted,
        cost.counters.primitive_tests as f64 / counted,
    );
}

/// Writes a picture in the format its name asks for, and says so.
fn save(film: &Film, stage: &Stage, path: &Path) -> Result<(), String> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        film.developed(stage.sky.exposure).save(path)?;
    } else {
        save_linear(film, path)?;
    }
    println!("wrote {}", path.display());
    Ok(())
}
