//! Periodic boundary conditions: positions a whole number of periods apart are the same.
//!
//! Two points are neighbours if their nearest images are (the minimum image convention). Along a periodic axis of length L
//! the difference of two points is `d − L·k`, with `d = p − q` and k the whole number nearest to `d · (1/L)`, every step
//! rounded to f32. It has the same magnitude seen from either point, because every step gives the negative result for
//! negative operands.
//!
//! Boxes are wrapped instead: moved to the image whose middle is nearest to that of the group's box. The distance to the nearest
//! image changes by no more than the difference itself does, so the gap between the wrapped box and the group's bounds the
//! distances between all points of both. For a part of the group this holds only if, for every point of the group, every
//! point in the box has its nearest image there. Otherwise that axis must not be used to cull any further, and the box is
//! widened to infinity along it. Leaves of the group therefore wrap boxes again: a leaf is much smaller, so far fewer boxes are
//! nearest in several images.
//!
//! **Rounding.** Let M bound the coordinates of both boxes and L, and u = 2^-24. Then `d`, `L·k` and their difference
//! are wrong by at most 2Mu, (2M + L)u and (2M + L)u: below 8Mu together. A face of a wrapped box is wrong by at most
//! 2(2M + L)u, below 6Mu, before the difference with the group's face, which is rounded as `d` is. Wrapped boxes are
//! widened by 32Mu, and the test whether an image is the nearest for all points requires a margin of 32Mu to half a
//! period, which covers `d · (1/L)` with its three roundings of at most (|d| + L)u each. It also covers what positions in f64
//! add, whose coordinates here are relative to the group and rounded: M u each, and as much for `L·k` with L rounded to f32. For
//! them differences and k are computed in f64 instead.
//!
//! **Points near a leaf.** The images of points near a leaf are those nearest to the middle of its box ([`PeriodicBox::image`]).
//! The offset `o` of a point from there is wrong by 3Mu, and `o · (1/L)`, times L, by 4Mu more. So k may be that of an image which
//! is farther by up to 14Mu than the nearest, where both are half a period away. `L·k`, what it leaves of `o`, and half the size of
//! the box are wrong by another 5Mu and (M + L)u: about 20Mu together, and with the 8Mu of differences less than 32Mu. Here the
//! slack is 32u of the sum of two coordinates and L.

use super::error::ListError;
use crate::simd::{LANES, Lanes, Mask, Simd};

/// The periodic box: lengths of the periodic axes, and zero along those that are not periodic.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PeriodicBox {
    pub(super) period: [f32; 3],
    /// 1/L, or zero.
    pub(super) inverse: [f32; 3],
    /// The lengths as they were given, for positions in f64.
    pub(super) double_period: [f64; 3],
    /// Whether any axis is periodic.
    pub(super) any: bool,
}

/// The greatest number of periods that a coordinate may be from zero. Up to there the rounding to whole numbers below is
/// right, and M is at most a million periods.
pub(super) const MOST_PERIODS: f64 = 1e6;

/// How much wrapped boxes are widened, and the required margin to half a period, relative to the magnitude of the
/// coordinates: 32u.
const SLACK: f32 = 32.0 / 16_777_216.0;

/// An error for the first that is no period.
pub(super) fn check_periods(periods: [Option<f64>; 3]) -> Result<(), ListError> {
    let good = |length: f64| (length as f32).is_normal() && length > 0.0;
    let bad = |axis: &usize| periods[*axis].is_some_and(|length| !good(length));
    (0..3).find(bad).map_or(Ok(()), |axis| Err(ListError::Period { axis }))
}

impl PeriodicBox {
    /// The box with these periods; `None` along axes that are not periodic.
    pub(super) fn new(periods: [Option<f64>; 3]) -> PeriodicBox {
        let double_period = periods.map(|length| length.unwrap_or(0.0));
        let period = double_period.map(|length| length as f32);
        let inverse = period.map(|length| if length > 0.0 { 1.0 / length } else { 0.0 });
        PeriodicBox { period, inverse, double_period, any: periods.iter().any(Option::is_some) }
    }

    /// The difference to the nearest image, for positions that are at most [`MOST_PERIODS`] from zero.
    #[inline(always)]
    pub(super) fn nearest<S: Simd>(&self, s: S, d: S::F, axis: usize) -> S::F {
        let k = round(s, d * s.splat(self.inverse[axis]));
        d - k * s.splat(self.period[axis])
    }

