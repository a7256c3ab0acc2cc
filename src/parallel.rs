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

/// The least number of items whose work is shared among threads: triangles to build a tree of, or as much work. Not fitted: a
/// quarter of the least number that most loops divide.
const SHARED: usize = 1024;

/// Calls `f`, which has several loops over this many items: on the calling thread alone if there are few or there is one thread,
/// otherwise on a thread of the pool.
///
/// A thread outside the pool that begins a loop hands it to the pool and sleeps until it is done. That takes as long as building a
/// tree of some thirty triangles, for each loop. So whoever has several loops enters the pool once, and for little work not at all.
pub(crate) fn entered<T: Send>(items: usize, f: impl FnOnce() -> T + Send) -> T {
    if items < SHARED || threads() == 1 {
        return alone(f);
    }
    #[cfg(feature = "rayon")]
    return rayon::scope(|_| f());
    #[cfg(not(feature = "rayon"))]
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
    if items.len() < 2 || threads() == 1 {
        return items.iter_mut().map(f).collect();
    }
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

/// Items per task of [`chunks`].
pub(crate) const CHUNK: usize = 4096;

/// `f` of successive ranges that together are `0..n`, in order. The ranges depend on nothing but `n`.
pub(crate) fn chunks<T: Send>(n: usize, f: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    map(n.div_ceil(CHUNK), |i| f(i * CHUNK..n.min((i + 1) * CHUNK)))
}

/// The results of [`parts`].
type Parts<T> = core::iter::Chain<core::option::IntoIter<T>, std::vec::IntoIter<T>>;

/// [`chunks`] without allocating memory for few items: for meshes, of which there may be many small ones.
pub(crate) fn parts<T: Send>(n: usize, f: impl Fn(Range<usize>) -> T + Sync) -> Parts<T> {
    let (one, several) = if n > CHUNK { (None, chunks(n, f)) } else { ((n > 0).then(|| f(0..n)), Vec::new()) };
    one.into_iter().chain(several)
}

/// Locks a mutex, also after a panic of another thread, which is propagated there.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(all(test, feature = "rayon"))]
mod tests {
    use super::*;

    #[test]
    fn little_work_stays_on_its_thread_and_much_enters_the_pool_once() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
        let within = || (threads(), rayon::current_thread_index().is_some());
        assert_eq!(entered(SHARED - 1, within), (1, false));
        assert_eq!(entered(SHARED - 1, || map(9, |_| within())), [(1, false); 9]);
        // From a thread of a pool, the work stays in it.
        assert_eq!(pool.install(|| entered(SHARED, within)), (2, true));
        assert_eq!(pool.install(|| entered(SHARED - 1, within)), (1, true));
        if threads() > 1 {
            assert_eq!(entered(SHARED, within), (threads(), true));
            assert_eq!(alone(|| entered(SHARED, within)), (1, false));
        }
        assert!(!ALONE.get());
    }
}
