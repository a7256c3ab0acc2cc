//! Time slices of the segments between keys, and where in a segment times are.

use crate::geometry::{KeyTime, TimeInterval};

/// The times that a moving tree covers: a time slice of one segment between two keys.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct SegmentSlice {
    /// Number of keys of the set.
    pub(in crate::point) keys: usize,
    /// Index of the earlier key.
    pub(in crate::point) segment: usize,
    /// The times of the slice.
    pub(in crate::point) interval: TimeInterval,
    /// Begin and end as exact phases between the keys. The end of a slice has the same phase as the begin of the next.
    pub(in crate::point) phases: [f64; 2],
}

impl SegmentSlice {
    /// All times, of points that do not move.
    pub(in crate::point) const AT_REST: SegmentSlice =
        SegmentSlice { keys: 1, segment: 0, interval: TimeInterval::FULL, phases: [0.0, 1.0] };

    /// The keys before and behind.
    #[inline(always)]
    pub(in crate::point) fn ends(&self) -> [usize; 2] {
        [self.segment, (self.segment + 1).min(self.keys - 1)]
    }

    /// The phase of time `t` between the keys, without rounding. (Times have 24 bits, and there are at most 2^16 keys.)
    /// At the ends of the slice, it is the phase of that end: at a key, the phase of the nearest float differs from it.
    #[inline]
    pub(in crate::point) fn exact_phase(&self, t: f32) -> f64 {
        let [begin, end] = self.phases;
        // (No `clamp`: it panics where a damaged file has the end before the begin.)
        let inside = exact_phase(t, self.keys, self.segment).max(begin).min(end);
        let not_after = if t <= self.interval.begin() { begin } else { inside };
        if t >= self.interval.end_bound() { end } else { not_after }
    }

    /// The phase of time `t` in the segment, in [0, 1], with the same rounding as in queries. It is monotone in `t`, so
    /// bounds that hold between the phases of two times hold at all times between.
    #[inline]
    pub(in crate::point) fn phase(&self, t: f32) -> f32 {
        if self.keys == 2 {
            // The general case gives the same result, but takes longer.
            return t.min(1.0);
        }
        phase(KeyTime::new(t.min(1.0), self.keys), self.segment)
    }

    /// The phases that queries compute from the first to the last of two times, and the exact ones.
    #[inline(always)]
    pub(in crate::point) fn range(&self, times: [f32; 2]) -> [f64; 2] {
        let (begin, end) = (f64::from(self.phase(times[0])), f64::from(self.phase(times[1])));
        [begin.min(self.exact_phase(times[0])), end.max(self.exact_phase(times[1]))]
    }

    /// The middle of the slice.
    pub(in crate::point) fn middle(&self) -> f32 {
        0.5 * (self.interval.begin() + self.interval.end())
    }

    /// The phase of the middle in the segment.
    pub(in crate::point) fn middle_phase(&self) -> f64 {
        self.phase(self.middle()).into()
    }
}

/// How many segments between keys there are; at least one.
#[inline(always)]
pub(in crate::point) fn segments(keys: usize) -> usize {
    keys.max(2) - 1
}

/// The phase of a time between the keys of a segment, outside of [0, 1] if it lies outside; exact.
#[inline]
pub(in crate::point) fn exact_phase(t: f32, keys: usize, segment: usize) -> f64 {
    f64::from(t) * segments(keys) as f64 - segment as f64
}

/// The phase within `segment` of a time that lies in it, or at its ends.
pub(in crate::point) fn phase(at: KeyTime, segment: usize) -> f32 {
    match at.segment.cmp(&segment) {
        core::cmp::Ordering::Less => 0.0,
        core::cmp::Ordering::Equal => {
            if at.from_end {
                at.s + 1.0
            } else {
                at.s
            }
        }
        core::cmp::Ordering::Greater => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_between_two_keys_are_times() {
        let slice = SegmentSlice { keys: 2, segment: 0, interval: TimeInterval::FULL, phases: [0.0, 1.0] };
        let near_half = [0.5f32.next_down(), 0.5, 0.5f32.next_up(), 1e-30, 1.0f32.next_down(), 1.0, 1.0f32.next_up()];
        for t in (0..=997).map(|i| i as f32 / 997.0).chain(near_half) {
            assert_eq!(slice.phase(t), phase(KeyTime::new(t.min(1.0), 2), 0), "{t}");
        }
    }
}