    /// The same along all axes, of one pair.
    pub(super) fn nearest_of_pair(&self, d: [f32; 3]) -> [f32; 3] {
        let along = |axis: usize| d[axis] - (d[axis] * self.inverse[axis]).round_ties_even() * self.period[axis];
        [along(0), along(1), along(2)]
    }

    /// The same in f64, as [`PeriodicBox::nearest_double`] has it.
    pub(super) fn nearest_of_pair_double(&self, d: [f64; 3]) -> [f64; 3] {
        let along = |axis: usize| match self.double_period[axis] {
            length if length > 0.0 => d[axis] - (d[axis] * (1.0 / length)).round_ties_even() * length,
            _ => d[axis],
        };
        [along(0), along(1), along(2)]
    }

    /// The difference to the nearest image of positions in f64, and with the length as it was given.
    #[inline(always)]
    pub(super) fn nearest_double<S: Simd>(&self, s: S, d: S::D, axis: usize) -> S::D {
        let length = self.double_period[axis];
        if length <= 0.0 {
            return d;
        }
        // The sum has no bits left for fractions.
        let shift = s.splat_d(6_755_399_441_055_744.0);
        let k = (d * s.splat_d(1.0 / length) + shift) - shift;
        d - k * s.splat_d(length)
    }

    /// By how much the difference to an image so many periods away changes, rounded as [`PeriodicBox::nearest`] does.
    #[inline(always)]
    pub(super) fn shift<S: Simd>(&self, s: S, periods: S::F, axis: usize) -> S::F {
        periods * s.splat(self.period[axis])
    }

    /// The same for positions in f64, of sixteen images.
    #[inline(always)]
    pub(super) fn double_shifts<S: Simd>(&self, s: S, periods: S::F, axis: usize) -> Lanes<f64> {
        let (mut whole, mut shifts) = ([0.0; LANES], [0.0; LANES]);
        s.store(periods, &mut whole);
        let length = s.splat_d(self.double_period[axis]);
        for (four, to) in shifts.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            *to = s.lanes_d(s.widen_four(&whole.as_chunks().0[four]) * length);
        }
        shifts
    }

    /// How many periods away from a point its image is that is nearest to the middle of a box along an axis; zero if that is not
    /// periodic.
    #[inline(always)]
    pub(super) fn periods_to<S: Simd>(&self, s: S, at: S::F, axis: usize, (lo, hi): ([f32; 3], [f32; 3])) -> S::F {
        round(s, (at - s.splat(lo[axis] * 0.5 + hi[axis] * 0.5)) * s.splat(self.inverse[axis]))
    }

    /// Where points have their images that are nearest to a box.
    #[inline(always)]
    pub(super) fn image<S: Simd>(&self, s: S, at: S::F, axis: usize, to: ([f32; 3], [f32; 3])) -> Image<S> {
        self.image_with_slack(s, at, axis, to, SLACK)
    }

    #[inline(always)]
    fn image_with_slack<S: Simd>(
        &self,
        s: S,
        at: S::F,
        axis: usize,
        (lo, hi): ([f32; 3], [f32; 3]),
        slack: f32,
    ) -> Image<S> {
        let length = self.period[axis];
        if length <= 0.0 {
            let gap = s.max_with_zero(s.splat(lo[axis]) - at, at - s.splat(hi[axis]));
            return Image { gap, given: Mask::MAX, certain: Mask::MAX };
        }
        let periods = self.periods_to(s, at, axis, (lo, hi));
        let middle = lo[axis] * 0.5 + hi[axis] * 0.5;
        let rest = (at - s.splat(middle)) - self.shift(s, periods, axis);
        let apart = magnitude(s, rest, rest);
        let most = lo[axis].abs().max(hi[axis].abs()) + length;
        let size = s.splat((hi[axis] - lo[axis]) * 0.5) + (magnitude(s, at, at) + s.splat(most)) * s.splat(slack);
        Image {
            gap: s.max(apart - size, s.splat(0.0)),
            given: s.eq(periods, s.splat(0.0)),
            certain: s.lt(apart + size, s.splat(0.5 * length)),
        }
    }

    /// Wraps boxes along the periodic axes to where they bound the differences to the group's box `[lo, hi]`.
    #[inline(always)]
    pub(super) fn wrap<S: Simd>(
        &self,
        s: S,
        boxes: ([S::F; 3], [S::F; 3]),
        group: ([f32; 3], [f32; 3]),
    ) -> WrappedBoxes<S> {
        self.wrap_with_slack(s, boxes, group, SLACK)
    }

    /// The same with another slack, relative to the magnitude of the coordinates.
    #[inline(always)]
    fn wrap_with_slack<S: Simd>(
        &self,
        s: S,
        (mut lo, mut hi): ([S::F; 3], [S::F; 3]),
        (group_lo, group_hi): ([f32; 3], [f32; 3]),
        slack: f32,
    ) -> WrappedBoxes<S> {
        let (mut ambiguous, mut wrapped) = ([0; 3], 0);
        for axis in 0..3 {
            let length = self.period[axis];
            if length <= 0.0 {
                continue;
            }
            let half = s.splat(0.5);
            let middle = group_lo[axis] * 0.5 + group_hi[axis] * 0.5;
            let group_size = (group_hi[axis] - group_lo[axis]) * 0.5;
            let most = group_lo[axis].abs().max(group_hi[axis].abs()) + length;
            let slack = (magnitude(s, lo[axis], hi[axis]) + s.splat(most)) * s.splat(slack);
            let offset = (lo[axis] * half + hi[axis] * half) - s.splat(middle);
            let k = round(s, offset * s.splat(self.inverse[axis]));
            let shift = k * s.splat(length);
            let rest = offset - shift;
            let farthest = magnitude(s, rest, rest) + (hi[axis] - lo[axis]) * half + s.splat(group_size) + slack;
            ambiguous[axis] = !s.lt(farthest, s.splat(0.5 * length));
            wrapped |= ambiguous[axis] | !s.eq(k, s.splat(0.0));
            lo[axis] = lo[axis] - shift - slack;
            hi[axis] = hi[axis] - shift + slack;
        }
        WrappedBoxes { lo, hi, ambiguous, wrapped }
    }
}

