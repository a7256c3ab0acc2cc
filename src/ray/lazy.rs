//! Ray queries in a lazy tree: the coarse tree leads to subtrees, which are built when a ray first reaches them and
//! queried as trees of their own.
//!
//! A subtree is queried by the same code as a tree that was built whole. All trees share one tree space, so each hit
//! has the same bits as there. Ending the ray at the best hit so far changes no nearer hit, and of several at the same
//! `t` the lowest (mesh, primitive) wins here as it does there. Each primitive is in one subtree only.

use super::filter::Filter;
use super::hit::Hit;
use super::intersect::RaySource;
use super::observer::Observer;
use super::query::{AllQuery, Asked, ClosestQuery, OfWide, Query};
use super::stops::{Stops, Way};
use super::tree_ray::TreeRay;
use crate::geometry::Ray;
use crate::layout::{ChildRef, LazyTree, WideTree};
use crate::simd::{SimdLevel, dispatch};
use core::ops::ControlFlow;

/// A query that can be answered from one subtree after the other.
pub(super) trait LazyQuery: Query {
    /// Answers the query from all subtrees that the ray reaches.
    fn ask_lazily(self, tree: &LazyTree, simd: SimdLevel) -> Self::Answer;
}

impl<G: RaySource, F: Filter, O: Observer> LazyQuery for ClosestQuery<'_, G, F, O> {
    #[inline(never)]
    fn ask_lazily(self, tree: &LazyTree, simd: SimdLevel) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let ask = |tree: &WideTree, asked: Asked<'_, G, F, O>| {
            let end = asked.ray.t_max;
            let order = |hit: &Hit| (hit.t, hit.mesh, hit.primitive);
            if let Some(hit) = dispatch(simd, OfWide { tree, query: ClosestQuery(asked) })
                && best.is_none_or(|best| order(&hit) < order(&best))
            {
                best = Some(hit);
            }
            ControlFlow::Continue(best.map_or(end, |best| best.t))
        };
        lead::<true, _, _, _, _>(tree, simd, self.0, ask);
        best
    }
}

impl<G: RaySource, F: Filter, O: Observer> LazyQuery for AllQuery<'_, G, F, O> {
    #[inline(never)]
    fn ask_lazily(self, tree: &LazyTree, simd: SimdLevel) -> ControlFlow<()> {
        let AllQuery { asked, visitor } = self;
        let mut flow = ControlFlow::Continue(());
        let ask = |tree: &WideTree, asked: Asked<'_, G, F, O>| {
            let end = asked.ray.t_max;
            flow = dispatch(simd, OfWide { tree, query: AllQuery { asked, visitor: &mut *visitor } });
            flow?;
            ControlFlow::Continue(end)
        };
        lead::<false, _, _, _, _>(tree, simd, asked, ask);
        flow
    }
}

/// Visits the subtrees that a ray reaches, until `ask` breaks.
fn lead<const ORDERED: bool, G, F, O, A>(tree: &LazyTree, simd: SimdLevel, asked: Asked<'_, G, F, O>, ask: A)
where
    G: RaySource,
    O: Observer,
    A: FnMut(&WideTree, Asked<'_, G, F, O>) -> ControlFlow<(), f32>,
{
    let ray = asked.ray;
    if tree.top.root == ChildRef::NOTHING {
        return;
    }
    let Some(tree_ray) = TreeRay::new(ray, asked.set.frame()) else { return };
    // Compiled once for all queries: the query of a subtree takes far longer than the call.
    let stops: &mut dyn Stops = &mut Subtrees { tree, asked, ask };
    dispatch(simd, Way::<'_, ORDERED, _> { tree: &tree.top, ray, tree_ray: &tree_ray, stops });
}

/// The subtrees that a ray reaches.
struct Subtrees<'a, 'b, G, F, O, A> {
    tree: &'a LazyTree,
    asked: Asked<'b, G, F, O>,
    ask: A,
}

impl<G, F, O, A> Stops for Subtrees<'_, '_, G, F, O, A>
where
    G: RaySource,
    O: Observer,
    A: FnMut(&WideTree, Asked<'_, G, F, O>) -> ControlFlow<(), f32>,
{
    fn node(&mut self) {
        self.asked.observer.node();
    }

    /// Leaves are counted by the query of the subtree.
    fn leaf(&mut self) {}

    fn ask(&mut self, subtree: u32, ray: &Ray) -> ControlFlow<(), f32> {
        let Asked { set, filter, ref mut observer, .. } = self.asked;
        (self.ask)(self.tree.subtree(set, subtree), Asked { set, ray, filter, observer })
    }
}
