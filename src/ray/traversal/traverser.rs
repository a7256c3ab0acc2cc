//! The constants of a traversal of the wide layout.

use crate::simd::Arena;

/// What does not change during a query.
pub(in crate::ray) struct Traverser<'a, G, F> {
    pub arena: &'a Arena,
    /// Offset of the lists of ids, see [`WideTree::lists`](crate::layout::WideTree::lists).
    pub lists: usize,
    pub set: &'a G,
    pub filter: &'a F,
}
