//! A stack in uninitialized memory: zeroing a few kilobytes per ray costs as much as tracing an easy one.

use super::instructions::Simd;
use super::lanes::{LANES, Mask};
use core::mem::MaybeUninit;

/// Uninitialized memory for a [`Stack`]: `N` elements here, or more on the heap if a stack needs them.
pub(crate) struct StackMemory<T: Copy, const N: usize> {
    here: [MaybeUninit<T>; N],
    heap: Option<Box<[MaybeUninit<T>]>>,
}

impl<T: Copy, const N: usize> StackMemory<T, N> {
    /// Writes nothing.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        StackMemory { here: [const { MaybeUninit::uninit() }; N], heap: None }
    }

    /// An empty stack in this memory with a capacity of at least `places` items.
    #[inline(always)]
    pub(crate) fn stack(&mut self, places: usize) -> Stack<'_, T> {
        if places <= N {
            return Stack { items: &mut self.here, len: 0 };
        }
        Stack { items: self.heap.insert(uninitialized(places)), len: 0 }
    }
}

/// Memory for deep stacks. Not inlined, since hardly any tree needs it.
#[cold]
#[inline(never)]
fn uninitialized<T: Copy>(places: usize) -> Box<[MaybeUninit<T>]> {
    vec![MaybeUninit::uninit(); places].into()
}

/// A stack; its length is stored apart from its memory, so that it can live in a register.
///
/// It does not grow: its maker knows a bound on the number of items, and exceeding it panics. A call that allocates
/// inside a traversal would spill every vector register, whether it is executed or not.
pub(crate) struct Stack<'a, T: Copy> {
    items: &'a mut [MaybeUninit<T>],
    len: usize,
}

impl<T: Copy> Stack<'_, T> {
    /// Pushes an item.
    #[inline(always)]
    pub(crate) fn push(&mut self, item: T) {
        self.items[self.len] = MaybeUninit::new(item);
        self.len += 1;
    }

    /// Pushes the first `n` of some items, the first lowest, without a branch on `n`.
    #[inline(always)]
    pub(crate) fn push_first<const M: usize>(&mut self, items: [T; M], n: usize) {
        assert!(n <= M);
        let top: &mut [MaybeUninit<T>; M] =
            (&mut self.items[self.len..self.len + M]).try_into().expect("as many as sliced");
        // A loop: `map` of an array may be a call, in the middle of a traversal.
        for (to, item) in top.iter_mut().zip(items) {
            to.write(item);
        }
        self.len += n;
    }

    /// Removes all items.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// The top item.
    #[inline(always)]
    pub(crate) fn top(&self) -> Option<T> {
        if self.len == 0 {
            return None;
        }
        // SAFETY: as in `pop`.
        Some(unsafe { self.items.get_unchecked(self.len - 1).assume_init() })
    }

    /// Removes and returns the top item.
    #[inline(always)]
    pub(crate) fn pop(&mut self) -> Option<T> {
        if self.len == 0 {
            return None;
        }
        self.len -= 1;
        // SAFETY: `len` was above this place and at most the number of places; every function that raises it has
        // written all places below.
        Some(unsafe { self.items.get_unchecked(self.len).assume_init() })
    }

    /// Pushes `n` items; `item(i)` returns item `i` and its position, counted from the present top.
    ///
    /// `item` must return each position of `0..n` once over the calls for `0..n`; otherwise this panics.
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

impl Stack<'_, u64> {
    /// Pushes the lanes of a mask, the first lowest, without a branch on their number.
    #[inline(always)]
    pub(crate) fn push_lanes<S: Simd>(&mut self, s: S, lanes: S::U, mask: Mask) {
        let top: &mut [MaybeUninit<u64>; LANES] =
            (&mut self.items[self.len..self.len + LANES]).try_into().expect("as many as sliced");
        s.store_compressed_wide(lanes, mask, top);
        self.len += mask.count_ones() as usize;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_come_back_in_reverse_and_in_rank_order() {
        let mut memory = StackMemory::<u64, 8>::new();
        let mut stack = memory.stack(8);
        stack.push(1);
        stack.push_ranked(3, |i| ([2, 0, 1][i], 10 + i as u64));
        stack.push_first([7, 8, 9], 2);
        assert_eq!(stack.top(), Some(8));
        let out: Vec<u64> = core::iter::from_fn(|| stack.pop()).collect();
        assert_eq!(out, [8, 7, 10, 12, 11, 1]);
    }

    #[test]
    fn deep_stacks_lie_on_the_heap() {
        let mut memory = StackMemory::<usize, 8>::new();
        let mut stack = memory.stack(62);
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
    #[should_panic(expected = "out of range")]
    fn more_than_was_asked_for_is_refused() {
        let mut memory = StackMemory::<u64, 8>::new();
        let mut stack = memory.stack(8);
        for i in 0..8 {
            stack.push_first([i, 0], 1);
        }
    }

    #[test]
    #[should_panic(expected = "every place")]
    fn a_hole_is_refused() {
        StackMemory::<u64, 8>::new().stack(8).push_ranked(2, |_| (0, 1));
    }
}
