//! Faces of boxes that move linearly: the line that is computed below sixteen given ones.
//!
//! [`linear_bounds`](super::linear_bounds) derives how far it is lowered.

use crate::simd::{LANES, Lanes, Simd};
use core::ops::Neg;

/// Bound of the relative rounding of one operation, with room for f64 rounding in the build.
pub(in crate::point) const UNIT: f64 = (1.0 + 1.0 / 1024.0) / 16_777_216.0;

/// Bound of what underflow adds: twice the least f32.
pub(in crate::point) const TINY: f64 = 2.0 * f32::from_bits(1) as f64;

/// A face: `at_zero + slope·s`.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::point) struct Face {
    pub(in crate::point) at_zero: f32,
    pub(in crate::point) slope: f32,
}

impl Face {
    #[inline(always)]
    pub(in crate::point) fn at(self, s: f64) -> f64 {
        f64::from(self.at_zero) + f64::from(self.slope) * s
    }
}

impl Neg for Face {
    type Output = Face;
    #[inline(always)]
    fn neg(self) -> Face {
        Face { at_zero: -self.at_zero, slope: -self.slope }
    }
}

/// Number of vectors of four f64 in a row.
pub(in crate::point) const VECTORS: usize = LANES / 4;

/// Sixteen f64.
pub(in crate::point) type Row<S> = [<S as Simd>::D; VECTORS];

#[inline(always)]
pub(in crate::point) fn load_row<S: Simd>(s: S, row: &Lanes<f64>) -> Row<S> {
    let row = row.as_chunks().0;
    [s.load_d(&row[0]), s.load_d(&row[1]), s.load_d(&row[2]), s.load_d(&row[3])]
}

#[inline(always)]
pub(in crate::point) fn negated<S: Simd>(s: S, [a, b, c, d]: Row<S>) -> Row<S> {
    let zero = s.splat_d(0.0);
    [zero - a, zero - b, zero - c, zero - d]
}

#[inline(always)]
pub(in crate::point) fn magnitude_d<S: Simd>(s: S, a: S::D) -> S::D {
    s.max_d(a, s.splat_d(0.0) - a)
}

/// The least of sixteen.
#[inline(always)]
pub(in crate::point) fn least<S: Simd>(s: S, row: Row<S>) -> f64 {
    let [a, b, c, d] = s.lanes_d(least_of_four(s, row));
    let [ab, cd] = [if a < b { a } else { b }, if c < d { c } else { d }];
    if ab < cd { ab } else { cd }
}

/// The sum of sixteen differences.
#[inline(always)]
pub(in crate::point) fn sum<S: Simd>(s: S, [a, b, c, d]: Row<S>, [e, f, g, h]: Row<S>) -> f64 {
    let [a, b, c, d] = s.lanes_d(((a - e) + (b - f)) + ((c - g) + (d - h)));
    (a + b) + (c + d)
}

/// Lines along the three axes, in the first three lanes, below sixteen that all have the same range of phases.
///
/// The lowest of those at both ends are all that matters, because rounding keeps the order: subtracting the same number from
/// each and taking the least is taking the least and subtracting.
pub(in crate::point) struct SharedRangeFit<S: Simd> {
    /// The lowest at both ends.
    pub(in crate::point) least: [S::D; 2],
    /// First and last phase.
    pub(in crate::point) range: [f64; 2],
    /// The multiple of the padding.
    pub(in crate::point) pad: f64,
}

impl<S: Simd> SharedRangeFit<S> {
    /// Lines that are computed below all the given ones, or, if `above`, below them negated.
    #[inline(always)]
    pub(in crate::point) fn of_spans(
        s: S,
        spans: &[[Lanes<f64>; 2]; 3],
        above: bool,
        range: [f64; 2],
        pad: f64,
    ) -> [Face; 3] {
        let zero = s.splat_d(0.0);
        let (mut at_begin, mut at_end, mut rise) = ([zero; 4], [zero; 4], [zero; 4]);
        for axis in 0..3 {
            let (mut begin, mut end) = (load_row(s, &spans[axis][0]), load_row(s, &spans[axis][1]));
            if above {
                (begin, end) = (negated(s, begin), negated(s, end));
            }
            at_begin[axis] = least_of_four(s, begin);
            at_end[axis] = least_of_four(s, end);
            rise[axis] = ((end[0] - begin[0]) + (end[1] - begin[1])) + ((end[2] - begin[2]) + (end[3] - begin[3]));
        }
        let least = [least_of_each(s, at_begin), least_of_each(s, at_end)];
        let length = range[1] - range[0];
        let mean = if length > 0.0 { sum_of_each(s, rise) / s.splat_d(LANES as f64 * length) } else { zero };
        SharedRangeFit { least, range, pad }.faces(s, mean)
    }

