//! References to points that exist throughout the shutter: read in place, where the set was read to.

use super::moving_reference::{MovingReference, References, TimeSlice};
use super::source::Source;
use crate::geometry::TimeInterval;
use crate::simd::prefetch;

/// Some points of a set without active intervals, during a time slice. Their numbers are those in the set.
pub(super) struct PersistentPoints<'a> {
    source: &'a Source,
    points: &'a [u32],
    interval: TimeInterval,
    /// Positions of all points at the keys before and behind.
    open: &'a [[f32; 3]],
    close: &'a [[f32; 3]],
}

impl<'a> PersistentPoints<'a> {
    pub(super) fn new(source: &'a Source, points: &'a [u32], slice: &TimeSlice) -> PersistentPoints<'a> {
        let (open, close) = (slice.segment, (slice.segment + 1).min(slice.keys - 1));
        let (open, close) = (source.of_key(open), source.of_key(close));
        PersistentPoints { source, points, interval: slice.interval, open, close }
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
        let (open, close) = (self.open[number as usize], self.close[number as usize]);
        let id = self.source.id(number as usize);
        MovingReference { open, close, interval: self.interval, active: TimeInterval::FULL, id, fast: false }
    }
    #[inline(always)]
    fn prefetch(&self, number: u32) {
        if let (Some(open), Some(close)) = (self.open.get(number as usize), self.close.get(number as usize)) {
            prefetch(open);
            prefetch(close);
        }
    }
    fn timed(&self, _slice: &TimeSlice) -> bool {
        false
    }
    fn have_active_intervals(&self) -> bool {
        false
    }
}
