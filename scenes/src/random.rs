//! The random numbers of scenes, tests and measurements: the same on every machine.

use glam::{DVec3, Vec3};

/// The SplitMix64 generator (Steele, Lea and Flood, 2014): one 64-bit state, integer arithmetic only. Different seeds give
/// unrelated sequences.
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

    /// Below `n`, which is not zero.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// In [0, 1), a multiple of 2^-24, so exact in f32.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u32 << 24) as f32
    }

    /// In [low, high).
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// In [-1, 1).
    pub fn signed(&mut self) -> f32 {
        self.between(-1.0, 1.0)
    }

    /// In the cube [0, 1)³.
    pub fn in_cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }

    /// In the cube [-1, 1)³.
    pub fn vec(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    /// In the unit ball, by rejection from the cube.
    pub fn in_ball(&mut self) -> Vec3 {
        loop {
            let p = self.vec();
            if p.length_squared() < 1.0 {
                return p;
            }
        }
    }

    /// On the unit sphere.
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let p = self.in_ball();
            // Close to zero the rounding of a tiny vector would show in its direction.
            if p.length_squared() > 1e-6 {
                return p.normalize();
            }
        }
    }

    /// In [0, 1), with all bits of an f64.
    pub fn unit_f64(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [-1, 1), likewise.
    pub fn signed_f64(&mut self) -> f64 {
        2.0 * self.unit_f64() - 1.0
    }

    /// In the cube [-1, 1)³, likewise.
    pub fn dvec(&mut self) -> DVec3 {
        DVec3::new(self.signed_f64(), self.signed_f64(), self.signed_f64())
    }
}
