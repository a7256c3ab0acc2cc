//! A stack of fixed size that nobody clears: zeroing a few kilobytes per ray costs as much as tracing an
//! easy one.

use super::{LANES, Simd};
use core::mem::MaybeUninit;

/// Memory for a [`Stack`] of up to `N` items, uninitialized, and for those that do not fit.
pub(crate) struct StackMemory<T: Copy, const N: usize> {
    items: [MaybeUninit<T>; N],
    spilled: Vec<T>,
}

impl<T: Copy, const N: usize> StackMemory<T, N> {
    /// Touches nothing.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        StackMemory { items: [const { MaybeUninit::uninit() }; N], spilled: Vec::new() }
    }

    /// An empty stack in this memory.
    #[inline(always)]
    pub(crate) fn stack(&mut self) -> Stack<'_, T, N> {
        Stack { items: &mut self.items, len: 0, spilled: &mut self.spilled }
    }
}

/// A stack; its length is apart from its memory, so that it can live in a register. What does not fit goes
/// to the heap, which no sane tree ever makes it do.
pub(crate) struct Stack<'a, T: Copy, const N: usize> {
    items: &'a mut [MaybeUninit<T>; N],
    len: usize,
    /// Items below those in `items`. (Apart from this struct: whatever hands out a reference to one of its
    /// fields keeps all of them in memory.)
    spilled: &'a mut Vec<T>,
}

impl<T: Copy, const N: usize> Stack<'_, T, N> {
    /// Makes room for `n` more items, at most `N`.
    #[inline(always)]
    fn reserve(&mut self, n: usize) {
        if self.len + n > N {
            // SAFETY: every function that raises `len` has written all places below it.
            unsafe { spill(&self.items[..self.len], self.spilled) };
            self.len = 0;
        }
    }

    /// Puts an item on top.
    #[inline(always)]
    pub(crate) fn push(&mut self, item: T) {
        self.reserve(1);
        self.items[self.len] = MaybeUninit::new(item);
        self.len += 1;
    }

    /// Puts the first `n` of some items on top, the first lowest, without a branch on `n`.
    #[inline(always)]
    pub(crate) fn push_first<const M: usize>(&mut self, items: [T; M], n: usize) {
        assert!(n <= M);
        self.reserve(M);
        let top: &mut [MaybeUninit<T>; M] =
            (&mut self.items[self.len..self.len + M]).try_into().expect("as many as sliced");
        *top = items.map(MaybeUninit::new);
        self.len += n;
    }

    /// Takes all items off.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.len = 0;
        self.spilled.clear();
    }

    /// Takes the top item.
    #[inline(always)]
    pub(crate) fn pop(&mut self) -> Option<T> {
        if self.len == 0 {
            return self.spilled.pop();
        }
        self.len -= 1;
        // SAFETY: `len` was above this place and at most `N`; every function that raises it has written all
        // places below.
        Some(unsafe { self.items.get_unchecked(self.len).assume_init() })
    }

    /// Puts `n` items on top; `item(i)` gives the place of item `i`, counted from the present top, and the item.
    ///
    /// `item` must give each place of `0..n` once over the calls for `0..n`; otherwise this panics.
    #[inline(always)]
    pub(crate) fn push_ranked(&mut self, n: usize, mut item: impl FnMut(usize) -> (usize, T)) {
        self.reserve(n);
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

impl<const N: usize> Stack<'_, u64, N> {
    /// Puts the first `n` lanes on top, the first lowest, without a branch on `n`.
    #[inline(always)]
    pub(crate) fn push_lanes<S: Simd>(&mut self, s: S, lanes: S::U, n: usize) {
        assert!(n <= LANES);
        self.reserve(LANES);
        let top: &mut [MaybeUninit<u64>; LANES] =
            (&mut self.items[self.len..self.len + LANES]).try_into().expect("as many as sliced");
        s.store_wide(lanes, top);
        self.len += n;
    }
}

/// Moves items to the heap. (Not a method: a reference to the whole stack would keep its length in memory.)
///
/// # Safety
/// All items must have been written.
#[cold]
#[inline(never)]
unsafe fn spill<T: Copy>(items: &[MaybeUninit<T>], to: &mut Vec<T>) {
    // SAFETY: the caller's promise.
    to.extend(items.iter().map(|item| unsafe { item.assume_init() }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_come_back_in_reverse_and_in_rank_order() {
        let mut memory = StackMemory::<u64, 8>::new();
        let mut stack = memory.stack();
        stack.push(1);
        stack.push_ranked(3, |i| ([2, 0, 1][i], 10 + i as u64));
        stack.push_first([7, 8, 9], 2);
        let out: Vec<u64> = core::iter::from_fn(|| stack.pop()).collect();
        assert_eq!(out, [8, 7, 10, 12, 11, 1]);
    }

    #[test]
    fn what_does_not_fit_comes_back_from_the_heap() {
        let mut memory = StackMemory::<usize, 8>::new();
        let mut stack = memory.stack();
        for i in 0..30 {
            stack.push(2 * i);
            stack.push_first([2 * i + 1, 0, 0], 1);
        }
        for i in (0..60).rev() {
            assert_eq!(stack.pop(), Some(i));
        }
        assert_eq!(stack.pop(), None);
    }

    #[test]
    #[should_panic(expected = "every place")]
    fn a_hole_is_refused() {
        StackMemory::<u64, 8>::new().stack().push_ranked(2, |_| (0, 1));
    }
}
