//! References to points that exist throughout the shutter: read in place, where the set was read to.

use super::source::Source;
use crate::geometry::TimeInterval;
use crate::point::leaf_order::moving_reference::{MovingReference, References, TimeSlice};

/// Some points of a set without active intervals, during a time slice. Their numbers are those in the set.
pub(in crate::point) struct PersistentPoints<'a> {
    source: &'a Source,
    points: &'a [u32],
    interval: TimeInterval,
    /// The keys before and behind.
    keys: [usize; 2],
}

impl<'a> PersistentPoints<'a> {
    pub(in crate::point) fn new(source: &'a Source, points: &'a [u32], slice: &TimeSlice) -> PersistentPoints<'a> {
        let keys = [slice.segment, (slice.segment + 1).min(slice.keys - 1)];
        PersistentPoints { source, points, interval: slice.interval, keys }
    }
}

impl References for PersistentPoints<'_> {
    fn len(&self) -> usize {
        self.points.len()
    }
    #[inline(always)]
    fn number(&self, i: usize) -> u32 {
        self.points[i]
    }
    #[inline(always)]
    fn reference(&self, number: u32) -> MovingReference {
        let (open, close) =
            (self.source.at(number as usize, self.keys[0]), self.source.at(number as usize, self.keys[1]));
        let id = self.source.id(number as usize);
        MovingReference { open, close, interval: self.interval, active: TimeInterval::FULL, id, fast: false }
    }
    #[inline(always)]
    fn prefetch(&self, number: u32) {
        self.source.prefetch(number as usize, self.keys[0]);
    }
    fn timed(&self, _slice: &TimeSlice) -> bool {
        false
    }
    fn have_active_intervals(&self) -> bool {
        false
    }
}
