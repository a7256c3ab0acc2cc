//! Doing the same for many things, on several threads where there are some.

/// `f(0)`, `f(1)`, … `f(n - 1)` in order; which thread does what changes nothing.
pub(crate) fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        if n > 1 && rayon::current_num_threads() > 1 {
            return (0..n).into_par_iter().with_max_len(1).map(&f).collect();
        }
    }
    (0..n).map(&f).collect()
}

/// Items per task of [`fill`].
#[cfg(feature = "rayon")]
const CHUNK: usize = 4096;

/// Appends `f(0)`, … `f(n - 1)`, which are cheap, to an empty vector.
pub(crate) fn fill<T: Send>(items: &mut Vec<T>, n: usize, f: impl Fn(usize) -> T + Sync) {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        if n > CHUNK && rayon::current_num_threads() > 1 {
            (0..n).into_par_iter().with_min_len(CHUNK).map(&f).collect_into_vec(items);
            return;
        }
    }
    items.extend((0..n).map(f));
}