/// Images of points along an axis, seen from a box.
pub(super) struct Image<S: Simd> {
    /// No point of the box is nearer to any image than this.
    pub(super) gap: S::F,
    /// Points that are not shifted.
    pub(super) given: Mask,
    /// Points of which no other image is the nearest to any point of the box.
    pub(super) certain: Mask,
}

/// Boxes at their images nearest to a group.
pub(super) struct WrappedBoxes<S: Simd> {
    pub(super) lo: [S::F; 3],
    pub(super) hi: [S::F; 3],
    /// Along each axis, boxes of which points may be nearer in another image.
    ambiguous: [Mask; 3],
    /// Boxes of which any point may be nearest in another image than the one it is given in.
    pub(super) wrapped: Mask,
}

impl<S: Simd> WrappedBoxes<S> {
    /// Boxes that hold for every part of the group.
    #[inline(always)]
    pub(super) fn widened(self, s: S) -> ([S::F; 3], [S::F; 3]) {
        let (mut lo, mut hi) = (self.lo, self.hi);
        for axis in 0..3 {
            lo[axis] = s.select(self.ambiguous[axis], s.splat(f32::NEG_INFINITY), lo[axis]);
            hi[axis] = s.select(self.ambiguous[axis], s.splat(f32::INFINITY), hi[axis]);
        }
        (lo, hi)
    }
}

/// The greater magnitude.
#[inline(always)]
fn magnitude<S: Simd>(s: S, a: S::F, b: S::F) -> S::F {
    let zero = s.splat(0.0);
    s.max(s.max(a, zero - a), s.max(b, zero - b))
}

