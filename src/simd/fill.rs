//! Filling a vector by several threads.

use crate::parallel;
use core::mem::MaybeUninit;

/// Items that one task writes.
const TASK: usize = parallel::CHUNK;

/// Appends `f(0)`, … `f(n - 1)`, which are cheap.
pub(crate) fn fill<T: Send>(items: &mut Vec<T>, n: usize, f: impl Fn(usize) -> T + Sync) {
    if n <= TASK || parallel::threads() == 1 {
        return items.extend((0..n).map(f));
    }
    items.reserve(n);
    let length = items.len() + n;
    write(0, &mut items.spare_capacity_mut()[..n], &|first, to| {
        for (i, item) in to.iter_mut().enumerate() {
            item.write(f(first + i));
        }
    });
    // SAFETY: there is room for that many, and `write` has written those behind the former length, all of them: a panic leaves it
    // before. (Items that were written until then are not dropped, which is safe.)
    unsafe { items.set_len(length) };
}

/// Calls `f` for parts of the items that together are all of them, with the number of the first; the work is shared among threads.
fn write<T: Send>(first: usize, items: &mut [MaybeUninit<T>], f: &(dyn Fn(usize, &mut [MaybeUninit<T>]) + Sync)) {
    if items.len() <= TASK {
        return f(first, items);
    }
    let half = items.len() / 2;
    let (low, high) = items.split_at_mut(half);
    parallel::both(|| write(first, low, f), || write(first + half, high, f));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_appended_in_order() {
        for n in [0, 1, TASK, TASK + 1, 5 * TASK + 17] {
            let mut items = vec![String::from("first")];
            fill(&mut items, n, |i| i.to_string());
            assert_eq!(items.len(), n + 1);
            assert!(items[1..].iter().enumerate().all(|(i, item)| *item == i.to_string()) && items[0] == "first");
        }
    }

    #[test]
    fn a_panic_leaves_whole_items() {
        let mut items = vec![7];
        let end = std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| {
            fill(&mut items, 3 * TASK, |i| if i == 2 * TASK { panic!("expected") } else { i });
        }));
        assert!(end.is_err());
        assert!(items[0] == 7 && items[1..].iter().enumerate().all(|(i, &item)| i == item));
    }
}
