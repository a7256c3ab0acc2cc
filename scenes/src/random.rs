//! Random numbers that are the same on every machine.

use super::split_mix::split_mix;
use glam::Vec3;

/// A generator of random numbers.
pub(super) struct Random {
    state: u64,
}

impl Random {
    /// A generator; different seeds give unrelated sequences.
    pub fn new(seed: u64) -> Random {
        Random { state: seed }
    }

    fn next(&mut self) -> u64 {
        split_mix(&mut self.state)
    }

    /// Uniform in [0, 1), a multiple of 2^-24, so exact in f32.
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u32 << 24) as f32
    }

    /// Uniform in [low, high).
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform in the unit ball, by rejection from the cube.
    pub fn in_ball(&mut self) -> Vec3 {
        loop {
            let p = Vec3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            if p.length_squared() < 1.0 {
                return p;
            }
        }
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let p = self.in_ball();
            // Close to zero the rounding of a tiny vector would show in its direction.
            if p.length_squared() > 1e-6 {
                return p.normalize();
            }
        }
    }
}
