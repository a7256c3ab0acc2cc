//! The clock of single-threaded measurements: processor time of the whole process.
//!
//! On an idle machine it equals wall-clock time; on a busy one it excludes the time of other programs. It counts all
//! threads, including one that answers a batch for a sleeping caller.

use cpu_time::ProcessTime;

/// Seconds of processor time since some moment in the past.
pub fn seconds() -> f64 {
    ProcessTime::now().as_duration().as_secs_f64()
}
