//! The nearest point in a lazy tree: the coarse tree says in which order subtrees are searched, all for one best answer.

use super::closest_point::{Best, ClosestPoint, ClosestPointQuery, ClosestPointSource, Query, Wide, begin};
use super::filter::Filter;
use super::observer::Observer;
use crate::layout::{ChildRef, LazyTree};
use crate::simd::{Kernel, Mask, Simd, SimdLevel, dispatch};
use crate::traverse::{Cursor, NodeBlock, StackOf, WideQuery, WideTraversal};
use core::ops::ControlFlow;

/// The nearest point in a lazy tree.
#[inline(never)]
pub(super) fn closest_point_in_lazy<G: ClosestPointSource>(
    simd: SimdLevel,
    tree: &LazyTree,
    set: &G,
    query: &ClosestPointQuery,
    filter: &impl Filter<ClosestPoint>,
    observer: &mut impl Observer,
) -> Option<ClosestPoint> {
    let query = Query::new(query, *set.frame())?;
    let mut best = begin(set, &query, filter);
    if tree.top.root != ChildRef::NOTHING {
        let cull = query.cull(best.limit);
        dispatch(simd, InTop { simd, tree, best: &mut best, cull, observer });
    }
    best.finish()
}

/// The search through the coarse tree.
struct InTop<'a, 'b, G, F, O> {
    simd: SimdLevel,
    tree: &'a LazyTree,
    best: &'b mut Best<'a, G, F>,
    /// [`Query::cull`] of the best.
    cull: f32,
    observer: &'b mut O,
}

impl<G: ClosestPointSource, F: Filter<ClosestPoint>, O: Observer> Kernel for InTop<'_, '_, G, F, O> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        let top = &self.tree.top;
        let mut memory = StackOf::new();
        let mut cursor = Cursor::new(top.root, memory.stack(top.waiting()));
        let traversal = WideTraversal::new(&top.arena);
        while traversal.advance(s, &mut cursor, &mut self).is_continue() {}
    }
}

impl<S: Simd, G: ClosestPointSource, F: Filter<ClosestPoint>, O: Observer> WideQuery<S> for InTop<'_, '_, G, F, O> {
    const ORDERED: bool = true;

    #[inline(always)]
    fn time(&self) -> f32 {
        self.best.query.time
    }

    #[inline(always)]
    fn node(&mut self) {
        self.observer.node();
    }

    #[inline(always)]
    fn enter<const ROWS: usize>(&self, s: S, block: &NodeBlock) -> (Mask, S::F) {
        self.best.query.enter::<S, ROWS>(s, block, self.cull)
    }

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.cull
    }

    #[inline(always)]
    fn leaf(&mut self, _: S, leaf: ChildRef) -> ControlFlow<()> {
        let tree = self.tree.subtree(self.best.set, self.tree.below(leaf));
        dispatch(self.simd, Wide { tree, best: &mut *self.best, observer: &mut *self.observer });
        self.cull = self.best.query.cull(self.best.limit);
        ControlFlow::Continue(())
    }
}
