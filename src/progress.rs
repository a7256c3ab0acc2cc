//! Progress and cancellation of a build.

use core::ops::ControlFlow;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// A callback for the finished fraction in [0, 1]; `Break` cancels the build.
pub(crate) type Callback<'a> = &'a (dyn Fn(f32) -> ControlFlow<()> + Sync);

/// Fractions are counted in these units, so that sums do not depend on the order.
const WHOLE: u64 = 1 << 40;

/// Progress is reported in steps of this part of the whole: half a percent.
const STEPS: u64 = 200;

/// Shared by all threads of a build. It never influences the tree.
pub(crate) struct Progress<'a> {
    callback: Option<Callback<'a>>,
    /// The whole that this is a part of, and the fraction.
    whole: Option<(&'a Progress<'a>, f64)>,
    done: AtomicU64,
    cancelled: AtomicBool,
}

impl<'a> Progress<'a> {
    pub fn new(callback: Option<Callback<'a>>) -> Progress<'a> {
        Progress { callback, whole: None, done: AtomicU64::new(0), cancelled: AtomicBool::new(false) }
    }

    /// Progress of a part that is this fraction of the whole.
    pub fn subtask(&'a self, fraction: f64) -> Progress<'a> {
        Progress { whole: Some((self, fraction)), ..Progress::new(None) }
    }

    pub fn cancelled(&self) -> bool {
        match self.whole {
            Some((whole, _)) => whole.cancelled(),
            None => self.cancelled.load(Ordering::Relaxed),
        }
    }

    /// Reports that this fraction of the whole is finished. Calls back at every half percent, but for the last: the whole is finished when
    /// [`Progress::complete`] says so, however fractions are rounded.
    pub fn finished(&self, fraction: f64) {
        if let Some((whole, part)) = self.whole {
            return whole.finished(part * fraction);
        }
        let Some(callback) = self.callback else { return };
        let part = (fraction * WHOLE as f64) as u64;
        let before = self.done.fetch_add(part, Ordering::Relaxed);
        let now = before + part;
        let [before, now] = [before, now].map(|done| done * STEPS / WHOLE);
        if before != now && now < STEPS && callback(now as f32 / STEPS as f32).is_break() {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }

    /// Reports that the whole is finished, after all its parts; returns whether it was cancelled.
    pub fn complete(&self) -> bool {
        let cancelled = self.cancelled();
        cancelled || self.callback.is_some_and(|callback| callback(1.0).is_break())
    }
}
