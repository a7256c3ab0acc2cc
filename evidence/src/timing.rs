//! The clock of single-threaded measurements, and what is made of its times.
//!
//! Processor time of the whole process: on an idle machine it equals wall-clock time; on a busy one it excludes the time of other
//! programs. It counts all threads, including one that answers a batch for a sleeping caller.

use cpu_time::ProcessTime;

/// Seconds of processor time since some moment in the past.
pub fn seconds() -> f64 {
    ProcessTime::now().as_duration().as_secs_f64()
}

/// What something makes, and the seconds of processor time that it takes.
pub fn timed<T>(make: impl FnOnce() -> T) -> (T, f64) {
    let start = seconds();
    let made = make();
    (made, seconds() - start)
}

/// The middle value, of an even number the greater; NaN without values.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_middle_value() {
        assert_eq!(median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median([4.0, 1.0, 3.0, 2.0]), 3.0);
        assert_eq!(median([f64::INFINITY, 0.0, f64::NEG_INFINITY]), 0.0);
        assert!(median([]).is_nan());
    }
}
