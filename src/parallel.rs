//! Doing the same for many things, on several threads where there are some.

use core::cell::Cell;
use core::ops::Range;
use std::sync::{Mutex, PoisonError};

thread_local! {
    /// Whether this thread is to do all by itself.
    static ALONE: Cell<bool> = const { Cell::new(false) };
}

/// Calls `f` with all that it does done by this thread.
///
/// For what others may wait for: a thread that waits for its helpers does other tasks of theirs meanwhile, and one of these
/// might wait for what this thread has begun.
pub(crate) fn alone<T>(f: impl FnOnce() -> T) -> T {
    /// Whether the thread was alone before; it is again, also after a panic.
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            ALONE.set(self.0);
        }
    }
    let _before = Before(ALONE.replace(true));
    f()
}

/// `f(0)`, `f(1)`, … `f(n - 1)` in order; which thread does what changes nothing.
pub(crate) fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    if n < 2 || threads() == 1 {
        return (0..n).map(f).collect();
    }
    let mut results: Vec<Option<T>> = (0..n).map(|_| None).collect();
    map_into(0, &mut results, &f);
    // Each place has been written.
    results.into_iter().flatten().collect()
}

/// Writes `f(first)` and so on. Half of it may be done by another thread, and half of that.
fn map_into<T: Send>(first: usize, results: &mut [Option<T>], f: &(dyn Fn(usize) -> T + Sync)) {
    match results {
        [] => {}
        [result] => *result = Some(f(first)),
        _ => {
            let half = results.len() / 2;
            let (low, high) = results.split_at_mut(half);
            join(&mut || map_into(first, low, f), &mut || map_into(first + half, high, f));
        }
    }
}

/// `f` of each item, in order.
pub(crate) fn each<I: Send, T: Send>(items: &mut [I], f: impl Fn(&mut I) -> T + Sync) -> Vec<T> {
    let items: Vec<Mutex<&mut I>> = items.iter_mut().map(Mutex::new).collect();
    // No other thread asks for the same item.
    map(items.len(), |i| f(&mut items[i].lock().unwrap_or_else(PoisonError::into_inner)))
}

/// Does both, at the same time where there are threads for it.
pub(crate) fn both<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    let (mut a, mut b) = (Some(a), Some(b));
    let (mut of_a, mut of_b) = (None, None);
    join(&mut || of_a = a.take().map(|a| a()), &mut || of_b = b.take().map(|b| b()));
    (of_a.expect("join calls the first"), of_b.expect("join calls the second"))
}

/// Calls both once, at the same time where there are threads for it.
///
/// What is done is behind `dyn`: rayon's code for it is long, and was a fifth of what this crate's compilation took when there was
/// some for every closure.
fn join(a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
    #[cfg(feature = "rayon")]
    if !ALONE.get() {
        rayon::join(a, b);
        return;
    }
    a();
    b();
}

/// How many threads there are.
pub(crate) fn threads() -> usize {
    #[cfg(feature = "rayon")]
    if !ALONE.get() {
        return rayon::current_num_threads();
    }
    1
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
        if n > CHUNK && threads() > 1 {
            items.par_extend((0..n).into_par_iter().with_min_len(CHUNK).map(&f));
            return;
        }
    }
    items.extend((0..n).map(f));
}
