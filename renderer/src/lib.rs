//! The renderer behind `cargo run --release --example motion_blur`; `--help` lists what it can do.
//!
//! Data flows through the modules in this order: `options` (the command line), `staging` (a procedural scene or
//! `readers` of files become a `stage`), `world` (the tree), `render` (tiles) with `integrator` (light along a ray),
//! `sampling`, `sky`, `lamps`, `materials` and `gloss` (of `microfacets`), and finally `film` (pictures and files),
//! `parts` (files of parts of a picture, and merging them), `heatmap` or `animation`. `farm` prints the commands that
//! render parts.

mod animation;
mod farm;
pub mod film;
pub mod fluid;
pub mod font;
mod gloss;
mod heatmap;
mod integrator;
mod lamps;
mod materials;
mod microfacets;
mod options;
mod parts;
pub mod readers;
mod render;
pub mod sampling;
mod sky;
mod smooth;
mod stage;
mod staging;
#[cfg(test)]
mod tests;
mod world;

use animation::{Animation, numbered};
use clap::Parser;
use film::{Film, save_linear};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mbkd::{BuildParams, Policy};
use options::{Command, Heat, Options, policy_name};
use parts::Part;
use render::{Cost, Job, SQUARE, render};
use stage::Stage;
use staging::Source;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use world::World;

/// The whole program: reads the command line, renders, writes files; errors go to standard error.
pub fn main() -> ExitCode {
    match run(&Options::parse(), stop_on_interrupt) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            let _ = writeln!(std::io::stderr(), "error: {message}");
            ExitCode::FAILURE
        }
    }
}

/// Executes a command line. `listen` returns the flag that ends rendering when it is set.
fn run(options: &Options, listen: fn() -> Result<Arc<AtomicBool>, String>) -> Result<(), String> {
    if let Some(Command::Merge { parts, output }) = &options.command {
        return merge(parts, &outputs(output)?);
    }
    farm::check(options)?;
    if let Some(parts) = options.list_commands {
        farm::commands(options, parts, std::env::args()).iter().for_each(|line| say(line));
        return Ok(());
    }
    if let Some(threads) = options.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads as usize);
        pool.build_global().map_err(|e| format!("cannot start {threads} threads: {e}"))?;
    }
    let outputs = outputs(&options.output)?;
    if farm::is_part(options) && outputs.iter().any(|path| !is(path, "exr")) {
        return Err("parts of pictures are written as .exr: say where to with -o".into());
    }
    let stop = listen()?;
    match (options.heatmap, options.frames) {
        (Some(kind), _) => heat(options, kind, &outputs, &stop),
        (None, _) if !options.compare.is_empty() => heat(options, Heat::Steps, &outputs, &stop),
        (None, Some(frames)) => sequence(options, frames, &outputs, &stop),
        (None, None) => picture(options, &outputs, &stop),
    }
}

/// The files to write; checks their extensions before any work is done.
fn outputs(wanted: &[PathBuf]) -> Result<Vec<PathBuf>, String> {
    let outputs = if wanted.is_empty() { vec!["motion_blur.png".into()] } else { wanted.to_vec() };
    for path in &outputs {
        if !["png", "exr", "pfm"].iter().any(|kind| is(path, kind)) {
            return Err(format!("{}: pictures are written as .png, .exr or .pfm", path.display()));
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(format!("{}: there is no folder {}", path.display(), folder.display()));
        }
    }
    Ok(outputs)
}

