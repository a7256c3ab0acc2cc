//! A dam break by smoothed particle hydrodynamics, rendered with motion blur: `cargo run --release --example particles`,
//! `--help` for the rest.
//!
//! Every step builds a `PointTree` and queries all neighbours of all particles, including wall particles. Every picture
//! puts the particles, as spheres that move with their velocities while the shutter is open, into a `RayTree`.

mod kernel;
mod rivals;
mod sph;
#[path = "../../../evidence/examples/neighbors_of_files/formats.rs"]
mod table;
mod tank;
mod vtk;

use clap::Parser;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mbkd::NeighborLists;
use mbkd::glam::Vec3;
use mbkd_renderer::fluid::{Drop, Photo, Shot, Tank, expose, gif, strip};
use rivals::Look;
use sph::{Fluid, GRAVITY};
use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use table::Table;

/// A dam break by smoothed particle hydrodynamics, rendered with motion blur.
///
/// Without arguments it simulates 15 000 particles until the wave comes back, and renders six pictures and a GIF, in about
/// two minutes.
#[derive(Parser, Debug)]
#[command(name = "particles", max_term_width = 100)]
struct Options {
    /// Approximate number of particles
    #[arg(long, default_value_t = 15_000, value_parser = clap::value_parser!(u32).range(100..=2_000_000))]
    particles: u32,
    /// Particles from a file instead (.pset, .bgeo, .vtk; y up, metres), in a tank of matching size
    #[arg(long, value_name = "FILE", conflicts_with = "particles")]
    start: Option<PathBuf>,
    /// Simulated time in seconds
    #[arg(long, default_value_t = 1.5, value_parser = above_zero)]
    seconds: f64,
    /// Number of steps, instead of a time
    #[arg(long, conflicts_with = "seconds", value_parser = clap::value_parser!(u32).range(1..))]
    steps: Option<u32>,
    /// Output files: NAME.png (a strip of six pictures) and NAME.gif
    #[arg(long, default_value = "particles", value_name = "NAME")]
    output: PathBuf,
    /// Also write each picture of the strip, as NAME_1.png and so on
    #[arg(long)]
    each: bool,
    /// Also write the particles at each picture of the strip, as NAME_1.vtk and so on, for ParaView
    #[arg(long)]
    vtk: bool,
    /// Only simulate
    #[arg(long)]
    no_pictures: bool,
    /// Frames of the GIF
    #[arg(long, default_value_t = 36, value_parser = clap::value_parser!(u32).range(6..=1000))]
    frames: u32,
    /// Width in pixels of a picture of the strip; frames of the GIF have three fifths
    #[arg(long, default_value_t = 540, value_parser = clap::value_parser!(u32).range(90..=4000))]
    width: u32,
    /// Samples per pixel; frames of the GIF have a third
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=4096))]
    samples: u32,
    /// Number of threads [default: all]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
}

fn above_zero(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|&x: &f64| x.is_finite() && x > 0.0).ok_or("a number above zero".into())
}

/// Pictures of the strip.
const PICTURES: u32 = 6;
/// The greatest number of particles that would fill a tank.
const MOST_PLACES: f64 = 1e8;
/// The number of comparisons with other methods for the same lists.
const LOOKS: u32 = 12;

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            let _ = writeln!(std::io::stderr(), "error: {e}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    if let Some(threads) = options.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global()?;
    }
    let (mut fluid, tank) = begin(options)?;
    let count = fluid.at.len();
    say(&format!(
        "{count} particles, {:.1} mm apart, kernel radius {:.1} mm",
        1e3 * fluid.spacing,
        1e3 * fluid.kernel.radius
    ));
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let (mut looks, mut lists) = (Vec::new(), NeighborLists::new());
    let (mut pictures, mut frames) = (Vec::new(), Vec::new());
    let bar = bar(options.steps.map_or(fluid.steps_for(options.seconds), |steps| steps as usize) as u64);
    let (mut simulating, mut rendering, mut frame) = (Duration::ZERO, Duration::ZERO, 0);
    report(&fluid, &bar);
    loop {
        // The progress of the simulation, from 0 to 1.
        let done = match options.steps {
            Some(steps) => fluid.steps as f64 / f64::from(steps),
            None => fluid.time / options.seconds,
        };
        if done * f64::from(LOOKS) >= looks.len() as f64 && looks.len() < LOOKS as usize {
            looks.push(one_thread.install(|| rivals::look(&fluid.at, fluid.kernel.radius, &mut lists))?);
        }
        // Several at once where there are fewer steps than frames.
        while frame < options.frames && done * f64::from(options.frames - 1) >= f64::from(frame) {
            // The last frame of each sixth is also a picture of the strip.
            let ends_sixth = (frame + 1) * PICTURES / options.frames > frame * PICTURES / options.frames;
            if ends_sixth {
                report(&fluid, &bar);
            }
            let before = Instant::now();
            let picture = ends_sixth.then_some(frame * PICTURES / options.frames + 1);
            take(options, &fluid, &tank, picture, (&mut pictures, &mut frames))?;
            rendering += before.elapsed();
            frame += 1;
        }
        if done >= 1.0 {
            break;
        }
        let left = options.steps.map_or(options.seconds - fluid.time, |_| f64::INFINITY);
        let before = Instant::now();
        fluid.step(left.max(1e-9)).map_err(|e| format!("step {}: {e}", fluid.steps + 1))?;
        simulating += before.elapsed();
        bar.set_position(fluid.steps as u64);
    }
    bar.finish_and_clear();
    summary(&fluid, simulating, rendering, &looks);
    if let Some(strip) = strip(&pictures, 2) {
        let path = options.output.with_extension("png");
        strip.save(&path)?;
        say(&format!("wrote {}", path.display()));
        let path = options.output.with_extension("gif");
        gif(&frames, path.clone(), 0.08)?;
        say(&format!("wrote {}", path.display()));
    }
    Ok(())
}

