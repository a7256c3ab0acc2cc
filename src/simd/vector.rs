//! Vectors of three in four lanes of f64.
//!
//! With a vector in one register, products and sums take half as many instructions as with three numbers. They are those of
//! glam, in the same order and not fused, so results are the same bit for bit on every instruction set.

use super::instructions::Simd;
use super::lanes::Mask;
use glam::DVec3;

/// The mask of the first three lanes.
pub(crate) const THREE: Mask = 0b111;

/// A vector in the first three lanes, and 0.
#[inline(always)]
pub(crate) fn vector_lanes<S: Simd>(s: S, v: DVec3) -> S::D {
    s.load_d(&[v.x, v.y, v.z, 0.0])
}

/// The first three lanes as a vector.
#[inline(always)]
pub(crate) fn vector<S: Simd>(s: S, v: S::D) -> DVec3 {
    let [x, y, z, _] = s.lanes_d(v);
    DVec3::new(x, y, z)
}

/// The cross product of the first three lanes.
#[inline(always)]
pub(crate) fn cross<S: Simd>(s: S, a: S::D, b: S::D) -> S::D {
    s.rotate_left(a) * s.rotate_right(b) - s.rotate_left(b) * s.rotate_right(a)
}

/// The absolute values.
#[inline(always)]
pub(crate) fn magnitude<S: Simd>(s: S, a: S::D) -> S::D {
    s.max_d(a, s.splat_d(0.0) - a)
}
