//! The images of a place in space that repeats along some axes.
//!
//! The distance to a point is that to the place's nearest image. Only images matter from which the box around all points is within
//! reach, and of those along an axis only the ones beside that box and between its faces: one farther out is farther from every
//! point, as coordinates, differences, squares and sums are rounded monotonically.
//!
//! **Rounding.** An image is computed in f64, and may be rounded to f32 by the query. Its distance from the box is a lower bound:
//! it is less by a slack of 2^-22 of the coordinates, which may be as large as those of the box and a period. The square of a
//! distance that a query computes is wrong by a few units of 2^-24 of itself, and, where squares are denormal, by 2^-147.

use crate::geometry::Aabb;
use core::ops::RangeInclusive;
use glam::DVec3;

/// The greatest extent of the box around all points along a periodic axis, in periods.
pub(in crate::point) const MOST_EXTENT: f64 = 16.0;

/// The greatest distance of that box from zero, in periods: images of a place are right to 2^-12 of a period.
pub(super) const FARTHEST: f64 = (1u64 << 40) as f64;

/// Space that repeats along some axes, and the box around all points in it.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct Images {
    /// The period along each axis; 0 if the axis is not periodic.
    lengths: [f64; 3],
    /// The box around all points over the whole shutter.
    low: [f64; 3],
    high: [f64; 3],
    /// By how much a distance from the box may be too large along each axis.
    slack: [f64; 3],
    /// Up to this radius, no point is within reach of two images.
    apart: f64,
}

/// An image of a place.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct Image {
    pub place: DVec3,
    /// A lower bound of the squared distance from all points.
    pub distance: f64,
}

/// How much of a coordinate's size may be lost by rounding: 2^-22.
const ROUNDING: f64 = 1.0 / 4_194_304.0;

impl Images {
    /// With the lengths of the periodic axes, and zero for the others.
    pub fn new(lengths: [f64; 3], bounds: Aabb) -> Images {
        let (low, high) = (bounds.min.to_array(), bounds.max.to_array());
        let slack = core::array::from_fn(|axis| {
            let size = low[axis].abs().max(high[axis].abs()) + lengths[axis];
            if size.is_finite() { ROUNDING * size } else { 0.0 }
        });
        let shortest = (0..3).filter(|&axis| lengths[axis] > 0.0).map(|axis| lengths[axis] - 2.0 * slack[axis]);
        let shortest = shortest.fold(f64::INFINITY, f64::min);
        // Below half a period by more than squares are wrong.
        let apart = 0.4999 * shortest - 1e-18;
        Images { lengths, low, high, slack, apart }
    }

    /// The images of a straight path as those of its begin: whatever is near to the path is near to its begin if the box around all
    /// points is moved by any part of the path. `None` if it is longer than [`MOST_EXTENT`] periods along an axis.
    pub fn of_path(&self, displacement: DVec3) -> Option<Images> {
        let periods = |axis: usize| displacement[axis].abs() / self.lengths[axis];
        let fits = (0..3).all(|axis| self.lengths[axis] <= 0.0 || periods(axis) <= MOST_EXTENT);
        let min = DVec3::from_array(self.low) - displacement.max(DVec3::ZERO);
        let max = DVec3::from_array(self.high) - displacement.min(DVec3::ZERO);
        fits.then(|| Images::new(self.lengths, Aabb { min, max }))
    }

    /// Whether two images of a place may be within this squared distance of the same point.
    #[inline(always)]
    pub fn may_repeat(&self, bound: f32) -> bool {
        f64::from(bound).sqrt() > self.apart
    }

    /// The image of a place that lies in the first period from zero on.
    #[inline]
    pub fn home(&self, place: DVec3) -> DVec3 {
        let mut home = place.to_array();
        for (x, &length) in home.iter_mut().zip(&self.lengths) {
            // Most places are there already, and the remainder is slow.
            if length > 0.0 && !(0.0..length).contains(x) {
                *x = x.rem_euclid(length);
            }
        }
        DVec3::from_array(home)
    }

    /// The image that is nearest to the box around all points.
    #[inline]
    pub fn nearest(&self, home: DVec3) -> Image {
        let mut nearest = Image { place: home, distance: 0.0 };
        for axis in 0..3 {
            let mut least = self.outside(axis, home[axis]);
            if least > 0.0 {
                for periods in self.along(axis, home[axis], f64::INFINITY) {
                    let (x, distance) = self.image(axis, home[axis], periods);
                    if distance < least {
                        (nearest.place[axis], least) = (x, distance);
                    }
                }
            }
            nearest.distance += least;
        }
        nearest
    }

