//! Random numbers that are the same on every machine.

#[path = "../../../scenes/src/split_mix.rs"]
mod split_mix;

use mbkd::glam::DVec3;
use split_mix::split_mix;

/// A generator of random numbers.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        split_mix(&mut self.0)
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [-1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Below `n`, which is not zero.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// In the cube [-1, 1)³.
    pub fn vec(&mut self) -> DVec3 {
        DVec3::new(self.signed(), self.signed(), self.signed())
    }

    /// A time: often 0, 1, a key or an ulp beside one, otherwise any.
    pub fn time(&mut self, keys: usize) -> f32 {
        let key = self.below(keys.max(2)) as f32 / (keys.max(2) - 1) as f32;
        let time = match self.below(8) {
            0 => 0.0,
            1 => 1.0,
            2 => key,
            3 => key.next_up(),
            4 => key.next_down(),
            _ => self.unit() as f32,
        };
        time.clamp(0.0, 1.0)
    }
}
