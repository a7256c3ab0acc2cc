//! Batches of queries, in an order of spatial locality, on several threads. They run in waves; between two waves, Ctrl-C is
//! checked and `progress` is called.

#[path = "../../src/geometry/morton.rs"]
mod morton;

use crate::arrays::Places;
use crate::threads::{count, poll_python, pool};
use morton::morton_code;
use pyo3::prelude::*;
use rayon::prelude::*;

/// The number of queries of a run, which one thread answers.
const RUN: usize = 512;

/// The number of runs in a wave.
const WAVE: usize = 64;

/// Trees up to this many bytes fit a near cache, so the order of queries does not matter: as in the library.
const NEAR: usize = 2 << 20;

/// The order in which queries are answered in a tree of `bytes` bytes.
pub fn order(py: Python<'_>, places: Places<'_>, bytes: usize) -> Vec<u32> {
    let all = 0..places.len() as u32;
    if bytes <= NEAR || places.len() <= RUN {
        return all.collect();
    }
    py.detach(|| match places {
        Places::Single(rows) => along_morton_curve(rows.len(), |i| rows[i]),
        Places::Double(rows) => along_morton_curve(rows.len(), |i| rows[i].map(|x| x as f32)),
    })
}

/// The indices of places along a Morton curve of 2^10 cells per axis.
fn along_morton_curve(len: usize, place: impl Fn(usize) -> [f32; 3]) -> Vec<u32> {
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for p in (0..len).map(&place) {
        for axis in 0..3 {
            (lo[axis], hi[axis]) = (lo[axis].min(p[axis]), hi[axis].max(p[axis]));
        }
    }
    let scale: [f32; 3] = core::array::from_fn(|axis| 1023.0 / (hi[axis] - lo[axis]).max(f32::MIN_POSITIVE));
    let cell = |p: [f32; 3], axis: usize| ((p[axis] - lo[axis]) * scale[axis]) as u32;
    // Code and index in one integer, which is sorted faster than a pair.
    let key = |(p, i): ([f32; 3], u64)| morton_code([cell(p, 0), cell(p, 1), cell(p, 2)]) << 32 | i;
    let mut keys: Vec<u64> = (0..len).map(|i| key((place(i), i as u64))).collect();
    keys.sort_unstable();
    keys.into_iter().map(|key| key as u32).collect()
}

/// Answers queries in runs. `run` answers the queries of one run, on any thread; `take` gets the answers in order.
pub fn in_waves<R: Send>(
    py: Python<'_>,
    order: &[u32],
    workers: isize,
    progress: Option<&Py<PyAny>>,
    run: impl Fn(&[u32]) -> R + Sync,
    mut take: impl FnMut(&[u32], R) + Send,
) -> PyResult<()> {
    // One run is not worth a thread of its own.
    let pool = if count(workers)? > 1 && order.len() > RUN { Some(pool(workers)?) } else { None };
    let mut done = 0;
    for wave in order.chunks(RUN * WAVE) {
        py.detach(|| match &pool {
            None => wave.chunks(RUN).for_each(|places| take(places, run(places))),
            Some(pool) => {
                let answers: Vec<R> = pool.install(|| wave.par_chunks(RUN).map(&run).collect());
                wave.chunks(RUN).zip(answers).for_each(|(places, answer)| take(places, answer));
            }
        });
        done += wave.len();
        poll_python(py, progress, done as f32 / order.len() as f32)?;
    }
    Ok(())
}
