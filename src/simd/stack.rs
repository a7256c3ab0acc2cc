//! A stack of fixed size that nobody clears: zeroing a few kilobytes per ray costs as much as tracing an
//! easy one.

use core::mem::MaybeUninit;

/// Memory for a [`Stack`] of up to `N` items, uninitialized.
pub(crate) struct StackMemory<T: Copy, const N: usize>([MaybeUninit<T>; N]);

impl<T: Copy, const N: usize> StackMemory<T, N> {
    /// Touches nothing.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        StackMemory([const { MaybeUninit::uninit() }; N])
    }

    /// An empty stack in this memory.
    #[inline(always)]
    pub(crate) fn stack(&mut self) -> Stack<'_, T, N> {
        Stack { items: &mut self.0, len: 0 }
    }
}

/// A stack; its length is apart from its memory, so that it can live in a register.
pub(crate) struct Stack<'a, T: Copy, const N: usize> {
    items: &'a mut [MaybeUninit<T>; N],
    len: usize,
}

impl<T: Copy, const N: usize> Stack<'_, T, N> {
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

    /// Puts the first `n` of some items on top, the first lowest, without a branch on `n`.
    #[inline(always)]
    pub(crate) fn push_first<const M: usize>(&mut self, items: [T; M], n: usize) {
        assert!(n <= M);
        let top: &mut [MaybeUninit<T>; M] =
            (&mut self.items[self.len..self.len + M]).try_into().expect("as many as sliced");
        *top = items.map(MaybeUninit::new);
        self.len += n;
    }

    /// Takes the top item.
    #[inline(always)]
    pub(crate) fn pop(&mut self) -> Option<T> {
        self.len = self.len.checked_sub(1)?;
        // SAFETY: `len` was above this place and at most `N`; every function that raises it has written all
        // places below.
        Some(unsafe { self.items.get_unchecked(self.len).assume_init() })
    }

    /// Puts `n` items on top; `item(i)` gives the place of item `i`, counted from the present top, and the item.
    ///
    /// `item` must give each place of `0..n` once over the calls for `0..n`; otherwise this panics.
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
        let mut memory = StackMemory::<u64, 8>::new();
        let mut stack = memory.stack();
        stack.push(1);
        stack.push_ranked(3, |i| ([2, 0, 1][i], 10 + i as u64));
        stack.push_first([7, 8, 9], 2);
        let out: Vec<u64> = core::iter::from_fn(|| stack.pop()).collect();
        assert_eq!(out, [8, 7, 10, 12, 11, 1]);
        assert_eq!(stack.len(), 0);
    }

    #[test]
    #[should_panic(expected = "every place")]
    fn a_hole_is_refused() {
        StackMemory::<u64, 8>::new().stack().push_ranked(2, |_| (0, 1));
    }
}
