//! Progress and cancellation of a build.
//!
//! The whole is divided into parts, and these into further ones, each a fraction of what it is a part of. A part counts as finished
//! when it is dropped, whatever it has reported until then. So shares always add up to the whole, also where a step turns out not to be
//! needed. Where it is not known how many steps there will be, each takes a share of the rest ([`Progress::rest`]), and what follows
//! takes what is left.

use crate::error::BuildError;
use core::ops::ControlFlow;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::Mutex;

/// A callback for the finished fraction in [0, 1]; `Break` cancels the build.
pub(crate) type Callback<'a> = &'a (dyn Fn(f32) -> ControlFlow<()> + Sync);

/// Fractions are counted in these units, so that sums do not depend on the order.
const WHOLE: u64 = 1 << 40;

/// Progress is reported in steps of this part of the whole. They are small because a build that exceeds its budget begins again when
/// little is left.
const STEPS: u64 = 1000;

/// Shared by all threads of a build. It never influences the tree.
pub(crate) struct Progress<'a> {
    callback: Option<Callback<'a>>,
    /// The whole that this is a part of, and the fraction.
    whole: Option<(&'a Progress<'a>, f64)>,
    /// So many units of work are this part.
    units: f64,
    /// Whether anybody hears of it. If not, nothing is counted.
    heard: bool,
    done: AtomicU64,
    /// The last step that was reported. Locked during a report.
    reported: Mutex<u64>,
    cancelled: AtomicBool,
}

impl<'a> Progress<'a> {
    pub fn new(callback: Option<Callback<'a>>) -> Progress<'a> {
        Progress::part(callback, None, 1.0)
    }

    fn part(callback: Option<Callback<'a>>, whole: Option<(&'a Progress<'a>, f64)>, units: f64) -> Progress<'a> {
        let (done, reported, cancelled) = (AtomicU64::new(0), Mutex::new(0), AtomicBool::new(false));
        let heard = callback.is_some() || whole.is_some_and(|(whole, _)| whole.heard);
        Progress { callback, whole, units, heard, done, reported, cancelled }
    }

    /// Progress of a part that is so many units of work; of a whole that was not given units, this fraction of it.
    pub fn subtask(&'a self, units: f64) -> Progress<'a> {
        Progress::part(None, Some((self, units / self.units)), 1.0)
    }

    /// Progress of a part that is this fraction of what is not finished yet.
    pub fn rest(&'a self, fraction: f64) -> Progress<'a> {
        Progress::part(None, Some((self, fraction * self.left())), 1.0)
    }

    /// Progress of all that is not finished yet, as so many units of work.
    pub fn in_units(&'a self, units: usize) -> Progress<'a> {
        Progress::part(None, Some((self, self.left())), units as f64)
    }

    /// The fraction that is not finished yet.
    fn left(&self) -> f64 {
        (WHOLE - self.done.load(Ordering::Relaxed).min(WHOLE)) as f64 / WHOLE as f64
    }

    pub fn cancelled(&self) -> bool {
        if !self.heard {
            return false;
        }
        match self.whole {
            Some((whole, _)) => whole.cancelled(),
            None => self.cancelled.load(Ordering::Relaxed),
        }
    }

    /// An error once the build is cancelled.
    pub fn check(&self) -> Result<(), BuildError> {
        if self.cancelled() { Err(BuildError::Cancelled) } else { Ok(()) }
    }

    /// Reports that so many units are finished; of a part that was not given units, this fraction of it. More than all of it count as
    /// all.
    pub fn finished(&self, units: f64) {
        if !self.heard {
            return;
        }
        let part = (units / self.units * WHOLE as f64).min(WHOLE as f64) as u64;
        let before = self.done.fetch_add(part, Ordering::Relaxed);
        let [before, now] = [before, before + part].map(|done| done.min(WHOLE));
        match self.whole {
            Some((whole, fraction)) => {
                whole.finished(fraction * whole.units * ((now - before) as f64 / WHOLE as f64));
            }
            None => self.report(before, now),
        }
    }

    /// Calls back if a step is finished, but for the last: the whole is finished when [`Progress::complete`] says so.
    ///
    /// One thread calls at a time, so that fractions never decrease and nothing is reported once the build is cancelled. Others do not
    /// wait for it: a callback may run other tasks of the build, which report as well.
    fn report(&self, before: u64, now: u64) {
        let step = |done: u64| (done * STEPS / WHOLE).min(STEPS - 1);
        let Some(callback) = self.callback.filter(|_| step(before) != step(now)) else { return };
        let Ok(mut reported) = self.reported.try_lock() else { return };
        let now = step(self.done.load(Ordering::Relaxed));
        if now > *reported && !self.cancelled() {
            *reported = now;
            if callback(now as f32 / STEPS as f32).is_break() {
                self.cancelled.store(true, Ordering::Relaxed);
            }
        }
    }

    /// Reports that the whole is finished, after all its parts; returns whether it was cancelled.
    pub fn complete(&self) -> bool {
        let cancelled = self.cancelled();
        cancelled || self.callback.is_some_and(|callback| callback(1.0).is_break())
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        // While a panic unwinds, a callback that panicked as well would abort the process.
        if self.whole.is_some() && !std::thread::panicking() {
            self.finished(self.units);
        }
    }
}
