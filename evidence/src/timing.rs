//! Clocks, and what is timed in turns so that whatever else the machine does hits all contestants alike.

use cpu_time::ProcessTime;
use std::sync::OnceLock;
use std::time::Instant;

/// Seconds of processor time of the whole process since some moment in the past. With one thread on an idle machine it equals the
/// time that passes; on a busy one it excludes the time of other programs. It counts all threads, including one that answers a
/// batch for a sleeping caller.
pub fn seconds() -> f64 {
    ProcessTime::now().as_duration().as_secs_f64()
}

/// Seconds that passed since the first call: for what uses several threads.
pub fn wall_seconds() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// What something makes, and the seconds of processor time that it takes.
pub fn timed<T>(make: impl FnOnce() -> T) -> (T, f64) {
    let start = seconds();
    let made = make();
    (made, seconds() - start)
}

/// Times of one thing that was done several times.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// The middle one, of an even number the greater.
    pub median: f64,
    /// The shortest.
    pub least: f64,
    /// The longest.
    pub most: f64,
}

impl Times {
    /// NaN without times.
    pub fn of(times: impl IntoIterator<Item = f64>) -> Times {
        let mut times: Vec<f64> = times.into_iter().collect();
        times.sort_by(f64::total_cmp);
        let at = |i: usize| times.get(i).copied().unwrap_or(f64::NAN);
        Times { median: at(times.len() / 2), least: at(0), most: at(times.len().saturating_sub(1)) }
    }
}

/// The middle value, of an even number the greater; NaN without values.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    Times::of(values).median
}

/// Geometric mean; NaN without values.
pub fn geometric_mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, n) = values.into_iter().fold((0.0, 0), |(sum, n), x: f64| (sum + x.ln(), n + 1));
    if n == 0 { f64::NAN } else { (sum / f64::from(n)).exp() }
}

/// Times of contestants by a clock ([`seconds`] or [`wall_seconds`]), in rounds in which each has a turn, after a round that is not
/// counted.
pub fn race<F: FnMut()>(clock: fn() -> f64, rounds: usize, contestants: &mut [F]) -> Vec<Times> {
    let mut times = vec![Vec::with_capacity(rounds); contestants.len()];
    for round in 0..=rounds.max(1) {
        for (contestant, times) in contestants.iter_mut().zip(&mut times) {
            let start = clock();
            contestant();
            let time = clock() - start;
            if round > 0 {
                times.push(time);
            }
        }
    }
    times.into_iter().map(Times::of).collect()
}

/// Does something on one thread, with all the builds and batches in it.
pub fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be started").install(work)
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
        let Times { least, most, .. } = Times::of([4.0, 1.0, 3.0]);
        assert_eq!([least, most], [1.0, 4.0]);
        assert!((geometric_mean([1.0, 4.0, 16.0]) - 4.0).abs() < 1e-12 && geometric_mean([]).is_nan());
    }

    #[test]
    fn a_race_counts_all_rounds_but_the_first() {
        let (mut first, mut second) = (0, 0);
        let mut turns: [Box<dyn FnMut() + '_>; 2] = [Box::new(|| first += 1), Box::new(|| second += 1)];
        assert_eq!(race(wall_seconds, 3, &mut turns).len(), 2);
        drop(turns);
        assert_eq!((first, second), (4, 4));
    }
}
