//! Timing of the phases of a build.

use std::time::Duration;

/// The times of the phases of a build, summed over threads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct BuildTimes {
    pub planes: Duration,
    pub duplication: Duration,
    pub propagation: Duration,
}

impl BuildTimes {
    pub fn add(&mut self, other: BuildTimes) {
        self.planes += other.planes;
        self.duplication += other.duplication;
        self.propagation += other.propagation;
    }

    pub fn share(&self, of: Duration) -> f64 {
        let all = (self.planes + self.duplication + self.propagation).as_secs_f64();
        if all > 0.0 { of.as_secs_f64() / all } else { 0.0 }
    }
}