/// A flag that the first Ctrl-C sets; the second ends the program at once.
pub fn stop_on_interrupt() -> Result<Arc<AtomicBool>, String> {
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

/// One picture, in all requested formats.
fn picture(options: &Options, outputs: &[PathBuf], stop: &AtomicBool) -> Result<(), String> {
    let stage = Source::open(options)?.stage(options, 0, 1)?;
    let world = build(&stage, options.policy)?;
    let film = expose(&world, &stage, &job(options), stop)?;
    outputs.iter().try_for_each(|path| save(&film, stage.sky.exposure, &job(options), options, path))
}

/// Merges parts into a picture.
fn merge(parts: &[PathBuf], outputs: &[PathBuf]) -> Result<(), String> {
    let named = |path: &PathBuf| Ok((path.display().to_string(), Part::open(path)?));
    let parts = parts.iter().map(named).collect::<Result<Vec<_>, String>>()?;
    let (film, whole) = parts::merge(&parts)?;
    let [width, height] = whole.size;
    say(&format!("{} parts: {width} x {height} pixels with {} samples each", parts.len(), whole.samples));
    outputs.iter().try_for_each(|path| save_whole(&film, whole.exposure, path))
}

/// A sequence of pictures, or one of its frames. A procedural scene has one shutter, which is divided among the frames;
/// a model is posed for each frame.
fn sequence(options: &Options, frames: u32, outputs: &[PathBuf], stop: &AtomicBool) -> Result<(), String> {
    let source = Source::open(options)?;
    let gif = outputs[0].with_extension("gif");
    let mut animation = match options.frame {
        None => Some(Animation::begin(gif.clone(), source.duration(options, frames)? / f64::from(frames))),
        Some(_) => None,
    };
    let mut made: Option<(Stage, World)> = None;
    for frame in options.frame.map_or(0..frames, |frame| frame..frame + 1) {
        let (stage, world) = match (made.take(), &source) {
            (Some(made), Source::Scene) => made,
            _ => {
                let stage = source.stage(options, frame, frames)?;
                let world = build(&stage, options.policy)?;
                (stage, world)
            }
        };
        let mut job = job(options);
        if matches!(source, Source::Scene) {
            let open = frame as f32 / frames as f32;
            job.shutter = (open, open + 0.5 / frames as f32);
        }
        say(&format!("frame {} of {frames}", frame + 1));
        let film = expose(&world, &stage, &job, stop)?;
        if let Some(animation) = &mut animation {
            animation.add(&film.filtered().developed(stage.sky.exposure))?;
        }
        for path in outputs {
            save(&film, stage.sky.exposure, &job, options, &numbered(path, frame))?;
        }
        if stop.load(Ordering::Relaxed) {
            break;
        }
        made = Some((stage, world));
    }
    if let Some(animation) = animation {
        animation.end()?;
        say(&format!("wrote {}", gif.display()));
    }
    Ok(())
}

/// Heat maps of one or several policies.
fn heat(options: &Options, kind: Heat, outputs: &[PathBuf], stop: &AtomicBool) -> Result<(), String> {
    if outputs.iter().any(|path| !is_png(path)) {
        return Err("heat maps are written as .png".into());
    }
    let stage = Source::open(options)?.stage(options, 0, 1)?;
    let policies =
        if options.compare.is_empty() { vec![options.policy.unwrap_or_default()] } else { options.compare.clone() };
    let job = job(options);
    let mut maps = Vec::new();
    for policy in policies {
        let world = build(&stage, Some(policy))?;
        let Some(map) = heatmap::count(&world, &stage, &job, kind, policy_name(policy).into(), stop) else {
            return Err("interrupted before the map was complete".into());
        };
        say(&format!("{}: {:.1} {} per camera ray, at most {:.1}", map.title, map.mean(), kind.noun(), map.most()));
        maps.push(map);
    }
    let picture = heatmap::draw(&maps, &job, kind);
    for path in outputs {
        picture.save(path)?;
        say(&format!("wrote {}", path.display()));
    }
    Ok(())
}

/// Renders with a progress bar and reports. After an interrupt the picture is kept if every pixel has a sample.
fn expose(world: &World, stage: &Stage, job: &Job, stop: &AtomicBool) -> Result<Film, String> {
    let bar = bar(job.steps());
    let begin = Instant::now();
    let (mut film, cost) = render(world, stage, job, stop, &bar);
    let spent = begin.elapsed();
    bar.finish_and_clear();
    if stop.load(Ordering::Relaxed) {
        farm::whole_part(job, &film)?;
        let all = film.samples.len();
        let sampled = film.samples.iter().filter(|&&n| n > 0).count();
        if film.fill_squares(SQUARE) > 0 {
            return Err("interrupted before the first samples: no picture is written".into());
        }
        say(&match sampled == all {
            true => "interrupted: writing the picture with fewer samples than requested".to_string(),
            false => format!(
                "interrupted in the first pass: writing a coarse picture, in which {:.0} % of the pixels are copied from a neighbour",
                100.0 * (all - sampled) as f64 / all as f64
            ),
        });
    }
    report(&cost, spent);
    Ok(film)
}

/// Builds the tree of a stage, and prints a line about it.
fn build(stage: &Stage, policy: Option<Policy>) -> Result<World, String> {
    let params = BuildParams { policy: policy.unwrap_or_default() };
    let begin = Instant::now();
    let world = World::build(&stage.things, &params).map_err(|e| format!("{}: {e}", stage.name))?;
    let (spent, statistics) = (begin.elapsed(), world.statistics());
    say(&format!(
        "{}: {} {}, {} tree built in {:.2} s\n  {statistics}",
        stage.name,
        stage.things.count(),
        stage.things.noun(),
        policy_name(params.policy),
        spent.as_secs_f64(),
    ));
    Ok(world)
}

fn job(options: &Options) -> Job {
    let whole = Job::new(options.width as usize, options.height as usize, options.spp);
    Job {
        bounces: options.bounces,
        caustics: options.caustics,
        seed: options.seed,
        taken: options.samples.unwrap_or(whole.taken),
        region: options.tile.unwrap_or(whole.region),
        ..whole
    }
}

/// A bar with the time left, for this many steps.
pub fn bar(steps: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {elapsed} elapsed, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

/// Prints a line; a closed output is no reason to stop.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Prints a warning, separated from other lines.
fn warn(line: &str) {
    let _ = writeln!(std::io::stderr(), "warning: {line}");
}

/// Prints the speed, and the work per ray.
fn report(cost: &Cost, spent: Duration) {
    let counted = cost.counted_rays.max(1) as f64;
    say(&format!(
        "{:.1} M rays in {:.1} s: {:.2} Mrays/s, {:.1} steps and {:.1} tests per ray",
        cost.rays as f64 / 1e6,
        spent.as_secs_f64(),
        cost.rays as f64 / 1e6 / spent.as_secs_f64().max(1e-9),
        cost.counters.steps() as f64 / counted,
        cost.counters.primitive_tests as f64 / counted,
    ));
}

fn is_png(path: &Path) -> bool {
    is(path, "png")
}

/// Whether a file has this extension.
fn is(path: &Path, kind: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(kind))
}

/// Writes a picture or a part of one, and reports it.
fn save(film: &Film, exposure: f32, job: &Job, options: &Options, path: &Path) -> Result<(), String> {
    if !farm::is_part(options) {
        return save_whole(film, exposure, path);
    }
    Part::new(job, film.clone(), exposure, farm::about(options)).save(path)?;
    say(&format!("wrote {}: samples {} to {} of {}", path.display(), job.taken.0, job.taken.1, job.samples));
    Ok(())
}

/// Writes a picture in the format of its extension, and reports it.
fn save_whole(film: &Film, exposure: f32, path: &Path) -> Result<(), String> {
    if is_png(path) {
        film.filtered().developed(exposure).save(path)?;
    } else {
        save_linear(film, path)?;
    }
    say(&format!("wrote {}", path.display()));
    Ok(())
}
