//! One run of the report: how long it may take, its seed, its progress, and how it times things.

use indicatif::{ProgressBar, ProgressStyle};
use mbkd_evidence::timing::timed;
use std::cell::Cell;
use std::error::Error;
use std::time::Instant;

/// How the sections are run.
pub struct Run {
    /// Whether all sections together should take less than two minutes.
    pub quick: bool,
    /// The seed of all random numbers.
    pub seed: u64,
    bar: ProgressBar,
    /// Ticks of the bar for a step, and those that are left of the section.
    per_step: Cell<u64>,
    left: Cell<u64>,
    /// Expected seconds of the section about to begin.
    seconds: Cell<u64>,
}

/// Ticks of the progress bar for an expected second.
const TICKS: u64 = 1000;

impl Run {
    /// A run of sections that are expected to take so many seconds altogether.
    pub fn new(quick: bool, seed: u64, seconds: u64) -> Result<Run, Box<dyn Error>> {
        let bar = ProgressBar::new(seconds * TICKS);
        bar.set_style(ProgressStyle::with_template("{bar:30} {percent:>3} %, {eta} left: {prefix}: {wide_msg}")?);
        Ok(Run { quick, seed, bar, per_step: Cell::new(0), left: Cell::new(0), seconds: Cell::new(0) })
    }

    /// Says how long the next section is expected to take.
    pub fn expect(&self, seconds: u64) {
        self.seconds.set(seconds);
    }

    /// A section begins that will take so many steps.
    pub fn begin(&self, section: &'static str, steps: usize) {
        self.bar.set_prefix(section);
        self.left.set(self.seconds.get() * TICKS);
        self.per_step.set(self.left.get() / steps.max(1) as u64);
        self.bar.tick();
    }

    /// A step begins; the one before is done.
    pub fn step(&self, what: &str) {
        self.bar.set_message(what.to_string());
        let ticks = self.per_step.get().min(self.left.get());
        self.left.set(self.left.get() - ticks);
        self.bar.inc(ticks);
    }

    /// The section is done.
    pub fn end(&self) {
        self.bar.inc(self.left.take());
    }

    /// All sections are done.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// The one of two numbers that suits a quick or a full run.
    pub fn pick<T>(&self, quick: T, full: T) -> T {
        if self.quick { quick } else { full }
    }
}

/// Times of one thing that was done several times, in seconds.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// The middle one.
    pub median: f64,
    /// The shortest.
    pub least: f64,
    /// The longest.
    pub most: f64,
}

impl Times {
    /// Of at least one time.
    pub fn of(mut seconds: Vec<f64>) -> Times {
        seconds.sort_by(f64::total_cmp);
        let at = |i: usize| seconds.get(i).copied().unwrap_or(f64::NAN);
        Times { median: at(seconds.len() / 2), least: at(0), most: at(seconds.len().saturating_sub(1)) }
    }
}

/// Processor time of this process that something takes, in seconds, all threads together: what else the machine does is not in
/// it. Where the system does not tell it, the time that passes.
pub fn seconds(what: impl FnOnce()) -> f64 {
    timed(what).1
}

/// The time that passes while something is done, in seconds: for what uses several threads.
pub fn wall_seconds(what: impl FnOnce()) -> f64 {
    let start = Instant::now();
    what();
    start.elapsed().as_secs_f64()
}

/// Times several things interleaved, each once per round, so that whatever else the machine does hits all of them alike.
/// An untimed round comes first. Counts processor time ([`seconds`]).
pub fn interleaved(things: &mut [Box<dyn FnMut() + '_>], rounds: usize) -> Vec<Times> {
    by_turns(things, rounds, |thing| seconds(thing))
}

/// The same by the time that passes ([`wall_seconds`]).
pub fn interleaved_wall(things: &mut [Box<dyn FnMut() + '_>], rounds: usize) -> Vec<Times> {
    by_turns(things, rounds, |thing| wall_seconds(thing))
}

fn by_turns(
    things: &mut [Box<dyn FnMut() + '_>],
    rounds: usize,
    clock: impl Fn(&mut (dyn FnMut() + '_)) -> f64,
) -> Vec<Times> {
    let mut times = vec![Vec::with_capacity(rounds); things.len()];
    for round in 0..=rounds.max(1) {
        for (thing, times) in things.iter_mut().zip(&mut times) {
            let time = clock(&mut **thing);
            if round > 0 {
                times.push(time);
            }
        }
    }
    times.into_iter().map(Times::of).collect()
}