/// The fluid at the beginning, and its tank.
fn begin(options: &Options) -> Result<(Fluid, Tank), Box<dyn Error>> {
    let (at, velocity, spacing, tank) = match &options.start {
        None => {
            let (tank, column) = tank::dam();
            let (at, spacing) = tank::lattice(column, options.particles as usize);
            let velocity = vec![Vec3::ZERO; at.len()];
            (at, velocity, spacing, tank)
        }
        Some(path) => {
            let (at, velocity) = read(path)?;
            let spacing = spacing(&at)?;
            let tank = tank::around(&at, spacing);
            let sides = (tank.inside[1].as_dvec3() - tank.inside[0].as_dvec3()) / f64::from(spacing);
            let places = sides.element_product();
            if places.is_nan() || places > MOST_PLACES {
                let path = path.display();
                let message = format!("a tank around all particles would hold {places:.0e}, more than {MOST_PLACES:e}");
                return Err(format!("{path}: {message}: is one far from the others?").into());
            }
            (at, velocity, spacing, tank)
        }
    };
    let walls = tank::walls(&tank, spacing);
    Ok((Fluid::new(at, velocity, spacing, tank.clone(), &walls)?, tank))
}

/// Positions and velocities, zero where the file has none.
fn read(path: &Path) -> Result<(Vec<Vec3>, Vec<Vec3>), Box<dyn Error>> {
    let table = Table::open(path)?.ok_or("only .pset, .bgeo and .vtk files are read")?;
    let columns = |names: [&str; 3]| {
        let [x, y, z] = names.map(|name| table.names.iter().position(|n| n == name));
        Some([x?, y?, z?])
    };
    let rows = table.frames.first().ok_or("the file has no frame")?;
    let of = |columns: [usize; 3]| rows.iter().map(move |row| Vec3::from_array(columns.map(|c| row[c]))).collect();
    let at: Vec<Vec3> = of(columns(["x", "y", "z"]).ok_or("the file has no columns x, y, z")?);
    let velocity = columns(["vx", "vy", "vz"]).map_or_else(|| vec![Vec3::ZERO; at.len()], of);
    if at.iter().chain(&velocity).any(|v| !v.is_finite()) {
        return Err(format!("{}: a value is not finite", path.display()).into());
    }
    Ok((at, velocity))
}

/// The median distance to the nearest neighbour.
fn spacing(at: &[Vec3]) -> Result<f32, Box<dyn Error>> {
    let tree = mbkd::PointTree::build(at, &mbkd::PointParams::default())?;
    let nearest = |p: &Vec3| tree.nearest_n(*p, 0.0, 2).last().map_or(0.0, |n| n.distance_squared.sqrt());
    let mut nearest: Vec<f32> = at.iter().map(nearest).collect();
    nearest.sort_by(f32::total_cmp);
    let median = nearest.get(nearest.len() / 2).copied().unwrap_or(0.0);
    if median > 0.0 { Ok(median) } else { Err("all particles are at the same position".into()) }
}

