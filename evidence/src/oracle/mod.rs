//! Exact answers to the queries that the library answers in floating point.
//!
//! All inputs are floats, so every position of a moving vertex, every determinant and every squared distance is a sum
//! of products of floats: a [`Dyadic`]. Quotients ([`Ratio`]) and square roots appear only at the very end, and are
//! compared without rounding. Nothing here calls the library's kernels.
//!
//! Each exact answer comes with its **condition**: how far it moves to first order when every input number has an error
//! of half an ulp, all in the worst directions at once. No method that reads these inputs can be expected to be more
//! accurate than that, and rounding the answer costs another half ulp.

mod approach;
mod closest_point;
mod distance;
mod dyadic;
mod motion;
mod plane;
mod sphere;
mod triangle;
mod vector;

pub use approach::{ExactApproach, approach};
pub use closest_point::ExactNearest;
pub use distance::ExactDistance;
pub use dyadic::{Dyadic, Ratio};
pub use motion::{Given, HALF_ULP_F32, HALF_ULP_F64, Moving, fraction};
pub use plane::{crossing_times, side, side_of_axis_plane};
pub use sphere::{SphereHit, meet_sphere};
pub use triangle::{ExactRay, Meeting, clearly_missed, meet_triangle};
pub use vector::Vector;

/// The distance between neighbouring f32 numbers around `x`.
pub fn ulp32(x: f64) -> f64 {
    let exponent = ((x.abs().to_bits() >> 52) as i32 - 1023).max(-126);
    f64::from_bits(((exponent - 23 + 1023) as u64) << 52)
}
