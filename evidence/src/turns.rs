//! Two sides that answer the same rays in turns, and checksums that read all their answers.

use crate::timing::{median, timed};
use mbkd::Hit;
use std::hint::black_box;

/// A checksum of all answers, so that none can be optimized away.
#[derive(Clone, Copy, Default, PartialEq, Debug)]
pub struct Checksum {
    /// How many hits there were.
    pub hits: u64,
    ids: u64,
    real: f64,
}

impl Checksum {
    /// Of the answers of some rays.
    pub fn of<R>(rays: &[R], answer: impl Fn(&mut Checksum, &R)) -> Checksum {
        let mut sum = Checksum::default();
        rays.iter().for_each(|ray| answer(&mut sum, ray));
        sum
    }

    /// Reads an answer: t, both ids, both barycentrics.
    #[inline(always)]
    pub fn closest(&mut self, hit: Option<Hit>) {
        if let Some(hit) = hit {
            self.found([hit.mesh, hit.primitive], f64::from(hit.t + hit.u + hit.v));
        }
    }

    /// Reads both ids of a primitive that was found, and the sum of its numbers.
    #[inline(always)]
    pub fn found(&mut self, [mesh, primitive]: [u32; 2], real: f64) {
        self.hits += 1;
        self.ids = self.ids.wrapping_add(u64::from(mesh) << 32 | u64::from(primitive));
        self.real += real;
    }

    /// Reads a truth value.
    #[inline(always)]
    pub fn any(&mut self, hit: bool) {
        self.hits += u64::from(hit);
    }
}

/// Median times of the two sides over the same rays.
#[derive(Clone, Copy)]
pub struct Turns {
    /// Seconds of ours; NaN for a missing side.
    pub ours: f64,
    /// Seconds of theirs.
    pub theirs: f64,
    /// Median over the rounds of theirs / ours: above one we are faster.
    pub ratio: f64,
}

/// A side: answers all rays once; `None` if it is missing.
pub type Side<'a> = Option<&'a dyn Fn() -> Checksum>;

/// One untimed round, then `runs` timed ones: ours, theirs, ours, theirs, …
pub fn in_turns(runs: u32, ours: Side<'_>, theirs: Side<'_>) -> Turns {
    let time = |side: Side<'_>| side.map_or(f64::NAN, |answer_all| timed(|| black_box(answer_all())).1);
    time(ours);
    time(theirs);
    let rounds: Vec<(f64, f64)> = (0..runs).map(|_| (time(ours), time(theirs))).collect();
    Turns {
        ours: median(rounds.iter().map(|r| r.0)),
        theirs: median(rounds.iter().map(|r| r.1)),
        ratio: median(rounds.iter().map(|r| r.1 / r.0)),
    }
}
