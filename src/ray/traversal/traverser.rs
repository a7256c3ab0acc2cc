//! The constants of a traversal of the wide layout.

use crate::layout::{BlockMasks, ChildRef, WideTree};
use crate::primitive::Scene;
use crate::ray::filter::Filter;
use crate::simd::Arena;

/// What does not change during a query.
pub(in crate::ray) struct Traverser<'a, F> {
    pub arena: &'a Arena,
    /// Offset of the lists of ids, see [`WideTree::lists`](crate::layout::WideTree::lists).
    pub lists: usize,
    pub scene: &'a Scene,
    pub filter: &'a F,
    masks: &'a BlockMasks,
}

impl<'a, F: Filter> Traverser<'a, F> {
    pub fn new(tree: &'a WideTree, scene: &'a Scene, filter: &'a F) -> Traverser<'a, F> {
        Traverser { arena: &tree.arena, lists: tree.lists, scene, filter, masks: &tree.masks }
    }

    /// Whether the mask of the query hides everything in a block.
    #[inline(always)]
    pub fn hides(&self, block: ChildRef) -> bool {
        self.masks.hide(block, self.filter.mask())
    }
}
