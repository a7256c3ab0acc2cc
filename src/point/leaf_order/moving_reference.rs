//! Moving references: points between two keys, and the time slices that trees cover.

use super::point_rows::{NO_POINT, PointRows};
use crate::geometry::{KeyTime, TimeInterval};
use crate::parallel::{self, CHUNK};
use crate::simd::{Kernel, Simd, SimdLevel, dispatch, prefetch};

/// A reference to a point that moves linearly between two keys, active during `interval`.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct MovingReference {
    pub(in crate::point) open: [f32; 3],
    pub(in crate::point) close: [f32; 3],
    pub(in crate::point) interval: TimeInterval,
    /// The active interval of the point; `interval` is its intersection with a time slice.
    pub(in crate::point) active: TimeInterval,
    pub(in crate::point) id: u32,
    /// Whether it moves far relative to its neighbours.
    pub(in crate::point) fast: bool,
}

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

impl MovingReference {
    /// Coordinate at a phase, in f64 without noticeable rounding.
    #[inline(always)]
    pub(in crate::point) fn at(&self, axis: usize, phase: f64) -> f64 {
        let (open, close) = (f64::from(self.open[axis]), f64::from(self.close[axis]));
        open + (close - open) * phase
    }

    /// Position at a phase, rounded.
    #[inline(always)]
    pub(in crate::point) fn position(&self, phase: f64) -> [f32; 3] {
        core::array::from_fn(|axis| self.at(axis, phase) as f32)
    }

    /// The same where it is in the middle of a time slice.
    pub(in crate::point) fn at_rest(&self, slice: &SegmentSlice) -> MovingReference {
        let at = self.position(slice.middle_phase());
        MovingReference { open: at, close: at, ..*self }
    }

    /// The phases of its active interval, as given by [`SegmentSlice::range`].
    #[inline(always)]
    pub(in crate::point) fn range(&self, slice: &SegmentSlice) -> [f64; 2] {
        slice.range([self.interval.begin(), self.interval.end_bound()])
    }
}

/// Where a tree takes its references from.
pub(in crate::point) trait References: Sync {
    /// How many there are.
    fn len(&self) -> usize;
    /// The number by which one of them is found.
    fn number(&self, i: usize) -> u32;
    /// The reference with a number.
    fn reference(&self, number: u32) -> MovingReference;
    /// Prefetches the reference with a number, if there is one; a hint.
    fn prefetch(&self, number: u32);
    /// Whether any is not active throughout a slice.
    fn timed(&self, slice: &SegmentSlice) -> bool;
    /// Whether any point does not exist throughout the shutter.
    fn have_active_intervals(&self) -> bool;
}

impl References for [MovingReference] {
    fn len(&self) -> usize {
        <[MovingReference]>::len(self)
    }
    #[inline(always)]
    fn number(&self, i: usize) -> u32 {
        i as u32
    }
    #[inline(always)]
    fn reference(&self, number: u32) -> MovingReference {
        self[number as usize]
    }
    #[inline(always)]
    fn prefetch(&self, number: u32) {
        if let Some(reference) = self.get(number as usize) {
            // It may span two cache lines.
            prefetch(reference);
            prefetch(&reference.id);
        }
    }
    fn timed(&self, slice: &SegmentSlice) -> bool {
        self.iter().any(|m| m.interval != slice.interval)
    }
    fn have_active_intervals(&self) -> bool {
        self.iter().any(|m| m.active != TimeInterval::FULL)
    }
}

/// Writes the positions of references at a phase between their keys, with their numbers.
pub(in crate::point) fn take_positions<R: References + ?Sized>(rows: PointRows, references: &R, phase: f64) {
    let simd = SimdLevel::best();
    parallel::each(&mut rows.chunks(CHUNK), |(first, rows)| {
        dispatch(simd, TakePositions { rows: rows.borrow(), references, first: *first, phase });
    });
}

/// Writes some positions to rows, and no points to the rest of them. The arithmetic is that of [`MovingReference::position`].
struct TakePositions<'a, R: ?Sized> {
    rows: PointRows<'a>,
    references: &'a R,
    /// Which of the references are written begins with this one.
    first: usize,
    phase: f64,
}

impl<R: References + ?Sized> Kernel for TakePositions<'_, R> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let TakePositions { mut rows, references, first, phase } = self;
        let count = rows.len().min(references.len().saturating_sub(first));
        let phase = s.splat_d(phase);
        let [x, y, z] = &mut rows.at;
        let (x, y, z, index) = (&mut x[..count], &mut y[..count], &mut z[..count], &mut rows.index[..count]);
        for i in 0..count {
            let number = references.number(first + i);
            let MovingReference { open, close, .. } = references.reference(number);
            let (open, close) = (s.widen(open), s.widen(close));
            [x[i], y[i], z[i], _] = s.narrow(open + (close - open) * phase);
            index[i] = number;
        }
        for i in count..rows.len() {
            rows.set(i, &NO_POINT);
        }
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
