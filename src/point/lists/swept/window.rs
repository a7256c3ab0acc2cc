//! The times during which points are compared: windows within segments between keys.

use crate::point::layout::over_interval::{greater, lesser};
use crate::simd::Simd;

/// A segment between keys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    /// Number of segments.
    count: f64,
    number: f64,
}

impl Segment {
    /// The segment with this number between so many keys.
    pub(super) fn new(keys: usize, number: usize) -> Segment {
        Segment { count: (keys.max(2) - 1) as f64, number: number as f64 }
    }

    /// The times of its keys.
    fn ends(&self) -> [f64; 2] {
        [self.number / self.count, (self.number + 1.0) / self.count]
    }

    /// Whether they have more than a key in common.
    pub(super) fn overlaps(&self, other: &Segment) -> bool {
        let (own, other) = (self.ends(), other.ends());
        own[0].max(other[0]) < own[1].min(other[1])
    }

    /// Where in the segment a time lies, in [0, 1].
    #[inline(always)]
    pub(super) fn phase(&self, time: f64) -> f64 {
        lesser(greater(self.unlimited_phase(time), 0.0), 1.0)
    }

    /// The same along the line through both keys.
    #[inline(always)]
    pub(super) fn unlimited_phase(&self, time: f64) -> f64 {
        time * self.count - self.number
    }

    /// The phases of four times.
    #[inline(always)]
    pub(super) fn phases<S: Simd>(&self, s: S, times: S::D) -> S::D {
        let phases = times * s.splat_d(self.count) - s.splat_d(self.number);
        s.min_d(s.max_d(phases, s.splat_d(0.0)), s.splat_d(1.0))
    }
}

/// The times during which points are compared: within a segment between keys of either set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    /// The segments of the points whose encounters are looked for, and of the others.
    pub(super) segments: [Segment; 2],
    /// First and last time.
    pub(super) times: [f64; 2],
    /// Encounters that begin from the first of these times to before the second are reported.
    pub(super) reported: [f64; 2],
    /// A key of one of the sets with which the window ends, if the two have others: a point that begins there counts behind it
    /// only.
    pub(super) key: f64,
    /// By how much the other points are moved to an image of them.
    pub(super) shift: [f64; 3],
}

impl Window {
    /// The times of `[begin, end]` that are in both segments.
    pub(super) fn of_segments(segments: [Segment; 2], times: [f64; 2]) -> Window {
        let within = |[begin, end]: [f64; 2], [first, last]: [f64; 2]| [begin.max(first), end.min(last)];
        let times = segments.iter().map(Segment::ends).fold(times, within);
        let key = segments.iter().map(|segment| segment.ends()[1]).fold(1.0, f64::min);
        let key = if key < 1.0 && segments[0] != segments[1] { key } else { f64::INFINITY };
        Window { segments, times, reported: [f64::NEG_INFINITY, f64::INFINITY], key, shift: [0.0; 3] }
    }

    /// The same times, but only encounters that begin in the time slices of both points are reported. A slice contains
    /// its begin and not its end.
    pub(super) fn reported_by(self, [own, other]: [[f64; 2]; 2]) -> Window {
        Window { reported: [own[0].max(other[0]), own[1].min(other[1])], ..self }
    }

    /// The same with an image of the other points.
    pub(super) fn at_image(self, shift: [f64; 3]) -> Window {
        Window { shift, ..self }
    }
}
