//! Progress and cancellation of a build.
//!
//! The whole is divided into parts, and these into further ones, each a fraction of what it is a part of. A part counts as finished
//! when it is dropped, whatever it has reported until then. So shares always add up to the whole, also where a step turns out not
//! to be needed. Where it is not known how many steps there will be, each takes a share of the rest ([`Progress::rest`]), and what
//! follows takes what is left.

use crate::error::BuildError;
use core::ops::ControlFlow;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::Mutex;

/// A callback for the finished fraction in [0, 1]; `Break` cancels the build.
pub(crate) type Callback<'a> = &'a (dyn Fn(f32) -> ControlFlow<()> + Sync);

/// Fractions are counted in these units, so that sums do not depend on the order.
const WHOLE: u64 = 1 << 40;

/// Progress is reported in steps of this part of the whole. They are small because a build that exceeds its budget begins again
/// when little is left.
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

    /// Reports that so many units are finished; of a part that was not given units, this fraction of it. More than all of it count
    /// as all.
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
    /// One thread calls at a time, so that fractions never decrease and nothing is reported once the build is cancelled. Others do
    /// not wait for it: a callback may run other tasks of the build, which report as well.
    fn report(&self, before: u64, now: u64) {
        let step = |done: u64| (done * STEPS / WHOLE).min(STEPS - 1);
        let Some(callback) = self.callback.filter(|_| step(before) != step(now)) else { return };
        let Ok(mut reported) = self.reported.try_lock() else { return };
        // Once more for what others have finished during the first call.
        for _ in 0..2 {
            let now = step(self.done.load(Ordering::Relaxed));
            if now <= *reported || self.cancelled() {
                return;
            }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel;

    /// What is reported, when work is done with progress that is cancelled at a report (counted from 1).
    fn reported(cancel_at: usize, work: impl FnOnce(&Progress)) -> Vec<f32> {
        let told = Mutex::new(Vec::new());
        let hear = |done: f32| {
            let mut told = told.lock().unwrap();
            told.push(done);
            if told.len() == cancel_at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        work(&Progress::new(Some(&hear)));
        told.into_inner().unwrap()
    }

    #[test]
    fn parts_count_as_finished_when_they_are_dropped() {
        let told = reported(usize::MAX, |progress| {
            progress.subtask(0.25).finished(0.5);
            let half = progress.subtask(0.5);
            half.finished(0.5);
            // More than all is all.
            half.finished(2.0);
            drop(half);
            drop(progress.rest(0.5));
            let units = progress.in_units(4);
            units.subtask(2.0).finished(1.0);
            units.finished(1.0);
            drop(units);
            assert!(!progress.complete());
        });
        assert_eq!(told, [0.125, 0.25, 0.5, 0.75, 0.875, 0.937, 0.968, 0.999, 1.0]);
    }

    /// While a thread reports, others pass by, so it is not certain how many reports there are.
    #[test]
    fn reports_of_many_threads_increase_and_end_with_the_cancellation() {
        for cancel_at in [1, 7, 100, usize::MAX] {
            let told = reported(cancel_at, |progress| {
                let units = progress.in_units(100_000);
                drop(parallel::map(100_000, |_| units.finished(1.0)));
                assert_eq!(progress.cancelled(), progress.check().is_err());
                assert!(progress.cancelled() || cancel_at > 1);
            });
            assert!(!told.is_empty() && told.is_sorted_by(|a, b| a < b) && told.len() <= cancel_at, "{told:?}");
        }
    }

    #[test]
    fn nothing_is_counted_if_nobody_hears_it() {
        let progress = Progress::new(None);
        progress.in_units(2).finished(1.0);
        assert_eq!(progress.done.load(Ordering::Relaxed), 0);
        assert!(!progress.complete());
    }
}
