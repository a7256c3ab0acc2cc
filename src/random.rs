//! Random numbers of `check_primitive` and of the unit tests.

use glam::DVec3;

/// A linear congruential generator: Knuth's for 64 bits.
pub(crate) struct Random(pub u64);

impl Random {
    /// 64 bits, the upper of which are the better ones.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        self.0
    }

    /// In [0, 1), with all bits of an f64.
    pub fn unit_f64(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [-1, 1), likewise.
    pub fn signed_f64(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// In the cube [-1, 1)³, likewise.
    pub fn dvec(&mut self) -> DVec3 {
        DVec3::new(self.signed_f64(), self.signed_f64(), self.signed_f64())
    }
}

#[cfg(test)]
impl Random {
    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 24) as f32
    }

    /// In [-1, 1).
    pub fn signed(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    /// In the cube [-1, 1)³.
    pub fn vec(&mut self) -> glam::Vec3 {
        glam::Vec3::new(self.signed(), self.signed(), self.signed())
    }
}
