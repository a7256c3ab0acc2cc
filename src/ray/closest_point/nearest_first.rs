//! Best-first traversal of any wide tree from a point: boxes in order of their distances, until every remaining one is
//! farther away than the best answer. The type of the leaves is given by [`LeafSearch`]: primitives, subtrees that are
//! built on demand, or instances.

use super::point_query::QueryInTree;
use crate::layout::{ChildRef, WideTree};
use crate::simd::{Kernel, Mask, Simd};
use crate::traverse::{Cursor, NodeBlock, StackOf, WideQuery, WideTraversal};
use core::ops::ControlFlow;

/// The leaves of a tree, and the best answer found in them so far.
pub(crate) trait LeafSearch {
    /// The greatest distance of a point that can still improve the answer.
    fn limit(&self) -> f32;
    /// Whether everything in a block is hidden from the query, or does not exist at its time.
    fn hides(&self, block: ChildRef) -> bool;
    /// A node is about to be tested.
    fn node(&mut self);
    /// Searches a leaf.
    fn leaf<S: Simd>(&mut self, s: S, leaf: ChildRef);
}

/// The traversal of a tree, to be dispatched to an instruction set.
pub(crate) struct NearestFirst<'a, L> {
    pub tree: &'a WideTree,
    pub query: &'a QueryInTree<'a>,
    pub leaves: &'a mut L,
}

impl<L: LeafSearch> Kernel for NearestFirst<'_, L> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let NearestFirst { tree, query, leaves } = self;
        if tree.root == ChildRef::NOTHING {
            return;
        }
        let mut memory = StackOf::new();
        let mut cursor = Cursor::new(tree.root, memory.stack(tree.max_stack()));
        let traversal = WideTraversal::new(&tree.arena);
        let cull = query.cull(leaves.limit());
        let mut search = Search { query, cull, leaves };
        while traversal.advance(s, &mut cursor, &mut search).is_continue() {}
    }
}

/// The state of a search.
struct Search<'a, L> {
    query: &'a QueryInTree<'a>,
    /// [`QueryInTree::cull`] of the current limit.
    cull: f32,
    leaves: &'a mut L,
}

impl<S: Simd, L: LeafSearch> WideQuery<S> for Search<'_, L> {
    const ORDERED: bool = true;

    #[inline(always)]
    fn time(&self) -> f32 {
        self.query.time
    }

    #[inline(always)]
    fn hides(&self, block: ChildRef) -> bool {
        self.leaves.hides(block)
    }

    #[inline(always)]
    fn node(&mut self) {
        self.leaves.node();
    }

    #[inline(always)]
    fn enter<const ROWS: usize>(&self, s: S, block: &NodeBlock) -> (Mask, S::F) {
        self.query.enter::<S, ROWS>(s, block, self.cull)
    }

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.cull
    }

    #[inline(always)]
    fn leaf(&mut self, s: S, leaf: ChildRef) -> ControlFlow<()> {
        self.leaves.leaf(s, leaf);
        self.cull = self.query.cull(self.leaves.limit());
        ControlFlow::Continue(())
    }
}
