//! Ray queries in a lazy tree: the coarse tree leads to subtrees, which are built when a ray first reaches them and
//! queried as trees of their own.
//!
//! A subtree is queried by the same code as a tree that was built whole. All trees share one tree space, so each hit
//! has the same bits as there. Ending the ray at the best hit so far changes no nearer hit, and of several at the same
//! `t` the lowest (mesh, primitive) wins here as it does there. Each primitive is in one subtree only.

use super::intersect::RaySource;
use super::query::{AllHits, Asked, ClosestHit, OfWide, Query, QueryArgs};
use super::ray_traversal::{LeafVisitor, RayTraversal};
use crate::geometry::Ray;
use crate::layout::{ChildRef, LazyTree, WideTree};
use crate::ray::filter::Filter;
use crate::ray::hit::Hit;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;
use crate::simd::{Simd, SimdLevel, dispatch};
use core::ops::ControlFlow;

/// A query that can be answered from one subtree after the other.
pub(in crate::ray) trait LazyQuery: Query {
    /// Answers the query from all subtrees that the ray reaches.
    fn answer_lazily<G: RaySource, F: Filter, O: Observer>(
        self,
        args: QueryArgs<'_, G, F, O>,
        tree: &LazyTree,
        simd: SimdLevel,
    ) -> Self::Answer;
}

impl LazyQuery for ClosestHit {
    #[inline(never)]
    fn answer_lazily<G: RaySource, F: Filter, O: Observer>(
        self,
        args: QueryArgs<'_, G, F, O>,
        tree: &LazyTree,
        simd: SimdLevel,
    ) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let answer = |tree: &WideTree, args: QueryArgs<'_, G, F, O>| {
            let end = args.ray.t_max;
            let order = |hit: &Hit| (hit.t, hit.mesh, hit.primitive);
            let asked = Asked(ClosestHit, args);
            if let Some(hit) = dispatch(simd, OfWide { tree, outline: None, asked })
                && best.is_none_or(|best| order(&hit) < order(&best))
            {
                best = Some(hit);
            }
            ControlFlow::Continue(best.map_or(end, |best| best.t))
        };
        traverse_subtrees::<true, _, _, _, _>(tree, simd, args, answer);
        best
    }
}

impl LazyQuery for AllHits<'_> {
    #[inline(never)]
    fn answer_lazily<G: RaySource, F: Filter, O: Observer>(
        self,
        args: QueryArgs<'_, G, F, O>,
        tree: &LazyTree,
        simd: SimdLevel,
    ) -> ControlFlow<()> {
        let mut flow = ControlFlow::Continue(());
        let answer = |tree: &WideTree, args: QueryArgs<'_, G, F, O>| {
            let end = args.ray.t_max;
            let asked = Asked(AllHits(&mut *self.0), args);
            flow = dispatch(simd, OfWide { tree, outline: None, asked });
            flow?;
            ControlFlow::Continue(end)
        };
        traverse_subtrees::<false, _, _, _, _>(tree, simd, args, answer);
        flow
    }
}

/// Visits the subtrees that a ray reaches, until `answer` breaks.
fn traverse_subtrees<const ORDERED: bool, G, F, O, A>(
    tree: &LazyTree,
    simd: SimdLevel,
    args: QueryArgs<'_, G, F, O>,
    answer: A,
) where
    G: RaySource,
    O: Observer,
    A: FnMut(&WideTree, QueryArgs<'_, G, F, O>) -> ControlFlow<(), f32>,
{
    let ray = args.ray;
    if tree.top.root == ChildRef::NOTHING {
        return;
    }
    let Some(tree_ray) = TreeRay::new(ray, args.set.frame()) else { return };
    // Compiled once for all queries: the query of a subtree takes far longer than the call.
    let visitor: &mut dyn SubtreeVisitor = &mut Subtrees { tree, args, answer };
    dispatch(simd, RayTraversal::<'_, ORDERED, _> { tree: &tree.top, ray, tree_ray: &tree_ray, visitor });
}

/// The subtrees that a ray reaches.
struct Subtrees<'a, 'b, G, F, O, A> {
    tree: &'a LazyTree,
    args: QueryArgs<'b, G, F, O>,
    answer: A,
}

/// The callbacks of [`LeafVisitor`] in a form that can be called through `dyn`.
trait SubtreeVisitor {
    fn node(&mut self);
    fn subtree(&mut self, subtree: u32, ray: &Ray) -> ControlFlow<(), f32>;
}

impl LeafVisitor for dyn SubtreeVisitor + '_ {
    fn node(&mut self) {
        SubtreeVisitor::node(self);
    }

    /// Leaves are counted by the query of the subtree.
    fn leaf(&mut self) {}

    fn object<S: Simd>(&mut self, _: S, subtree: u32, ray: &Ray) -> ControlFlow<(), f32> {
        self.subtree(subtree, ray)
    }
}

impl<G, F, O, A> SubtreeVisitor for Subtrees<'_, '_, G, F, O, A>
where
    G: RaySource,
    O: Observer,
    A: FnMut(&WideTree, QueryArgs<'_, G, F, O>) -> ControlFlow<(), f32>,
{
    fn node(&mut self) {
        self.args.observer.node();
    }

    fn subtree(&mut self, subtree: u32, ray: &Ray) -> ControlFlow<(), f32> {
        let QueryArgs { set, filter, ref mut observer, .. } = self.args;
        (self.answer)(self.tree.subtree(set, subtree), QueryArgs { set, ray, filter, observer })
    }
}
