//! The exact position of a moving vertex at a time.
//!
//! Keys are spaced evenly over the shutter and motion between them is linear. Time and the number of segments are
//! dyadic, so the fraction of the segment is, and so is the position: there is no rounding anywhere.

use super::{Dyadic, Vector};
use mbkd::glam::DVec3;

/// Half an ulp of f32, relative to the number (at most).
pub const HALF_ULP_F32: f64 = f32::EPSILON as f64 / 2.0;

/// Half an ulp of f64, relative to the number (at most).
pub const HALF_ULP_F64: f64 = f64::EPSILON / 2.0;

/// The precision in which the caller gave a number. Its error may be half an ulp of that precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Given {
    /// As f32.
    F32,
    /// As f64.
    F64,
    /// As f64, but accurate only to what f32 holds relative to this position.
    Around(DVec3),
}

impl Given {
    /// The greatest error of each coordinate of a position: half an ulp.
    pub fn doubt(self, position: DVec3) -> DVec3 {
        match self {
            Given::F32 => position.abs() * HALF_ULP_F32,
            Given::F64 => position.abs() * HALF_ULP_F64,
            Given::Around(center) => (position - center).abs() * HALF_ULP_F32 + position.abs() * HALF_ULP_F64,
        }
    }
}

/// A moving vertex at a time.
#[derive(Clone, Debug)]
pub struct Moving {
    /// Its exact position.
    pub position: Vector,
    /// The same in f64.
    pub near: DVec3,
    /// How far it moves, per axis, when each coordinate of its keys and the time have an error of half an ulp.
    pub doubt: DVec3,
}

/// The segment of `keys` keys (at least one) that contains `time` in [0, 1], and the exact fraction in it.
pub fn fraction(time: f32, keys: usize) -> (usize, Dyadic) {
    if keys < 2 {
        return (0, Dyadic::zero());
    }
    let segments = keys - 1;
    // Rounding may give a neighbouring segment; the fraction is then just beyond an end.
    let about = (f64::from(time) * segments as f64) as usize;
    let segment = about.min(segments - 1);
    let at = &Dyadic::new(time) * &Dyadic::new(segments as f64);
    (segment, (&at - &Dyadic::new(segment as f64)).stripped())
}

impl Moving {
    /// A vertex with position `key(i)` at the `i`-th of `keys` keys, at `time` in [0, 1].
    pub fn new(time: f32, keys: usize, given: Given, key: impl Fn(usize) -> DVec3) -> Moving {
        let (segment, s) = fraction(time, keys);
        let a = key(segment);
        let b = if keys < 2 { a } else { key(segment + 1) };
        let position = if a == b {
            Vector::new(a)
        } else {
            let Vector(sum) = &Vector::new(a) + &(&Vector::new(b) - &Vector::new(a)).times(&s);
            Vector(sum.map(Dyadic::stripped))
        };
        let s = s.to_f64();
        let displacement = (b - a).abs() * (keys.max(2) - 1) as f64;
        let near = position.to_dvec3();
        let doubt = given.doubt(a) * (1.0 - s) + given.doubt(b) * s + displacement * f64::from(time) * HALF_ULP_F32;
        Moving { position, near, doubt }
    }
}
