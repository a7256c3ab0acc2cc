//! By how much distances count more along the axes of a placed tree: an instance that is scaled differently along its axes is
//! searched in a stretched space, in which distances are those of its images.

use crate::geometry::ULP;
use crate::simd::Simd;
use glam::DVec3;

/// Factors of distances along the axes, at least 1, relative to the axis along which distances shrink most.
///
/// The factors are less than the true ones by 7 ULP at least, or are 1: more than two products in f32 round up.
#[derive(Clone, Copy)]
pub(super) struct Stretch {
    factors: [f32; 3],
    /// Whether some factor is not 1.
    some: bool,
}

/// Greater factors would let squares overflow early, and rule out nothing more in any real scene.
const MOST: f64 = 1e6;

impl Stretch {
    pub const NONE: Stretch = Stretch { factors: [1.0; 3], some: false };

    /// For images whose lengths along the axes are at least these.
    pub fn new(least: DVec3) -> Stretch {
        let of = |least: f64, all: f64| match least > all {
            true => ((least / all).min(MOST) * (1.0 - 8.0 * f64::from(ULP))).max(1.0) as f32,
            false => 1.0,
        };
        let factors = least.to_array().map(|axis| of(axis, least.min_element()));
        Stretch { factors, some: factors != [1.0; 3] }
    }

    /// The factors.
    #[inline(always)]
    pub fn factors(&self) -> [f32; 3] {
        self.factors
    }

    /// The greatest factor.
    #[inline(always)]
    pub fn most(&self) -> f32 {
        let [x, y, z] = self.factors;
        x.max(y).max(z)
    }

    /// Stretched vectors.
    #[inline(always)]
    pub fn of<S: Simd>(&self, s: S, [x, y, z]: [S::F; 3]) -> [S::F; 3] {
        if self.some {
            let [a, b, c] = self.factors;
            [x * s.splat(a), y * s.splat(b), z * s.splat(c)]
        } else {
            [x, y, z]
        }
    }
}
