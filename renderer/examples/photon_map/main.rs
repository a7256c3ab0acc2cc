//! Photon mapping with motion blur, gathered at the time of each camera ray:
//! `cargo run --release --example photon_map`.
//!
//! A glass sphere flies through a room while the shutter is open and throws a caustic on the floor, and the camera
//! follows it; a coloured ball passes a white wall and colours it. Without options the program renders the same scene
//! with three methods, each for the same time, and writes the best to photon_map.png and all of them to
//! photon_map_sheet.png. `--help` lists the rest.

mod photons;
mod picture;
mod progressive;
mod room;
mod sequence;
mod sheet;

use clap::Parser;
use mbkd::glam::Vec3;
use mbkd_renderer::film::save_linear;
use mbkd_renderer::{bar, say, stop_on_interrupt};
use photons::Paths;
use picture::{Method, Pictures, Reach, Settings, pass};
use progressive::Progressive;
use room::Room;
use sheet::{EXPOSURE, Errors, draw, errors};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Renders a moving caustic and moving coloured light on a wall, with photons gathered at the time of each camera ray.
///
/// Without options it compares three ways to treat the photons' times, 30 seconds each, and writes photon_map.png and
/// photon_map_sheet.png. With a reference (made by --reference in some minutes) the sheet shows the error of each.
#[derive(Parser, Debug)]
#[command(name = "photon_map", max_term_width = 100)]
struct Options {
    /// Width in pixels
    #[arg(long, default_value_t = 560, value_parser = clap::value_parser!(u32).range(16..=8192))]
    width: u32,
    /// Height in pixels
    #[arg(long, default_value_t = 420, value_parser = clap::value_parser!(u32).range(16..=8192))]
    height: u32,
    /// Time for each picture
    #[arg(long, default_value_t = 30.0, value_name = "SECONDS", value_parser = seconds)]
    seconds: f64,
    /// Photon paths per pass for rays with their own times [default: three for four pixels]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1000..=100_000_000))]
    photons: Option<u32>,
    /// Photon paths per pass for one time per pass [default: one for four pixels, the best of those tried]
    #[arg(long, value_name = "PHOTONS", value_parser = clap::value_parser!(u32).range(1000..=100_000_000))]
    photons_of_one_time: Option<u32>,
    /// Camera samples per pixel and pass for rays with their own times; powers of two are best
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1024))]
    samples: u32,
    /// How far the camera moves, relative to the path of the glass sphere; 0 is fixed
    #[arg(long, default_value_t = 1.0, value_name = "SHARE", value_parser = share)]
    along: f32,
    /// Random seed
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Render only the picture gathered at ray time
    #[arg(long, conflicts_with_all = ["reference", "progressive"])]
    alone: bool,
    /// Render the reference instead: many passes with one time each and small radii, for --seconds (600 is recommended)
    #[arg(long, conflicts_with = "progressive")]
    reference: bool,
    /// Progressive photon mapping with the inverse gather instead, until Ctrl-C
    #[arg(long)]
    progressive: bool,
    /// Output file, a .png; the sheet and the reference are written beside it
    #[arg(short, long, default_value = "photon_map.png", value_name = "FILE")]
    output: PathBuf,
}

fn seconds(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| *x > 0.0 && *x <= 1e6);
    number.ok_or_else(|| "expected a number of seconds above 0".into())
}

fn share(text: &str) -> Result<f32, String> {
    let number = text.parse::<f32>().ok().filter(|x| (0.0..=1.0).contains(x));
    number.ok_or_else(|| "expected a number from 0 to 1".into())
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            let _ = writeln!(std::io::stderr(), "error: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    if options.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("png")) {
        return Err(format!("{}: pictures are written as .png", options.output.display()));
    }
    let stop = stop_on_interrupt()?;
    let room = Room::new(options.along).map_err(|e| e.to_string())?;
    if options.progressive {
        return progressive(options, &room, &settings(options, Method::RayTime), &stop);
    }
    if options.reference {
        let settings = settings(options, Method::OneTime);
        let settings = Settings {
            paths: Paths { glass: 2 * settings.paths.glass, others: 2 * settings.paths.others },
            caustic: Reach { radius: 0.018, photons: 400, ..settings.caustic },
            indirect: Reach { radius: 0.13, photons: 300, ..settings.indirect },
            shrinks: false,
            seed: !options.seed,
            ..settings
        };
        let [made] = expose(&room, [(Method::OneTime, settings)], options.seconds, &stop);
        save_linear(&made.all, &beside(options, "_reference.pfm"))?;
        save_linear(&made.caustic, &beside(options, "_reference_caustic.pfm"))?;
        made.all.developed(EXPOSURE).save(&beside(options, "_reference.png"))?;
        say(&format!(
            "wrote {} and its caustic, in {} passes",
            beside(options, "_reference.pfm").display(),
            made.passes
        ));
        return Ok(());
    }
    if options.alone {
        let [made] = expose(&room, [(Method::RayTime, settings(options, Method::RayTime))], options.seconds, &stop);
        return save(&made, &options.output);
    }
    let methods = [Method::Ignored, Method::OneTime, Method::RayTime];
    let made = expose(&room, methods.map(|method| (method, settings(options, method))), options.seconds, &stop);
    save(&made[2], &options.output)?;
    let reference = reference(options)?;
    let panel = |method: Method, made: &Pictures| {
        let name = name(method);
        let mut text = vec![
            name.to_string(),
            format!(
                "{:.0} s, {} passes of {}",
                made.spent.as_secs_f64(),
                made.passes,
                settings(options, method).samples
            ),
        ];
        if let Some([all, caustic]) = &reference {
            let Errors { all, caustic } = errors(made, all, caustic);
            say(&format!("{name}: {} passes, relative MSE {all:.5}, in the caustic {caustic:.5}", made.passes));
            text.push(format!("relative MSE {all:.5}"));
            text.push(format!("in the caustic {caustic:.5}"));
        }
        text
    };
    let panels: Vec<_> = made.iter().zip(methods).map(|(made, method)| (&made.all, panel(method, made))).collect();
    let path = beside(options, "_sheet.png");
    draw(&panels).save(&path)?;
    say(&format!("wrote {}", path.display()));
    if reference.is_none() {
        say("no reference of this size, so the sheet shows no errors: --reference makes one");
    }
    Ok(())
}

