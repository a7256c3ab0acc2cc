//! What a traversal of the wide layout has at hand.

use crate::simd::Arena;

/// What does not change during a query.
pub(super) struct Traverser<'a, G, F> {
    pub arena: &'a Arena,
    /// Where lists of ids begin, see [`WideTree::lists`](crate::layout::WideTree::lists).
    pub lists: usize,
    pub set: &'a G,
    pub filter: &'a F,
}
