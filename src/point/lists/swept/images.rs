//! Periodic boxes: which images of a set a group of points is compared with.
//!
//! The points of a group stay where they are, and trees are compared with them once for each image, moved by a whole number of
//! periods along each axis. Seen from `a`, an image of `b` is at `(b − a) + s` at all times, where `s` is that number times the
//! length, every step in f64. From `b` it has the opposite sign and the same bits, so both points see the same. A pair may meet in
//! several images: its encounters are united, as those in several segments between keys are.
//!
//! **Which images count.** Two points are as near as their nearest images. An image that is the nearest at no time of the shutter
//! changes no encounter: whenever it is within the radius, a nearer one is so too. Where no two points are ever farther apart
//! than E along an axis of length L, no image more than E/L + 1/2 periods away is the nearest. So the number of images does not
//! grow with the radius any further. (Which images the nearer ones are may change from time slice to time slice, and encounters are reported
//! in the slice in which they begin. So a time slice must not leave out an image because it is not the nearest during that.) Of
//! these images, only those matter whose boxes the group reaches.
//!
//! **Rounding.** In f64 and with ε, n and A as in [`super`], let S be the largest shift along an axis. Boxes reach at most three
//! times as far as points, so S is at most 6A + L/2. The tests compare with `b − (c − s)`, c being the centre or zero: the
//! difference in parentheses is wrong by ε(A + S), the other by εS more than without s. `(b − a) + s` is wrong by ε(2A + S) more.
//! Together that is 3ε(A + S) along an axis, below 6ε(A + S) ≤ ε(42A + 3L) altogether. In place of A,
//! [`SweptCoordinate::excess`] gets A + L: it is at least 64(n + 1)ε(A + L), of which (56 + 28n)εA are used without images, and n
//! is at least 1. In f32, M counts at the image, so it
//! may be much less than A: the same excess is added there. What else depends on M holds as without images, as it is about
//! differences of positions.

use super::coordinate::SweptCoordinate;
use crate::geometry::Aabb;
use crate::point::lists::error::ListError;
use crate::point::lists::periodic_box::{MOST_PERIODS, PeriodicBox, check_periods};
use crate::point::queries::images::MOST_EXTENT;
use crate::point::tree::PointTree;
use core::ops::RangeInclusive;

/// A periodic box, and which images of points in it count.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Images {
    /// The lengths of the periodic axes, zero along the others.
    lengths: [f64; 3],
    /// How many periods away the nearest image of any point is at most, seen from any other.
    most: [f64; 3],
}

/// Numbers of periods along an axis.
type Periods = RangeInclusive<i32>;

impl Images {
    /// Of the points of a tree among themselves or those of another, whose coordinates have the same origin.
    pub(super) fn new<C: SweptCoordinate>(
        periods: [Option<f64>; 3],
        (tree, among): (&PointTree, Option<&PointTree>),
    ) -> Result<Images, ListError> {
        check_periods(periods)?;
        if periods == [None; 3] {
            return Ok(Images::default());
        }
        let origin = if tree.is_empty() { among.unwrap_or(tree).origin() } else { tree.origin() };
        let [own, others] = [Some(tree), among].map(|tree| tree.and_then(PointTree::bounds));
        // A k-d tree whose points do not exist between the times leaves nothing.
        let exists = |of: &Aabb| of.min.cmple(of.max).all();
        let bounds = own.into_iter().chain(others).filter(exists).reduce(Aabb::union);
        let lengths = C::lengths(&PeriodicBox::new(periods));
        let mut most = [0.0; 3];
        for axis in (0..3).filter(|&axis| lengths[axis] > 0.0) {
            let Some(Aabb { min, max }) = bounds else { continue };
            let (length, ends) = (lengths[axis], [min[axis], max[axis]]);
            let farthest = ends.iter().fold(0.0, |most, x| (x - origin[axis]).abs().max(most));
            if farthest > MOST_PERIODS * length {
                return Err(ListError::FarFromPeriod { axis });
            }
            let extent = ends[1] - ends[0];
            if extent > MOST_EXTENT * length {
                return Err(ListError::Extent { axis });
            }
            // The bounds are rounded to f64.
            let slack = 1e-6 * extent + 1e-15 * (ends[0].abs() + ends[1].abs());
            most[axis] = ((extent + slack) / length + 0.500_001).floor();
        }
        Ok(Images { lengths, most })
    }

    /// Whether any but the points themselves count.
    pub(super) fn any(&self) -> bool {
        self.most != [0.0; 3]
    }

    /// The greatest length of an axis along which images count.
    pub(super) fn longest(&self) -> f64 {
        (0..3).filter(|&axis| self.most[axis] > 0.0).fold(0.0, |most, axis| self.lengths[axis].max(most))
    }

    /// The images along an axis of what lies in a box, those that a group within `[lo, hi]` reaches. Boxes are wider than what is
    /// in them by more than is rounded here.
    pub(super) fn reached(&self, axis: usize, [lo, hi]: [f32; 2], boxed: [f32; 2], reach: f64) -> Periods {
        let (length, most) = (self.lengths[axis], self.most[axis]);
        if most == 0.0 {
            return 0..=0;
        }
        let (least, greatest) = (f64::from(lo) - f64::from(boxed[1]), f64::from(hi) - f64::from(boxed[0]));
        let (first, last) = (((least - reach) / length).ceil(), ((greatest + reach) / length).floor());
        first.max(-most) as i32..=last.min(most) as i32
    }

    /// By how much an image so many periods away is moved.
    pub(super) fn shift(&self, periods: [i32; 3]) -> [f64; 3] {
        let [x, y, z] = periods;
        [f64::from(x) * self.lengths[0], f64::from(y) * self.lengths[1], f64::from(z) * self.lengths[2]]
    }
}
