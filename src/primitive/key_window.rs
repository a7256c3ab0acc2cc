//! The keys within and around an interval.

use crate::geometry::{KeyTime, TimeInterval};
use crate::simd::SimdLevel;
use core::ops::{Range, RangeInclusive};

/// The keys within and around an interval.
pub(crate) struct Window {
    pub begin: KeyTime,
    pub end: KeyTime,
    /// The keys strictly inside.
    pub inner: Range<usize>,
    /// The keys of the overlapped segments, and of those next to them: the times of queries are rounded.
    pub around: RangeInclusive<usize>,
    /// The begin of the interval in segments, and the fraction of the interval per segment.
    first: f64,
    per_segment: f64,
}

impl Window {
    pub fn new(over: TimeInterval, keys: usize) -> Window {
        let (begin, end) = (KeyTime::new(over.begin(), keys), KeyTime::new(over.end(), keys));
        let segments = (keys - 1) as f64;
        let (first, last) = (f64::from(over.begin()) * segments, f64::from(over.end()) * segments);
        Window {
            inner: first as usize + 1..(last.ceil() as usize).max(first as usize + 1),
            around: begin.segment.saturating_sub(1)..=(end.segment + 2).min(keys - 1),
            per_segment: if last > first { 1.0 / (last - first) } else { 0.0 },
            begin,
            end,
            first,
        }
    }

    /// The fraction of the interval at a key inside.
    #[inline(always)]
    pub fn fraction(&self, key: usize) -> f32 {
        ((key as f64 - self.first) * self.per_segment) as f32
    }
}

/// Some intervals over which bounds of many primitives are computed, and what these computations share.
pub(crate) struct Intervals<'a> {
    pub over: &'a [TimeInterval],
    /// The windows of a motion with this many keys; none before the first one.
    keys: usize,
    windows: Vec<Window>,
    /// Memory to be used again.
    rows: Vec<f32>,
    pub level: SimdLevel,
}

impl<'a> Intervals<'a> {
    pub fn new(over: &'a [TimeInterval]) -> Intervals<'a> {
        Intervals { over, keys: 0, windows: Vec::new(), rows: Vec::new(), level: SimdLevel::best() }
    }

    /// The windows of a motion with more than two keys, and memory of any contents.
    pub fn windows(&mut self, keys: usize) -> (&[Window], &mut Vec<f32>) {
        if self.keys != keys {
            self.windows = self.over.iter().map(|&over| Window::new(over, keys)).collect();
            self.keys = keys;
        }
        (&self.windows, &mut self.rows)
    }
}
