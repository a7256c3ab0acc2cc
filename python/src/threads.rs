//! On how many threads something runs, how long work is interrupted, and how it tells how far it is.

use crate::arrays::value_error;
use core::ops::ControlFlow;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// More threads than this are not made, whatever is asked for: each takes memory, and beyond the processors none is of use.
const MOST: usize = 256;

/// How often work that lasts is looked after.
const PAUSE: Duration = Duration::from_millis(50);

/// Pools that were asked for, by the process that made them: one that forks has none of the threads of its parent's.
static POOLS: Mutex<Vec<(u32, usize, Arc<ThreadPool>)>> = Mutex::new(Vec::new());

/// The pool for scipy's `workers`: that many threads, or with -1 one for each processor.
pub fn pool(workers: isize) -> PyResult<Arc<ThreadPool>> {
    let (process, threads) = (std::process::id(), count(workers)?);
    let mut pools = POOLS.lock().map_err(value_error)?;
    if let Some((.., pool)) = pools.iter().find(|(of, n, _)| (*of, *n) == (process, threads)) {
        return Ok(pool.clone());
    }
    let pool = Arc::new(ThreadPoolBuilder::new().num_threads(threads).build().map_err(value_error)?);
    pools.push((process, threads, pool.clone()));
    Ok(pool)
}

/// Does work in a pool, without Python's lock.
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

/// What work that lasts is told and tells.
#[derive(Default)]
pub struct Control {
    stop: AtomicBool,
    /// Done, as the bits of a fraction.
    done: AtomicU32,
}

impl Control {
    /// Hears how far the work is; says whether it shall stop.
    pub fn hear(&self, done: f32) -> ControlFlow<()> {
        self.done.fetch_max(done.to_bits(), Ordering::Relaxed);
        if self.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Tells the caller's `progress` how far work is, and hears whether Ctrl-C was pressed.
pub fn look_after(py: Python<'_>, progress: Option<&Py<PyAny>>, done: f32) -> PyResult<()> {
    py.check_signals()?;
    if let Some(progress) = progress {
        progress.call1(py, (done,))?;
    }
    Ok(())
}

/// Does long work in a pool, without Python's lock, and looks after it meanwhile.
///
/// Ctrl-C and an exception of `progress` ask the work to stop; it ends when it hears that.
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
                // Where the other side is gone, nobody wants the result.
                let _ = finished.send(pool.install(|| work(control)));
            });
            let mut error = None;
            loop {
                match result.recv_timeout(PAUSE) {
                    Ok(result) => return error.map_or(Ok(result), Err),
                    Err(RecvTimeoutError::Timeout) if error.is_none() => {
                        let done = f32::from_bits(control.done.load(Ordering::Relaxed));
                        if let Err(wrong) = Python::attach(|py| look_after(py, progress, done)) {
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
