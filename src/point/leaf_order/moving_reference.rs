//! References to points between two keys, and where trees take them from.

use super::point_rows::{NO_POINT, PointRows};
use super::segment_slice::SegmentSlice;
use crate::geometry::TimeInterval;
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
