//! A stack of fixed size that nobody clears: zeroing a few kilobytes per ray costs as much as tracing an
//! easy one.

use core::mem::MaybeUninit;

/// Up to `N` items in uninitialized memory.
pub(crate) struct Stack<T: Copy, const N: usize> {
    items: [MaybeUninit<T>; N],
    len: usize,
}

impl<T: Copy, const N: usize> Stack<T, N> {
    /// An empty stack; touches no memory but its length.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        Stack { items: [const { MaybeUninit::uninit() }; N], len: 0 }
    }

    /// Number of items.
    #[inline(always)]
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Puts an item on top. Panics where the stack is full: owners bound their depth.
    #[inline(always)]
    pub(crate) fn push(&mut self, item: T) {
        self.items[self.len] = MaybeUninit::new(item);
        self.len += 1;
    }

    /// Takes the top item.
    #[inline(always)]
    pub(crate) fn pop(&mut self) -> Option<T> {
        self.len = self.len.checked_sub(1)?;
        // SAFETY: `len` was above this place, and only `push` and `push_ranked` raise it, after writing
        // every place below.
        Some(unsafe { self.items[self.len].assume_init() })
    }

    /// Puts `n` items on top, each at its place counted from the present top.
    ///
    /// `item` must give each place of `0..n` once over the calls for `0..n`; otherwise it panics.
    #[inline(always)]
    pub(crate) fn push_ranked(&mut self, n: usize, mut item: impl FnMut(usize) -> (usize, T)) {
        let top = &mut self.items[self.len..self.len + n];
        let mut seen = 0u64;
        for i in 0..n {
            let (place, value) = item(i);
            top[place] = MaybeUninit::new(value);
            seen |= 1 << place;
        }
        assert!(n < 64 && seen == (1 << n) - 1, "every place must be filled");
        self.len += n;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_come_back_in_reverse_and_in_rank_order() {
        let mut stack = Stack::<u64, 8>::new();
        stack.push(1);
        stack.push_ranked(3, |i| ([2, 0, 1][i], 10 + i as u64));
        let out: Vec<u64> = core::iter::from_fn(|| stack.pop()).collect();
        assert_eq!(out, [10, 12, 11, 1]);
        assert_eq!(stack.len(), 0);
    }

    #[test]
    #[should_panic(expected = "every place")]
    fn a_hole_is_refused() {
        Stack::<u64, 8>::new().push_ranked(2, |_| (0, 1));
    }
}
