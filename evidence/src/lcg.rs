//! The random numbers of benchmarks.

use mbkd::glam::Vec3;

/// Knuth's 64-bit linear congruential generator. Every run uses the same numbers.
pub struct Lcg(pub u64);

impl Lcg {
    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    /// In the cube [0, 1)³.
    pub fn vec(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }

    /// In the cube [-1, 1)³.
    pub fn signed(&mut self) -> Vec3 {
        self.vec() * 2.0 - 1.0
    }

    /// A unit vector.
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let p = self.signed();
            if (0.01..1.0).contains(&p.length_squared()) {
                return p.normalize();
            }
        }
    }

    /// On the surfaces of forty spheres of very different size.
    pub fn surface(&mut self) -> Vec3 {
        let mut of = Lcg(((self.unit() * 40.0) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0xabcdef);
        of.unit();
        of.vec() + self.direction() * (0.01 + 0.2 * of.unit().powi(3))
    }
}
