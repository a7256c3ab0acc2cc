//! The clock of single-threaded measurements: processor time of the whole process.
//!
//! On an idle machine it is the time that passes; on a busy one it leaves out what other programs took.
//! It counts all threads, so a thread that answers a batch for a sleeping caller counts too.

use cpu_time::ProcessTime;

/// Seconds of processor time since some moment in the past.
pub fn seconds() -> f64 {
    ProcessTime::now().as_duration().as_secs_f64()
}
