//! Random numbers that are the same on every machine.

use mbkd::glam::DVec3;

/// splitmix64
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
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
