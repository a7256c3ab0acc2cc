//! Doing the same for many things, on several threads where there are some.

use core::ops::Range;

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

/// `f` of each item, in order.
pub(crate) fn each<I: Send, T: Send>(items: &mut [I], f: impl Fn(&mut I) -> T + Sync) -> Vec<T> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        if items.len() > 1 && rayon::current_num_threads() > 1 {
            return items.par_iter_mut().with_max_len(1).map(&f).collect();
        }
    }
    items.iter_mut().map(f).collect()
}

/// Does both, at the same time where there are threads for it.
pub(crate) fn both<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    #[cfg(feature = "rayon")]
    {
        rayon::join(a, b)
    }
    #[cfg(not(feature = "rayon"))]
    {
        (a(), b())
    }
}

/// How many threads there are.
pub(crate) fn threads() -> usize {
    #[cfg(feature = "rayon")]
    {
        rayon::current_num_threads()
    }
    #[cfg(not(feature = "rayon"))]
    {
        1
    }
}

/// Items per task of [`fill`] and [`chunks`].
pub(crate) const CHUNK: usize = 4096;

/// `f` of successive ranges that together are `0..n`, in order. The ranges depend on nothing but `n`.
pub(crate) fn chunks<T: Send>(n: usize, f: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    map(n.div_ceil(CHUNK), |i| f(i * CHUNK..n.min((i + 1) * CHUNK)))
}

/// Appends `f(0)`, … `f(n - 1)`, which are cheap.
pub(crate) fn fill<T: Send>(items: &mut Vec<T>, n: usize, f: impl Fn(usize) -> T + Sync) {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        if n > CHUNK && rayon::current_num_threads() > 1 {
            items.par_extend((0..n).into_par_iter().with_min_len(CHUNK).map(&f));
            return;
        }
    }
    items.extend((0..n).map(f));
}