/// The settings of a method: those with the least error in the caustic for equal time, among those tried.
fn settings(options: &Options, method: Method) -> Settings {
    let pixels = options.width * options.height;
    let (paths, samples) = match method {
        Method::OneTime => (options.photons_of_one_time.unwrap_or(pixels / 4), 1),
        Method::RayTime | Method::Ignored => (options.photons.unwrap_or(pixels / 4 * 3), options.samples),
    };
    Settings {
        width: options.width as usize,
        height: options.height as usize,
        paths: Paths { glass: paths as usize / 2, others: paths as usize / 2 },
        caustic: Reach { radius: 0.07, window: 0.3, photons: 300 },
        indirect: Reach { radius: 0.45, window: 0.2, photons: 150 },
        shrinks: true,
        samples,
        seed: options.seed,
    }
}

/// The name of a method.
fn name(method: Method) -> &'static str {
    match method {
        Method::Ignored => "time ignored",
        Method::OneTime => "one time per pass",
        Method::RayTime => "gathered at ray time",
    }
}

fn save(made: &Pictures, path: &Path) -> Result<(), String> {
    made.all.developed(EXPOSURE).save(path)?;
    say(&format!("wrote {} after {} passes in {:.1} s", path.display(), made.passes, made.spent.as_secs_f64()));
    Ok(())
}

/// Passes by each method until each has used its time or the program is interrupted; at least one of each. The method
/// with the least time so far is next, so that other load on the machine delays all of them alike.
fn expose<const N: usize>(
    room: &Room,
    methods: [(Method, Settings); N],
    seconds: f64,
    stop: &AtomicBool,
) -> [Pictures; N] {
    let budget = Duration::from_secs_f64(seconds);
    let bar = bar((1000.0 * seconds) as u64 * N as u64);
    let mut all = methods.map(|(_, settings)| Pictures::new(&settings));
    // Another pass, if more than half of it fits.
    let wants = |made: &Pictures| match made.passes {
        0 => true,
        passes => made.spent + made.spent / (2 * passes) < budget && !stop.load(Ordering::Relaxed),
    };
    while let Some(next) = (0..N).filter(|&i| wants(&all[i])).min_by_key(|&i| all[i].spent) {
        let (method, settings) = &methods[next];
        pass(room, settings, *method, &mut all[next]);
        bar.set_position(all.iter().map(|made| made.spent.as_millis() as u64).sum());
    }
    bar.finish_and_clear();
    all
}

/// Rounds of progressive photon mapping until interrupted; the picture is written from time to time and at the end.
fn progressive(options: &Options, room: &Room, settings: &Settings, stop: &AtomicBool) -> Result<(), String> {
    let (begin, mut written, mut state) = (Instant::now(), Instant::now(), Progressive::new(settings));
    let mut rounds = 0;
    while !stop.load(Ordering::Relaxed) {
        state.round(room, settings);
        rounds += 1;
        let _ = write!(std::io::stderr(), "\r{rounds} rounds in {:.0} s; Ctrl-C stops", begin.elapsed().as_secs_f64());
        if written.elapsed() > Duration::from_secs(20) || rounds == 1 {
            state.picture(settings).all.developed(EXPOSURE).save(&options.output)?;
            written = Instant::now();
        }
    }
    state.picture(settings).all.developed(EXPOSURE).save(&options.output)?;
    say(&format!("\nwrote {} after {rounds} rounds", options.output.display()));
    Ok(())
}

/// A path with the stem of the picture's.
fn beside(options: &Options, end: &str) -> PathBuf {
    let stem = options.output.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    options.output.with_file_name(format!("{stem}{end}"))
}

/// The reference's light and caustic, if there is one of this size.
fn reference(options: &Options) -> Result<Option<[Vec<Vec3>; 2]>, String> {
    let (all, caustic) = (beside(options, "_reference.pfm"), beside(options, "_reference_caustic.pfm"));
    if !all.exists() || !caustic.exists() {
        return Ok(None);
    }
    let (all, caustic) = (read_pfm(&all, options)?, read_pfm(&caustic, options)?);
    Ok(all.zip(caustic).map(|(all, caustic)| [all, caustic]))
}

/// A portable float map as this program writes it; `None` if it has another size.
fn read_pfm(path: &Path, options: &Options) -> Result<Option<Vec<Vec3>>, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let (width, height) = (options.width as usize, options.height as usize);
    let header = format!("PF\n{width} {height}\n-1.0\n");
    let Some(body) = bytes.strip_prefix(header.as_bytes()) else { return Ok(None) };
    if body.len() != 12 * width * height {
        return Err(format!("{}: the file is incomplete", path.display()));
    }
    let number = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let pixel = |bytes: &[u8]| Vec3::new(number(bytes), number(&bytes[4..]), number(&bytes[8..]));
    let rows = body.chunks(12 * width).rev();
    Ok(Some(rows.flat_map(|row| row.chunks(12).map(pixel)).collect()))
}