    /// Whether no other image of a place in the first period is within the bound of any point.
    #[inline]
    pub fn has_only(&self, home: DVec3, bound: f64) -> bool {
        self.is_only(0, home.x, bound) && self.is_only(1, home.y, bound) && self.is_only(2, home.z, bound)
    }

    /// Replaces `images` by those to which some point may be nearest and within the bound.
    #[inline]
    pub fn within(&self, home: DVec3, bound: f64, images: &mut Vec<Image>) {
        images.clear();
        let [ys, zs] = [1, 2].map(|axis| self.along(axis, home[axis], bound));
        for periods in self.along(0, home.x, bound) {
            let (x, far_x) = self.image(0, home.x, periods);
            if is_beyond(far_x, bound) {
                continue;
            }
            for periods in ys.clone() {
                let (y, far_y) = self.image(1, home.y, periods);
                if is_beyond(far_x + far_y, bound) {
                    continue;
                }
                for periods in zs.clone() {
                    let (z, far_z) = self.image(2, home.z, periods);
                    let distance = far_x + far_y + far_z;
                    if !is_beyond(distance, bound) {
                        images.push(Image { place: DVec3::new(x, y, z), distance });
                    }
                }
            }
        }
    }

    /// Shows the images of a place from which a point may be within a squared distance to `search`, nearest first, each with the
    /// distance up to which points count. `search` returns what that is from then on, if it is known.
    #[inline(always)]
    pub fn in_order(
        &self,
        place: DVec3,
        mut bound: f32,
        images: &mut Vec<Image>,
        mut search: impl FnMut(DVec3, f32) -> Option<f32>,
    ) {
        let home = self.home(place);
        let first = self.nearest(home);
        if is_beyond(first.distance, bound.into()) {
            return;
        }
        bound = search(first.place, bound).unwrap_or(bound);
        if first.place == home && self.has_only(home, bound.into()) {
            return;
        }
        self.within(home, bound.into(), images);
        images.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance));
        for image in images.iter().filter(|image| image.place != first.place) {
            if is_beyond(image.distance, bound.into()) {
                break;
            }
            bound = search(image.place, bound).unwrap_or(bound);
        }
    }

    /// A lower bound of the squared distance of a coordinate from the box around all points.
    #[inline]
    fn outside(&self, axis: usize, x: f64) -> f64 {
        let far = ((self.low[axis] - x).max(x - self.high[axis]) - self.slack[axis]).max(0.0);
        far * far
    }

    /// Whether a place of the first period has no other image along an axis from which the bound reaches a point: the box around
    /// all points lies between the images on either side of the place, and farther from both than the bound.
    #[inline]
    fn is_only(&self, axis: usize, home: f64, bound: f64) -> bool {
        let length = self.lengths[axis];
        let gap = (self.low[axis] - (home - length)).min(home + length - self.high[axis]) - self.slack[axis];
        length <= 0.0 || gap > 0.0 && is_beyond(gap * gap, bound)
    }

    /// The images along an axis to which some point may be nearest and within the bound: from how many periods before the place to
    /// how many after it. Some are beyond the bound.
    #[inline]
    fn along(&self, axis: usize, home: f64, bound: f64) -> RangeInclusive<i64> {
        if self.is_only(axis, home, bound) {
            return 0..=0;
        }
        let length = self.lengths[axis];
        let (first, last) = ((self.low[axis] - home) / length, (self.high[axis] - home) / length);
        first.floor() as i64..=last.ceil() as i64
    }

    /// The image so many periods from a place along an axis, and a lower bound of its squared distance from all points.
    #[inline]
    fn image(&self, axis: usize, home: f64, periods: i64) -> (f64, f64) {
        let x = if periods == 0 { home } else { home + periods as f64 * self.lengths[axis] };
        (x, self.outside(axis, x))
    }
}

/// Whether everything farther away than a squared distance is beyond a bound, however queries round.
#[inline]
pub(super) fn is_beyond(distance: f64, bound: f64) -> bool {
    distance * (1.0 - 1e-5) > bound + 1e-44
}
