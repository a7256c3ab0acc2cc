//! Intervals of the shutter: half-open, so that adjacent ones share a boundary without sharing a time,
//! and closed where the shutter itself ends.

use crate::error::IntervalError;

/// The end of an interval that reaches the end of the shutter: just beyond 1, so that the one rule
/// `begin <= t < end` is right everywhere.
const BEYOND: f32 = 1.0 + f32::EPSILON;

/// The time range `[begin, end)` within the shutter `[0, 1]`; an interval that ends at 1 includes 1.
///
/// ```
/// use mbkd::TimeInterval;
/// let first = TimeInterval::new(0.0, 0.25)?;
/// let last = TimeInterval::new(0.25, 1.0)?;
/// assert!(!first.contains(0.25) && last.contains(0.25) && last.contains(1.0));
/// assert_eq!(first.intersect(last), None);
/// # Ok::<(), mbkd::IntervalError>(())
/// ```
#[derive(Clone, Copy, PartialEq)]
pub struct TimeInterval {
    begin: f32,
    end: f32,
}

impl TimeInterval {
    /// The whole shutter.
    pub const FULL: TimeInterval = TimeInterval { begin: 0.0, end: BEYOND };

    /// The interval from `begin` to `end`.
    ///
    /// # Errors
    /// [`IntervalError`] unless `0 <= begin < end <= 1`.
    pub fn new(begin: f32, end: f32) -> Result<TimeInterval, IntervalError> {
        if 0.0 <= begin && begin < end && end <= 1.0 {
            // A zero is stored as the positive one: times are ordered by their bits.
            Ok(TimeInterval { begin: begin + 0.0, end: if end == 1.0 { BEYOND } else { end } })
        } else {
            Err(IntervalError { begin, end })
        }
    }

    /// `begin <= t < end` with a bound that may lie beyond the shutter; `None` if that is empty.
    pub(crate) fn half_open(begin: f32, end: f32) -> Option<TimeInterval> {
        let (begin, end) = (begin.max(0.0), end.min(BEYOND));
        (begin < end).then_some(TimeInterval { begin, end })
    }

    /// The first time of the interval.
    #[inline]
    pub fn begin(self) -> f32 {
        self.begin
    }

    /// The end of the interval: at most 1.
    #[inline]
    pub fn end(self) -> f32 {
        self.end.min(1.0)
    }

    /// The last time of the interval.
    #[inline]
    pub(crate) fn last(self) -> f32 {
        self.end.next_down()
    }

    /// The bound `b` such that all times of the interval have `t < b`: [`TimeInterval::end`], but the next
    /// float above 1 if the interval reaches the end of the shutter.
    #[inline]
    pub(crate) fn end_bound(self) -> f32 {
        self.end
    }

    /// The length.
    pub fn duration(self) -> f32 {
        self.end() - self.begin
    }

    /// The length in f64, where [`TimeInterval::duration`] may be rounded by an ULP of itself.
    pub(crate) fn fine_duration(self) -> f64 {
        f64::from(self.end()) - f64::from(self.begin)
    }

    /// The middle of the interval.
    pub(crate) fn middle(self) -> f32 {
        self.begin + 0.5 * self.duration()
    }

    /// Whether `t` lies in it (false for NaN).
    #[inline]
    pub fn contains(self, t: f32) -> bool {
        self.begin <= t && t < self.end
    }

    /// The least interval that holds both.
    pub(crate) fn hull(self, other: TimeInterval) -> TimeInterval {
        TimeInterval { begin: self.begin.min(other.begin), end: self.end.max(other.end) }
    }

    /// The intersection, unless it is empty.
    pub fn intersect(self, other: TimeInterval) -> Option<TimeInterval> {
        TimeInterval::half_open(self.begin.max(other.begin), self.end.min(other.end))
    }
}

impl core::fmt::Debug for TimeInterval {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("TimeInterval").field("begin", &self.begin).field("end", &self.end()).finish()
    }
}

impl Default for TimeInterval {
    fn default() -> Self {
        TimeInterval::FULL
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_ordered_ranges_inside_the_shutter_are_intervals() {
        for (begin, end) in [(0.5, 0.5), (0.6, 0.5), (-0.1, 0.5), (0.0, 1.1), (f32::NAN, 1.0), (0.0, f32::NAN)] {
            let error = TimeInterval::new(begin, end).unwrap_err();
            assert!(error.to_string().contains("0 <= begin < end <= 1"));
        }
        assert_eq!(TimeInterval::new(0.0, 1.0).unwrap(), TimeInterval::FULL);
        assert_eq!(TimeInterval::new(-0.0, 1.0).unwrap().begin().to_bits(), 0);
        assert_eq!(format!("{:?}", TimeInterval::FULL), "TimeInterval { begin: 0.0, end: 1.0 }");
    }

    #[test]
    fn the_last_time_of_an_interval_is_in_it_and_the_next_one_is_not() {
        assert_eq!(TimeInterval::FULL.last(), 1.0);
        for end in [1e-30, 0.25, 0.7, 1.0f32.next_down(), 1.0] {
            let interval = TimeInterval::new(0.0, end).unwrap();
            assert!(interval.contains(interval.last()) && !interval.contains(interval.last().next_up()));
        }
    }

    #[test]
    fn an_interval_may_hold_the_last_instant_alone() {
        let last = TimeInterval::half_open(1.0, 2.0).unwrap();
        assert!(last.contains(1.0) && !last.contains(1.0f32.next_down()));
        assert_eq!(last.duration(), 0.0);
        let before = TimeInterval::half_open(0.0, 1.0).unwrap();
        assert!(!before.contains(1.0));
        assert_eq!(before.intersect(last), None);
    }
}
