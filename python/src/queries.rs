//! Batches of queries, in an order of spatial locality, on several threads.

use crate::arrays::Places;
use crate::parts::{Sizes, in_parts};
use crate::threads::{count, pool};
use mbkd::morton_code;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// The most queries of a run, which one thread answers.
const RUN: usize = 512;

/// The number of runs for each thread in a wave, where queries are few.
const SHARES: usize = 4;

/// The number of queries in waves: of those that are answered between two checks for Ctrl-C.
const WAVES: Sizes = Sizes { first: 64, most: 64 * RUN };

/// Trees up to this many bytes fit a near cache, so the order of queries does not matter: as in the library.
const NEAR: usize = 2 << 20;

/// The numbers of so many queries, in the order in which the caller has them.
pub fn as_given(queries: usize) -> PyResult<Vec<u32>> {
    match u32::try_from(queries) {
        Ok(queries) => Ok((0..queries).collect()),
        Err(_) => Err(PyValueError::new_err(format!("{queries} queries in one call; the most are 2^32 - 1"))),
    }
}

/// The order in which queries are answered in a tree of `bytes` bytes.
pub fn order(py: Python<'_>, places: Places<'_>, bytes: usize) -> PyResult<Vec<u32>> {
    py.detach(|| {
        let all = as_given(places.len())?;
        if bytes <= NEAR || all.len() <= RUN {
            return Ok(all);
        }
        Ok(match places {
            Places::Single(rows) => along_morton_curve(all, |i| rows[i as usize]),
            Places::Double(rows) => along_morton_curve(all, |i| rows[i as usize].map(|x| x as f32)),
        })
    })
}

/// Queries along a Morton curve of 2^10 cells per axis.
fn along_morton_curve(queries: Vec<u32>, place: impl Fn(u32) -> [f32; 3]) -> Vec<u32> {
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for &query in &queries {
        let p = place(query);
        for axis in 0..3 {
            (lo[axis], hi[axis]) = (lo[axis].min(p[axis]), hi[axis].max(p[axis]));
        }
    }
    let scale: [f32; 3] = core::array::from_fn(|axis| 1023.0 / (hi[axis] - lo[axis]).max(f32::MIN_POSITIVE));
    let cell = |p: [f32; 3], axis: usize| ((p[axis] - lo[axis]) * scale[axis]) as u32;
    let code = |p: [f32; 3]| morton_code([cell(p, 0), cell(p, 1), cell(p, 2)]);
    // Code and number in one integer, which is sorted faster than a pair.
    let mut keys: Vec<u64> = queries.into_iter().map(|i| code(place(i)) << 32 | u64::from(i)).collect();
    keys.sort_unstable();
    keys.into_iter().map(|key| key as u32).collect()
}

/// Answers queries in runs. `run` answers the queries of one run, on any thread; `take` gets the answers in order, and may end it
/// all by an error.
pub fn in_waves<R: Send>(
    py: Python<'_>,
    order: &[u32],
    workers: isize,
    progress: Option<&Py<PyAny>>,
    run: impl Fn(&[u32]) -> R + Sync,
    mut take: impl FnMut(&[u32], R) -> PyResult<()> + Send,
) -> PyResult<()> {
    let threads = count(workers)?;
    // One run is not worth a thread of its own.
    let pool = if threads > 1 && order.len() > RUN { Some(pool(workers)?) } else { None };
    in_parts(py, order.len(), WAVES, progress, |part| {
        let wave = &order[part];
        match &pool {
            None => wave.chunks(RUN).try_for_each(|queries| take(queries, run(queries))),
            Some(pool) => {
                let length = wave.len().div_ceil(SHARES * threads).min(RUN);
                let answers: Vec<R> = pool.install(|| wave.par_chunks(length).map(&run).collect());
                wave.chunks(length).zip(answers).try_for_each(|(queries, answer)| take(queries, answer))
            }
        }
    })
}
