//! Parallel loops over many items, on several threads if there are any.

use core::cell::Cell;
use core::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

thread_local! {
    /// Whether this thread must not share its work.
    static ALONE: Cell<bool> = const { Cell::new(false) };
}

/// Calls `f` with all of its work done by this thread.
///
/// For work that other threads may wait for. A thread that waits for rayon's workers runs other tasks meanwhile, and
/// one of these might wait for the result that this thread is computing: a deadlock.
pub(crate) fn alone<T>(f: impl FnOnce() -> T) -> T {
    /// The previous value, which is restored on drop, also after a panic.
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            ALONE.set(self.0);
        }
    }
    let _before = Before(ALONE.replace(true));
    f()
}

/// `f(0)`, `f(1)`, … `f(n - 1)` in order; the result does not depend on the threads.
pub(crate) fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    if n < 2 || threads() == 1 {
        return (0..n).map(f).collect();
    }
    let mut results: Vec<Option<T>> = (0..n).map(|_| None).collect();
    map_into(0, &mut results, &f);
    // Every element has been written.
    results.into_iter().flatten().collect()
}

/// Writes `f(first)` and so on. Half of the range may be done by another thread, recursively.
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
    // No other thread locks the same item.
    map(items.len(), |i| f(&mut lock(&items[i])))
}

/// Runs both, concurrently if there are threads for it.
pub(crate) fn both<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    let (mut a, mut b) = (Some(a), Some(b));
    let (mut of_a, mut of_b) = (None, None);
    join(&mut || of_a = a.take().map(|a| a()), &mut || of_b = b.take().map(|b| b()));
    (of_a.expect("join calls the first"), of_b.expect("join calls the second"))
}

/// Calls both once, concurrently if there are threads for it.
///
/// The closures are behind `dyn`: rayon's code for a join is long, and took a fifth of this crate's compile time when
/// it was instantiated for every closure.
fn join(a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
    #[cfg(feature = "rayon")]
    if !ALONE.get() {
        rayon::join(a, b);
        return;
    }
    a();
    b();
}

/// The number of threads.
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

/// Locks a mutex, also after a panic of another thread, which is propagated there.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
