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
//! grow with the radius any further. (Which images are the nearest may change from time slice to time slice, and encounters are
//! reported in the slice in which they begin. So a time slice must not leave out an image because it is not the nearest in that
//! slice.) Of these images, only those matter whose boxes the group reaches.
//!
//! **Long radii** reach all these images of each point: tens of thousands, if points are sixteen periods apart along three axes.
//! But where a radius is longer than the greatest distance of nearest images, two points are within it at all times, and so they
//! are within that distance ([`Images::shortened`]). Then only images count that are as near at some time.
//!
//! **Rounding.** In f64 and with ε, n and A as in [`super`], let S be the largest shift along an axis, which is at most 17L. (A may
//! be less: it counts only slices that are searched.) The tests compare with `b − (c − s)`, c being the centre or zero: the
//! difference in parentheses is wrong by ε(A + S), the other by εS more than without s. `(b − a) + s` is wrong by ε(2A + S) more.
//! Together that is 3ε(A + S) along an axis, below 6ε(A + S) ≤ ε(6A + 102L) altogether. In place of A,
//! [`SweptCoordinate::excess`] gets A + L, of which A is a sum for the points of a pair: it is at least 64(n + 1)ε(A + L), of which
//! (56 + 28n)εA are used without images. With n at least 1, this leaves 44εA and 128εL. In f32, M counts at the image, so it may be
//! much less than A: the same excess is added there. What else depends on M holds as without images, as it is about differences of
//! positions.

use super::coordinate::SweptCoordinate;
use crate::geometry::Aabb;
use crate::point::lists::error::ListError;
use crate::point::lists::periodic_box::{MOST_PERIODS, PeriodicBox, check_periods};
use crate::point::lists::radii::Radii;
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
    /// No point is farther from the nearest image of another than this, however their distance is rounded.
    farthest: f64,
}

/// How many periods points may be from zero in f64: beyond, it does not resolve positions in a period.
const MOST_RESOLVED: f64 = (1u64 << 48) as f64;

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
        let bounds = own.into_iter().chain(others).reduce(Aabb::union);
        let lengths = C::lengths(&PeriodicBox::new(periods));
        let (mut most, mut apart) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            let Some(Aabb { min, max }) = bounds else { continue };
            let (length, ends) = (lengths[axis], [min[axis], max[axis]]);
            let extent = ends[1] - ends[0];
            // The bounds are rounded to f64.
            let slack = 1e-6 * extent + 1e-15 * (ends[0].abs() + ends[1].abs());
            apart[axis] = extent + 4.0 * slack;
            if length <= 0.0 {
                continue;
            }
            let farthest = |from: f64| ends.iter().fold(0.0, |most, x| (x - from).abs().max(most));
            if farthest(origin[axis]) > MOST_PERIODS * length || farthest(0.0) > MOST_RESOLVED * length {
                return Err(ListError::FarFromPeriod { axis });
            }
            if extent > MOST_EXTENT * length {
                return Err(ListError::Extent { axis });
            }
            most[axis] = ((extent + slack) / length + 0.500_001).floor();
            apart[axis] = 0.5 * length + 4.0 * slack;
        }
        let farthest = 1.01 * apart.iter().map(|x| x * x).sum::<f64>().sqrt();
        Ok(Images { lengths, most, farthest })
    }

    /// A radius within which the same points meet, but fewer images: where it is longer than all distances, each image within it
    /// would count.
    pub(super) fn shortened_radius(&self, radius: f32) -> f32 {
        if self.any() { radius.min(self.farthest as f32) } else { radius }
    }

    /// The same of all radii. The memory is for radii of points.
    pub(super) fn shortened<'r>(&self, radii: Radii<'r>, [first, second]: &'r mut [Vec<f32>; 2]) -> Radii<'r> {
        if !self.any() {
            return radii;
        }
        let shorten = |radii: &[f32], memory: &'r mut Vec<f32>| -> &'r [f32] {
            memory.extend(radii.iter().map(|&radius| self.shortened_radius(radius)));
            memory
        };
        match radii {
            Radii::Equal(radius) => Radii::Equal(self.shortened_radius(radius)),
            Radii::Own(own) => Radii::Own(shorten(own, first)),
            Radii::Larger { own, others } => {
                Radii::Larger { own: shorten(own, first), others: shorten(others, second) }
            }
            Radii::Sum { own, others } => Radii::Sum { own: shorten(own, first), others: shorten(others, second) },
        }
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
