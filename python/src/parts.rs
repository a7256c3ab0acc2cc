//! Work in parts: between two of them, Ctrl-C is checked and `progress` is called.

use crate::threads::poll_python;
use core::ops::Range;
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// The time that a part should take.
const PAUSE: Duration = Duration::from_millis(50);

/// How much longer or shorter a part may be than the one before.
const STEP: usize = 8;

/// The number of items in the first part, whose time is not known, and in the longest parts.
pub struct Sizes {
    pub first: usize,
    pub most: usize,
}

/// Does `work` on all items, part by part, without the GIL. The time that one part takes decides how long the next one is, so
/// results must not depend on the division.
pub fn in_parts(
    py: Python<'_>,
    items: usize,
    sizes: Sizes,
    progress: Option<&Py<PyAny>>,
    mut work: impl FnMut(Range<usize>) -> PyResult<()> + Send,
) -> PyResult<()> {
    let (mut begin, mut size) = (0, sizes.first);
    while begin < items {
        let end = items.min(begin + size);
        let took = py.detach(|| {
            let start = Instant::now();
            work(begin..end)?;
            Ok::<_, PyErr>(start.elapsed())
        })?;
        begin = end;
        poll_python(py, progress, end as f32 / items as f32)?;
        // Casts saturate, and a part of no time makes an infinite number.
        let fits = (size as f64 * PAUSE.as_secs_f64() / took.as_secs_f64()) as usize;
        size = fits.clamp(size / STEP, size * STEP).clamp(1, sizes.most);
    }
    Ok(())
}
