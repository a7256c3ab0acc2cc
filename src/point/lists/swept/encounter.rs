//! Encounters: pairs of moving points that come within a radius of each other, and who is told of them.

use super::candidate_points::{FourPoints, WIDTH};
use super::coordinate::SweptCoordinate;
use crate::point::layout::over_interval::PointPath;
use crate::simd::Mask;

/// A time at which two points are as close as they come, and when they are within the radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encounter {
    /// The other point.
    pub id: u32,
    /// The first time within the radius.
    pub enter: f32,
    /// The last time within the radius. Between keys the two stay within the radius from the first to the last; over
    /// several keys, in several images in a periodic box, or if one of them does not exist for a while, they may part in between.
    pub leave: f32,
    /// When they are nearest; the first such time. Over several keys it is the earliest of those with the least `distance_squared`;
    /// where paths cross more than once, rounding in f64 decides which of the crossings has that. If they are still approaching
    /// each other when one of them ceases to exist, the end of its active interval.
    pub closest: f32,
    /// The squared distance then.
    pub distance_squared: f32,
}

impl Encounter {
    /// What memory holds that is not in use.
    pub(super) const NONE: Encounter =
        Encounter { id: u32::MAX, enter: 0.0, leave: 0.0, closest: 0.0, distance_squared: 0.0 };

    /// Both encounters of the same points as one.
    pub(super) fn and(self, other: Encounter) -> Encounter {
        let key = |e: &Encounter| (e.distance_squared.to_bits(), e.closest.to_bits());
        let nearest = if key(&other) < key(&self) { other } else { self };
        Encounter { enter: self.enter.min(other.enter), leave: self.leave.max(other.leave), ..nearest }
    }
}

/// What is done with encounters.
pub(super) trait EncounterVisitor {
    /// Whether pairs that lists at the first time contain are excluded.
    const EXCLUDES_LISTED: bool;
    /// Whether the encounters of a point count.
    #[inline(always)]
    fn wants(&self, _id: u32) -> bool {
        true
    }
    /// Comes to a point.
    fn begin(&mut self, own: &PointPath);
    /// The encounters of that point with four others.
    fn visit<C: SweptCoordinate>(&mut self, own: &PointPath, others: &FourPoints<C>, encounters: &EncounterLanes);
    /// Ends a point that the same others may have come up for several times, in different images.
    #[inline(always)]
    fn end_of_several_images(&mut self) {}
}

/// The encounters of a point with four others.
#[derive(Clone, Copy, Debug)]
pub(super) struct EncounterLanes {
    pub(super) enter: [f32; WIDTH],
    pub(super) leave: [f32; WIDTH],
    pub(super) closest: [f32; WIDTH],
    pub(super) distance_squared: [f32; WIDTH],
    /// Lanes with an encounter.
    pub(super) valid: Mask,
}

impl EncounterLanes {
    /// Writes the encounters one behind the other; their number.
    #[inline(always)]
    pub(super) fn write<C: SweptCoordinate>(&self, others: &FourPoints<C>, to: &mut [Encounter; WIDTH]) -> usize {
        let mut count = 0;
        for (lane, id) in others.ids().into_iter().enumerate() {
            to[count % WIDTH] = Encounter {
                id,
                enter: self.enter[lane],
                leave: self.leave[lane],
                closest: self.closest[lane],
                distance_squared: self.distance_squared[lane],
            };
            count += usize::from(self.valid >> lane & 1);
        }
        count
    }

    /// When each of the others that is met comes within the radius: lanes and times.
    #[inline(always)]
    pub(super) fn entering(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        (0..WIDTH).filter(|&lane| self.valid >> lane & 1 != 0).map(|lane| (lane, self.enter[lane]))
    }
}
