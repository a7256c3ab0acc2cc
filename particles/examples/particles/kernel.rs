//! The smoothing kernel: Wendland's C2 function in three dimensions (H. Wendland, 1995; for fluids W. Dehnen and H. Aly,
//! "Improving convergence in smoothed particle hydrodynamics simulations without pairing instability", 2012).

use mbkd::glam::Vec3;

/// A kernel that is zero beyond `radius`.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    pub radius: f32,
    scale: f32,
    slope: f32,
}

impl Kernel {
    pub fn new(radius: f32) -> Kernel {
        let scale = 21.0 / (2.0 * core::f32::consts::PI * radius.powi(3));
        Kernel { radius, scale, slope: -20.0 * scale / (radius * radius) }
    }

    /// The value at a squared distance.
    #[inline]
    pub fn value(&self, square: f32) -> f32 {
        let q = square.sqrt() / self.radius;
        let inside = (1.0 - q).max(0.0);
        let inside2 = inside * inside;
        self.scale * inside2 * inside2 * (1.0 + 4.0 * q)
    }

    /// The gradient with respect to the particle's position, for the vector `way` from the neighbour to it.
    #[inline]
    pub fn gradient(&self, way: Vec3, square: f32) -> Vec3 {
        let inside = (1.0 - square.sqrt() / self.radius).max(0.0);
        way * (self.slope * inside * inside * inside)
    }
}
