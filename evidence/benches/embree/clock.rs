//! The clock of single-threaded measurements: processor time of the whole process.
//!
//! On an idle machine it is the time that passes; on a busy one it leaves out what other programs took.
//! It counts all threads, so a thread that answers a batch for a sleeping caller counts too.
#![allow(unsafe_code)] // one call of the C library, for which std has no counterpart

/// Seconds of processor time since some moment in the past.
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
pub fn seconds() -> f64 {
    #[repr(C)]
    struct Timespec {
        seconds: i64,
        nanoseconds: i64,
    }
    const PROCESS_CPUTIME: i32 = 2;
    unsafe extern "C" {
        fn clock_gettime(clock: i32, time: *mut Timespec) -> i32;
    }
    let mut time = Timespec { seconds: 0, nanoseconds: 0 };
    // SAFETY: POSIX's function with its own structure, which on 64-bit Linux is two 64-bit numbers.
    unsafe { clock_gettime(PROCESS_CPUTIME, &mut time) };
    time.seconds as f64 + time.nanoseconds as f64 * 1e-9
}

/// Seconds since the first call: elsewhere the time that passes has to do.
#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
pub fn seconds() -> f64 {
    use std::sync::OnceLock;
    use std::time::Instant;
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}
