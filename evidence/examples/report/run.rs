//! One run of the report: how long it may take, its seed and its progress.

use indicatif::{ProgressBar, ProgressStyle};
use std::cell::Cell;
use std::error::Error;

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
