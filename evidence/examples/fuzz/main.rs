//! Random combinations of everything that the library accepts, against brute force.
//!
//! `cargo run --release -p mbkd-evidence --features fuzz --example fuzz -- --seconds 60` runs cases until the time is
//! over; each has a seed of its own, which counts up from `--seed`. A failure prints the options that repeat it. A panic is
//! a failure.

#[macro_use]
mod compare;
mod bad;
#[path = "../../../tests/support/blob.rs"]
mod blob;
mod clouds;
#[path = "../../../tests/support/encounter.rs"]
mod encounter;
mod gather;
#[path = "../../../tests/support/gather_case.rs"]
mod gather_case;
mod instances;
mod lists;
mod lives;
mod periodic;
mod points;
mod random;
mod rays;
mod scenes;
mod steps;
mod threads;

use clap::{Parser, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
// The support files of tests expect it here.
use mbkd_scenes as scene;
use random::Random;
use rayon::ThreadPool;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::{LazyLock, Mutex};
use std::time::{Duration, Instant};

#[derive(Parser)]
#[command(about = "Compares random combinations of scenes, builds and queries with brute force")]
struct Args {
    /// Run cases for this long.
    #[arg(long, default_value_t = 60)]
    seconds: u64,
    /// Run this many cases instead.
    #[arg(long)]
    cases: Option<u64>,
    /// The seed of the first case; the others count up from it.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only cases of this kind.
    #[arg(long)]
    only: Option<Kind>,
    /// Stop after this many failures.
    #[arg(long, default_value_t = 10)]
    failures: usize,
}

/// What a case is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    Rays,
    Instances,
    Points,
    Lists,
    Gather,
    Bad,
    Steps,
    Lives,
    Threads,
}

impl Kind {
    fn run(self, random: &mut Random) -> compare::Outcome {
        match self {
            Kind::Rays => rays::case(random),
            Kind::Instances => instances::case(random),
            Kind::Points => points::case(random),
            Kind::Lists => lists::case(random),
            Kind::Gather => gather::case(random),
            Kind::Bad => bad::case(random),
            Kind::Steps => steps::case(random),
            Kind::Lives => lives::case(random),
            Kind::Threads => threads::case(random),
        }
    }
}

/// Pools of one thread and of two.
static POOLS: LazyLock<[ThreadPool; 2]> = LazyLock::new(|| {
    [1, 2].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads"))
});

/// Beyond this a case is said to have hung.
const HUNG: Duration = Duration::from_secs(600);

/// Ends the program if a case hangs. The name of each case is set when it begins.
static RUNNING: Mutex<Option<(Instant, String)>> = Mutex::new(None);

fn watch() {
    loop {
        std::thread::sleep(Duration::from_secs(1));
        let running = RUNNING.lock().ok().and_then(|running| running.clone());
        if let Some((_, name)) = running.filter(|(begin, _)| begin.elapsed() > HUNG) {
            println!("{name}\n    has run for {HUNG:?}");
            std::process::exit(1);
        }
    }
}

/// Where the last panic was, and why.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// Runs one case; the error says what went wrong.
fn run(kind: Kind, seed: u64) -> Result<(), String> {
    let mut random = Random::new(seed);
    let pool = &POOLS[random.below(2)];
    let case = || pool.install(|| kind.run(&mut random));
    match catch_unwind(AssertUnwindSafe(case)) {
        Ok(outcome) => outcome,
        Err(_) => Err(format!("panic: {}", PANIC.lock().map(|text| text.clone()).unwrap_or_default())),
    }
}

fn main() -> ExitCode {
    let args = Args::parse();
    std::panic::set_hook(Box::new(|panic| {
        if let Ok(mut text) = PANIC.lock() {
            *text = panic.to_string();
        }
    }));
    std::thread::spawn(watch);
    let progress = ProgressBar::new(args.cases.unwrap_or(args.seconds));
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} {msg}").expect("a template");
    progress.set_style(style);
    let (start, kinds) = (Instant::now(), Kind::value_variants());
    let (mut done, mut failures) = (vec![0u64; kinds.len()], 0);
    let mut slowest = (Duration::ZERO, String::new());
    for seed in args.seed.. {
        let count = seed - args.seed;
        let over = args.cases.map_or(start.elapsed().as_secs() >= args.seconds, |cases| count >= cases);
        if over || failures >= args.failures {
            break;
        }
        let chosen = seed as usize % kinds.len();
        let kind = args.only.unwrap_or(kinds[chosen]);
        let name = format!("--only {} --seed {seed} --cases 1", format!("{kind:?}").to_lowercase());
        progress.set_position(if args.cases.is_some() { count } else { start.elapsed().as_secs() });
        progress.set_message(name.clone());
        let begin = Instant::now();
        if let Ok(mut running) = RUNNING.lock() {
            *running = Some((begin, name.clone()));
        }
        if let Err(what) = run(kind, seed) {
            failures += 1;
            progress.suspend(|| println!("{name}\n    {what}"));
        }
        slowest = slowest.max((begin.elapsed(), name));
        done[kinds.iter().position(|k| *k == kind).unwrap_or_default()] += 1;
    }
    progress.finish_and_clear();
    let counts: Vec<String> = kinds.iter().zip(&done).map(|(kind, n)| format!("{n} {kind:?}")).collect();
    println!("{} cases, {failures} failures: {}", done.iter().sum::<u64>(), counts.join(", ").to_lowercase());
    println!("slowest: {:.1?}, {}", slowest.0, slowest.1);
    if failures > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
