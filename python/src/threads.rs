//! Thread pools, interruption of long work, and reports of its progress.

use crate::arrays::value_error;
use core::ops::ControlFlow;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// The greatest number of threads, whatever is requested: each takes memory, and threads beyond the processors do not help.
const MOST: usize = 256;

/// The number of pools that a process keeps.
const KEPT: usize = 2;

/// The time between two checks of long work for Ctrl-C.
const PAUSE: Duration = Duration::from_millis(50);

/// The pools that were used last, each with its process and number of threads: a forked process has none of its parent's threads.
static POOLS: Mutex<Vec<(u32, usize, Arc<ThreadPool>)>> = Mutex::new(Vec::new());

/// The pool for the argument `workers` of scipy: that many threads, or with -1 one for each processor.
pub fn pool(workers: isize) -> PyResult<Arc<ThreadPool>> {
    let (process, threads) = (std::process::id(), count(workers)?);
    let mut pools = POOLS.lock().map_err(value_error)?;
    let pool = match pools.iter().position(|(of, n, _)| (*of, *n) == (process, threads)) {
        Some(known) => pools.remove(known).2,
        None => Arc::new(ThreadPoolBuilder::new().num_threads(threads).build().map_err(value_error)?),
    };
    pools.push((process, threads, pool.clone()));
    // Pools of the parent stay: to drop one is to wake its threads, which are not here.
    let mut newer = 0;
    let mut is_old = |of: u32| {
        newer += usize::from(of == process);
        of == process && newer > KEPT
    };
    if let Some(old) = pools.iter().rposition(|(of, ..)| is_old(*of)) {
        pools.remove(old);
    }
    Ok(pool)
}

/// Runs work in a pool, without the GIL.
pub fn on<T: Send>(py: Python<'_>, workers: isize, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let pool = pool(workers)?;
    Ok(py.detach(|| pool.install(work)))
}

/// The number of threads.
pub fn count(workers: isize) -> PyResult<usize> {
    match workers {
        -1 => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
        1.. => Ok((workers as usize).min(MOST)),
        _ => Err(PyValueError::new_err(format!("workers must be -1 or at least 1, not {workers}"))),
    }
}

/// The shared state of long work: a request to stop, and its progress.
#[derive(Default)]
pub struct Control {
    stop: AtomicBool,
    /// The finished fraction, as its bits.
    done: AtomicU32,
}

impl Control {
    /// Records the finished fraction; `Break` if the work must stop.
    pub fn report(&self, done: f32) -> ControlFlow<()> {
        self.done.fetch_max(done.to_bits(), Ordering::Relaxed);
        if self.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Checks for Ctrl-C, and calls the caller's `progress` with the finished fraction.
pub fn poll_python(py: Python<'_>, progress: Option<&Py<PyAny>>, done: f32) -> PyResult<()> {
    py.check_signals()?;
    if let Some(progress) = progress {
        progress.call1(py, (done,))?;
    }
    Ok(())
}

/// Runs long work in a pool, without the GIL, and polls Python meanwhile.
///
/// Ctrl-C and an exception of `progress` request the work to stop. It ends at its next report of progress.
pub fn long<T: Send>(
    py: Python<'_>,
    workers: isize,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Control) -> T + Send,
) -> PyResult<T> {
    let pool = pool(workers)?;
    let control = Control::default();
    py.detach(|| {
        let (finished, result) = channel();
        std::thread::scope(|scope| {
            let (control, pool) = (&control, &pool);
            scope.spawn(move || {
                // If the receiver is gone, the result is not needed.
                let _ = finished.send(pool.install(|| work(control)));
            });
            let mut error = None;
            loop {
                match result.recv_timeout(PAUSE) {
                    Ok(result) => return error.map_or(Ok(result), Err),
                    Err(RecvTimeoutError::Timeout) if error.is_none() => {
                        let done = f32::from_bits(control.done.load(Ordering::Relaxed));
                        if let Err(wrong) = Python::attach(|py| poll_python(py, progress, done)) {
                            control.stop.store(true, Ordering::Relaxed);
                            error = Some(wrong);
                        }
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => {
                        return Err(PyValueError::new_err("the work ended without a result"));
                    }
                }
            }
        })
    })
}