    /// The higher ones of the lines with these slopes and of those between the lowest at both ends.
    #[inline(always)]
    pub(in crate::point) fn faces(&self, s: S, slope: S::D) -> [Face; 3] {
        let [begin, end] = self.range;
        let length = end - begin;
        let (mut at_zero, mut slope) = self.lowered(s, slope);
        if length > 0.0 {
            let middle = s.splat_d(0.5 * (begin + end));
            let chord = self.lowered(s, (self.least[1] - self.least[0]) / s.splat_d(length));
            let (of_chord, of_slope) = (chord.0 + chord.1 * middle, at_zero + slope * middle);
            at_zero = s.select_le(of_chord, of_slope, at_zero, chord.0);
            slope = s.select_le(of_chord, of_slope, slope, chord.1);
        }
        let (near, exact, slopes) = (s.narrow(at_zero), s.lanes_d(at_zero), s.narrow(slope));
        let mut faces = [Face::default(); 3];
        for axis in 0..3 {
            faces[axis] = Face { at_zero: stepped_down(near[axis], exact[axis]), slope: slopes[axis] };
        }
        faces
    }

    /// The highest lines of about these slopes that are computed below all the given ones, if rounded down; and the slopes,
    /// rounded.
    #[inline(always)]
    fn lowered(&self, s: S, slope: S::D) -> (S::D, S::D) {
        let slope = s.widen_four(&s.narrow(slope));
        let [begin, end] = self.range;
        let least = s.min_d(self.least[0] - slope * s.splat_d(begin), self.least[1] - slope * s.splat_d(end));
        let error =
            s.splat_d(UNIT) * (magnitude_d(s, least) + s.splat_d(2.0) * magnitude_d(s, slope)) + s.splat_d(TINY);
        (least - error * s.splat_d(self.pad), slope)
    }
}

/// The least of four in each lane.
#[inline(always)]
fn least_of_four<S: Simd>(s: S, [a, b, c, d]: Row<S>) -> S::D {
    s.min_d(s.min_d(a, b), s.min_d(c, d))
}

/// The sum of the lanes of each vector.
#[inline(always)]
fn sum_of_each<S: Simd>(s: S, rows: Row<S>) -> S::D {
    let [a, b, c, d] = s.transpose_d(rows);
    (a + b) + (c + d)
}

/// The least lane of each vector.
#[inline(always)]
fn least_of_each<S: Simd>(s: S, rows: Row<S>) -> S::D {
    least_of_four(s, s.transpose_d(rows))
}

/// The inputs that the faces of a box have in common, around spans whose phases differ.
pub(in crate::point) struct OwnRangesFit<S: Simd> {
    /// First and last phase of each span.
    pub(in crate::point) begins: Row<S>,
    pub(in crate::point) ends: Row<S>,
    /// The sum of the lengths of the ranges.
    pub(in crate::point) duration: f64,
    /// The multiple of the padding.
    pub(in crate::point) pad: f64,
}

impl<S: Simd> OwnRangesFit<S> {
    /// The highest line with the mean slope that is computed below all the given ones.
    #[inline(always)]
    pub(in crate::point) fn below(&self, s: S, at_begin: Row<S>, at_end: Row<S>) -> Face {
        let rise = sum(s, at_end, at_begin);
        let slope = (if self.duration > 0.0 { rise / self.duration } else { 0.0 }) as f32;
        let double = f64::from(slope);
        let (by, mut all) = (s.splat_d(double), at_begin);
        for four in 0..VECTORS {
            let begin = at_begin[four] - by * self.begins[four];
            all[four] = s.min_d(begin, at_end[four] - by * self.ends[four]);
        }
        let least = least(s, all);
        let error = UNIT * (least.abs() + 2.0 * double.abs()) + TINY;
        Face { at_zero: rounded_down(least - error * self.pad), slope }
    }
}

/// The greatest f32 at or below a number that is not below all.
#[inline(always)]
pub(in crate::point) fn rounded_down(x: f64) -> f32 {
    stepped_down(x as f32, x)
}

/// The same if the nearest f32 is known. Without a branch, because every other one is above.
#[inline(always)]
fn stepped_down(near: f32, x: f64) -> f32 {
    let (bits, step) = (near.to_bits(), u32::from(f64::from(near) > x));
    // Numbers of either sign, and zero, which is followed by the least negative one.
    f32::from_bits(if near > 0.0 { bits - step } else { (bits | step << 31) + step })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_down() {
        for near in [0.0, -0.0, 1.0, -1.0, 1.5e-45, -1.5e-45, f32::MIN_POSITIVE, -3e38, 3e38, 2.0, f32::MAX] {
            let double = f64::from(near);
            assert_eq!(rounded_down(double), near);
            let below = double - (double.abs() * 1e-12).max(1e-60);
            assert_eq!(rounded_down(below), near.next_down());
            let above = double + (double.abs() * 1e-12).max(1e-60);
            assert_eq!(rounded_down(above), near);
        }
    }
}