/// Renders a frame, and the picture of the strip with this number if one is due.
fn take(
    options: &Options,
    fluid: &Fluid,
    tank: &Tank,
    picture: Option<u32>,
    (pictures, frames): (&mut Vec<Photo>, &mut Vec<Photo>),
) -> Result<(), Box<dyn Error>> {
    if options.vtk
        && let Some(number) = picture
    {
        let path = numbered(options, number, "vtk");
        vtk::write(&path, &fluid.at, &fluid.velocity, &fluid.density)
            .map_err(|e| format!("{}: {e}", path.display()))?;
        say(&format!("wrote {}", path.display()));
    }
    if options.no_pictures {
        return Ok(());
    }
    // An eightieth of a second: half the frame time of a camera at forty frames per second.
    let shutter = 0.0125;
    let [low, high] = tank.inside;
    let fast = (-2.0 * GRAVITY.y * (high.y - low.y)).sqrt();
    let drop = |(at, velocity): (&Vec3, &Vec3)| Drop {
        at: *at,
        way: *velocity * shutter,
        color: water(velocity.length() / fast),
    };
    let drops: Vec<Drop> = fluid.at.iter().zip(&fluid.velocity).map(drop).collect();
    let shot = |width: u32, samples| Shot { width: width as usize, height: (width * 9 / 16) as usize, samples };
    let radius = 0.56 * fluid.spacing;
    frames.push(expose(&drops, radius, tank, shot(options.width * 3 / 5, options.samples.div_ceil(3)))?);
    if let Some(number) = picture {
        let mut photo = expose(&drops, radius, tank, shot(options.width, options.samples))?;
        photo.caption(&format!("{:.2} S", fluid.time));
        if options.each {
            photo.save(&numbered(options, number, "png"))?;
        }
        pictures.push(photo);
    }
    Ok(())
}

/// Deep blue at rest, white at high speed.
fn water(speed: f32) -> Vec3 {
    let colors =
        [Vec3::new(0.02, 0.10, 0.34), Vec3::new(0.05, 0.36, 0.66), Vec3::new(0.55, 0.80, 0.90), Vec3::splat(0.94)];
    let along = (speed * 3.2).clamp(0.0, 2.999);
    let below = along as usize;
    colors[below].lerp(colors[below + 1], along - below as f32)
}

fn numbered(options: &Options, number: u32, extension: &str) -> PathBuf {
    let stem = options.output.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    options.output.with_file_name(format!("{stem}_{number}.{extension}"))
}

/// A line of conserved quantities, above the progress bar.
fn report(fluid: &Fluid, bar: &ProgressBar) {
    let sums = fluid.sums();
    bar.suspend(|| {
        say(&format!(
            "step {:>5}  {:.3} s  mass {:.6} kg  momentum {:>7.2} {:>7.2} {:>7.2} kg m/s (unexplained {:.0e})  \
             energy {:.1} = {:.1} kinetic + {:.1} potential + {:.1} elastic J  fastest {:.2} m/s",
            fluid.steps,
            fluid.time,
            sums.mass,
            sums.momentum.x,
            sums.momentum.y,
            sums.momentum.z,
            sums.unexplained.length(),
            sums.kinetic + sums.potential + sums.elastic,
            sums.kinetic,
            sums.potential,
            sums.elastic,
            sums.fastest,
        ));
    });
}

fn summary(fluid: &Fluid, simulating: Duration, rendering: Duration, looks: &[Look]) {
    let (steps, count) = (fluid.steps.max(1) as f64, fluid.at.len() as f64);
    let put_back = match fluid.put_back {
        0 => "no particle left the tank".to_string(),
        times => format!("particles stopped at a wall {times} times"),
    };
    say(&format!(
        "{} steps, {:.2} s of water, in {:.1} s ({:.1} s of it for neighbours), and {:.1} s for pictures; {put_back}",
        fluid.steps,
        fluid.time,
        simulating.as_secs_f64(),
        fluid.neighbors.as_secs_f64(),
        rendering.as_secs_f64(),
    ));
    let each = fluid.neighbors.as_secs_f64() * 1e9 / (steps * count);
    say(&format!(
        "neighbours (tree, lists, walls): {:.0} ns per particle and step on {} threads, {:.1} neighbours each",
        each,
        rayon::current_num_threads(),
        fluid.listed as f64 / count,
    ));
    let median = |of: fn(&Look) -> Duration| {
        let mut times: Vec<Duration> = looks.iter().map(of).collect();
        times.sort();
        times.get(times.len() / 2).map_or(0.0, |t| t.as_secs_f64() * 1e9 / count)
    };
    let (ours, kiddo, grid) = (median(|l| l.ours), median(|l| l.kiddo), median(|l| l.grid));
    say(&format!(
        "lists of the fluid at {} steps, on one thread, builds included: {ours:.0} ns per particle; \
         kiddo {kiddo:.0} ({:.1} x), a plain grid of cells {grid:.0} ({:.1} x)",
        looks.len(),
        kiddo / ours,
        grid / ours,
    ));
}

fn bar(steps: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr_with_hz(4));
    let style = ProgressStyle::with_template("{bar:40} step {pos} of about {len}  {elapsed} elapsed, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

/// Prints a line; a closed output is no reason to stop.
fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}
