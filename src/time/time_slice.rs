//! Equal slices of the shutter, and the times that belong to them.

use crate::geometry::{KeyTime, TimeInterval};

/// One of equal slices of the shutter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TimeSlice {
    pub index: usize,
    pub of: usize,
}

impl TimeSlice {
    /// The whole shutter.
    pub const WHOLE: TimeSlice = TimeSlice { index: 0, of: 1 };

    /// The interval of the slice, slightly widened on both sides: see [`time_slice`].
    pub fn interval(self) -> TimeInterval {
        time_slice(self.index, self.of)
    }

    /// The query times that belong to the slice, without the widening of [`TimeSlice::interval`].
    pub fn query_times(self) -> TimeInterval {
        let [first, last] = self.times();
        TimeInterval::half_open(first, last.next_up()).expect("a time slice is not empty")
    }

    /// The first and the last query time that belongs to the slice.
    pub fn times(self) -> [f32; 2] {
        let begin = |index: usize| KeyTime::first_time(index, self.of + 1);
        [begin(self.index), if self.index + 1 == self.of { 1.0 } else { begin(self.index + 1).next_down() }]
    }

    /// The motion segments that contain these times, for a motion with `keys` keys: the first and the last.
    pub fn segments(self, keys: usize) -> [usize; 2] {
        self.times().map(|t| KeyTime::new(t, keys).segment)
    }
}

/// Slice `i` of `n` equal time slices of the shutter, slightly widened on both sides: queries find their slice by
/// `t * n` rounded, whose error is less than 2^-23 of the shutter.
pub(crate) fn time_slice(i: usize, n: usize) -> TimeInterval {
    if n == 1 {
        return TimeInterval::FULL;
    }
    widened(i, n, 2.4e-7)
}

/// Slice `i` of `n`, wider by `by` on both sides.
fn widened(i: usize, n: usize, by: f64) -> TimeInterval {
    let begin = (i as f64 / n as f64 - by) as f32;
    let end = if i + 1 == n { 2.0 } else { ((i + 1) as f64 / n as f64 + by) as f32 };
    TimeInterval::half_open(begin, end).expect("a time slice is not empty")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts times near the boundaries between slices that are not in the interval of the slice that a query selects.
    fn times_lost(slice: impl Fn(usize, usize) -> TimeInterval) -> usize {
        let mut lost = 0;
        for n in 2..=300 {
            for i in 0..=n {
                let bound = (i as f64 / n as f64) as f32;
                for time in [
                    bound.next_down().next_down(),
                    bound.next_down(),
                    bound,
                    bound.next_up(),
                    bound.next_up().next_up(),
                ] {
                    if (0.0..=1.0).contains(&time) {
                        lost += usize::from(!slice(KeyTime::new(time, n + 1).segment, n).contains(time));
                    }
                }
            }
        }
        lost
    }

    #[test]
    fn slices_begin_and_end_where_queries_switch_slices() {
        for of in 1..40 {
            for index in 0..of {
                let [first, last] = TimeSlice { index, of }.times();
                let slice = |t: f32| KeyTime::new(t, of + 1).segment;
                assert_eq!((slice(first), slice(last)), (index, index));
                assert!(index == 0 && first == 0.0 || slice(first.next_down()) + 1 == index);
                assert!(index + 1 == of && last == 1.0 || slice(last.next_up()) == index + 1);
            }
        }
        assert_eq!(TimeSlice { index: 1, of: 4 }.segments(65), [16, 31]);
    }

    #[test]
    fn each_query_time_belongs_to_one_slice() {
        for of in 1..40 {
            let times: Vec<TimeInterval> = (0..of).map(|index| TimeSlice { index, of }.query_times()).collect();
            assert!(times.windows(2).all(|pair| pair[0].end_bound() == pair[1].begin()));
            assert!(times[0].begin() == 0.0 && times[of - 1].end_bound() == TimeInterval::FULL.end_bound());
            for time in times.iter().flat_map(|t| [t.begin(), t.end_bound().next_down(), t.middle()]) {
                assert!(times[KeyTime::new(time, of + 1).segment].contains(time));
            }
        }
        // What exists in one quarter is in one of four slices.
        let quarter = TimeInterval::new(0.25, 0.5).unwrap();
        let in_slice = |index: usize| quarter.intersect(TimeSlice { index, of: 4 }.query_times()).is_some();
        assert_eq!([0, 1, 2, 3].map(in_slice), [false, true, false, false]);
    }

    #[test]
    fn slices_hold_the_times_that_queries_look_for_in_them_and_only_widened_ones_do() {
        assert_eq!(times_lost(time_slice), 0);
        assert!(times_lost(|i, n| widened(i, n, 0.0)) > 100);
    }
}