/// The nearest whole number, ties to even, for magnitudes below 2^22: the sum has no bits left for fractions.
#[inline(always)]
fn round<S: Simd>(s: S, x: S::F) -> S::F {
    let shift = s.splat(12_582_912.0);
    (x + shift) - shift
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::simd::Portable;

    /// Boxes with a point at either end, moved to a group of one point with this slack. Returns how many are farther from
    /// it than the nearest image of one of their points, and how many have a point that is nearer in another image though
    /// `wrapped` does not tell.
    fn wrong(slack: f32) -> [usize; 2] {
        let (s, mut random, mut wrong) = (Portable, Random(5), [0, 0]);
        for round in 0..20_000 {
            let length = 0.5 + random.unit();
            let periodic_box = PeriodicBox::new([Some(f64::from(length)), None, None]);
            let away = [0.0, 1.0, 30.0, 1e5][round % 4] * length;
            let q = random.signed() * (away + length);
            let pairs: Lanes<[f32; 2]> = core::array::from_fn(|lane| {
                // Anywhere, or about half a period or any number of them away.
                let periods = (random.signed() * away / length).round();
                let offset = match lane % 4 {
                    0 => 0.5 * length * (1.0 + random.signed() * 1e-6),
                    1 => -0.5 * length * (1.0 + random.signed() * 1e-6),
                    _ => random.signed() * length,
                };
                let p = q + periods * length + offset;
                let other = if lane % 3 == 0 { p } else { p - offset.signum() * random.unit() * 0.2 * length };
                [p.min(other), p.max(other)]
            });
            let points = [0, 1].map(|end| pairs.map(|pair| pair[end]));
            let zero = s.splat(0.0);
            let boxes = ([s.load(&points[0]), zero, zero], [s.load(&points[1]), zero, zero]);
            let moved = periodic_box.wrap_with_slack(s, boxes, ([q, 0.0, 0.0], [q, 0.0, 0.0]), slack);
            let wrapped = moved.wrapped;
            let (lo, hi) = moved.widened(s);
            let gap = lanes(s.max_with_zero(lo[0] - s.splat(q), s.splat(q) - hi[0]));
            for point in points {
                let offset = s.load(&point) - s.splat(q);
                let (given, near) = (lanes(offset), lanes(periodic_box.nearest(s, offset, 0)));
                for lane in 0..LANES {
                    wrong[0] += usize::from(gap[lane] > near[lane].abs());
                    wrong[1] += usize::from(wrapped >> lane & 1 == 0 && near[lane] != given[lane]);
                }
            }
        }
        wrong
    }

    fn lanes(x: <Portable as Simd>::F) -> Lanes<f32> {
        let mut lanes = [0.0; LANES];
        Portable.store(x, &mut lanes);
        lanes
    }

    /// Points, and boxes of two others, with this slack. Returns how many are nearer to one of the two than the box is said to be,
    /// and how many are nearest to it in another image though one is said to be certain.
    fn wrong_images(slack: f32) -> [usize; 2] {
        let (s, mut random, mut wrong) = (Portable, Random(6), [0, 0]);
        for round in 0..20_000 {
            let length = 0.5 + random.unit();
            let periodic_box = PeriodicBox::new([Some(f64::from(length)), None, None]);
            let away = [0.0, 1.0, 30.0, 1e5][round % 4] * length;
            let first = random.signed() * (away + length);
            let ends = [first, first + random.unit() * 0.3 * length];
            let points: Lanes<f32> = core::array::from_fn(|lane| {
                let periods = (random.signed() * away / length).round();
                let offset = match lane % 4 {
                    0 => 0.5 * length * (1.0 + random.signed() * 1e-6),
                    1 => -0.5 * length * (1.0 + random.signed() * 1e-6),
                    _ => random.signed() * length,
                };
                ends[lane / 4 % 2] + periods * length + offset
            });
            let (at, to) = (s.load(&points), ([ends[0], 0.0, 0.0], [ends[1], 0.0, 0.0]));
            let image = periodic_box.image_with_slack(s, at, 0, to, slack);
            let gap = lanes(image.gap);
            let shift = periodic_box.shift(s, periodic_box.periods_to(s, at, 0, to), 0);
            for end in ends {
                let offset = at - s.splat(end);
                let (near, shifted) = (lanes(periodic_box.nearest(s, offset, 0)), lanes(offset - shift));
                for lane in 0..LANES {
                    wrong[0] += usize::from(gap[lane] > near[lane].abs());
                    wrong[1] += usize::from(image.certain >> lane & 1 != 0 && near[lane] != shifted[lane]);
                }
            }
        }
        wrong
    }

    #[test]
    fn images_of_points_bound_their_distances_and_would_not_without_slack() {
        assert_eq!(wrong_images(SLACK), [0, 0]);
        let wrong = wrong_images(0.0);
        assert!(wrong[0] > 1000 && wrong[1] > 20, "{wrong:?}");
    }

    #[test]
    fn moved_boxes_bound_the_nearest_images_and_would_not_without_slack() {
        assert_eq!(wrong(SLACK), [0, 0]);
        let wrong = wrong(0.0);
        assert!(wrong[0] > 1000 && wrong[1] > 20, "{wrong:?}");
    }
}
