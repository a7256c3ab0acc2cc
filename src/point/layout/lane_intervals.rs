//! Active intervals of the lanes of nodes and leaves.

use crate::simd::{LANES, Lanes, Mask, Simd};

/// The active intervals of sixteen lanes: `begin <= t < end`.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(in crate::point) struct LaneIntervals {
    pub(in crate::point) begin: Lanes<f32>,
    pub(in crate::point) end: Lanes<f32>,
}

impl LaneIntervals {
    /// Sixteen lanes that are never active.
    pub(in crate::point) const NEVER: LaneIntervals =
        LaneIntervals { begin: [f32::INFINITY; LANES], end: [f32::NEG_INFINITY; LANES] };

    /// Sets one lane.
    #[inline(always)]
    pub(in crate::point) fn set(&mut self, lane: usize, [begin, end]: [f32; 2]) {
        (self.begin[lane], self.end[lane]) = (begin, end);
    }

    /// Whether a lane is active at a time.
    pub(in crate::point) fn is_active(&self, lane: usize, time: f32) -> bool {
        self.begin[lane] <= time && time < self.end[lane]
    }

    /// Whether a lane has the interval of one that is absent.
    pub(in crate::point) fn is_never(&self, lane: usize) -> bool {
        (self.begin[lane], self.end[lane]) == (f32::INFINITY, f32::NEG_INFINITY)
    }

    /// The lanes that are active at a time.
    #[inline(always)]
    pub(in crate::point) fn active_at<S: Simd>(&self, s: S, time: S::F) -> Mask {
        s.le(s.load(&self.begin), time) & s.lt(time, s.load(&self.end))
    }
}
