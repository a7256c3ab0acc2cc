//! Ray queries in a lazy tree: the coarse tree leads to subtrees, which are built when a ray first reaches them.
//!
//! All trees share one tree space. So the ray is prepared once, and its hits are collected across subtrees as they are across the leaves
//! of a whole tree: each has the same bits as there, and of several at the same `t` the same one wins.

use super::collect::Collect;
use super::intersect::RaySource;
use super::query::{Asked, Query, QueryArgs};
use super::ray_traversal::{LeafVisitor, RayTraversal};
use super::wide_traversal::TraverseWide;
use crate::geometry::Ray;
use crate::layout::{ChildRef, LazyTree};
use crate::ray::filter::Filter;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;
use crate::simd::{Simd, SimdLevel, dispatch};
use core::ops::ControlFlow;

/// Answers a query from all subtrees that the ray reaches.
#[inline(never)]
pub(in crate::ray) fn answer_lazily<G: RaySource, F: Filter, O: Observer, Q: Query>(
    asked: Asked<'_, G, F, O, Q>,
    tree: &LazyTree,
    simd: SimdLevel,
) -> Q::Answer {
    let Asked(query, QueryArgs { set, ray, filter, observer }) = asked;
    if tree.top.root == ChildRef::NOTHING {
        return Q::NOTHING;
    }
    let Some(tree_ray) = TreeRay::new(ray, set.frame()) else { return Q::NOTHING };
    let (tree_ray, top) = (&tree_ray, &tree.top);
    let mut collect = query.collect(tree_ray, filter.accepts_all());
    // Compiled once for all queries: the query of a subtree takes far longer than the call.
    let visitor: &mut dyn SubtreeVisitor =
        &mut Subtrees { tree, simd, set, tree_ray, filter, collect: &mut collect, observer };
    match Q::Collect::ORDERED {
        true => dispatch(simd, RayTraversal::<'_, true, _> { tree: top, ray, tree_ray, visitor }),
        false => dispatch(simd, RayTraversal::<'_, false, _> { tree: top, ray, tree_ray, visitor }),
    }
    Q::answer(collect, set)
}

/// The subtrees that a ray reaches, and the parts of its query.
struct Subtrees<'a, 'b, G, F, C, O> {
    tree: &'a LazyTree,
    simd: SimdLevel,
    set: &'a G,
    tree_ray: &'a TreeRay<'b>,
    filter: &'a F,
    collect: &'a mut C,
    observer: &'a mut O,
}

/// The callbacks of [`LeafVisitor`] in a form that can be called through `dyn`.
trait SubtreeVisitor {
    fn mask(&self) -> Option<u32>;
    fn node(&mut self);
    fn subtree(&mut self, subtree: u32) -> ControlFlow<(), f32>;
}

impl LeafVisitor for dyn SubtreeVisitor + '_ {
    fn mask(&self) -> Option<u32> {
        SubtreeVisitor::mask(self)
    }

    fn node(&mut self) {
        SubtreeVisitor::node(self);
    }

    /// Leaves are counted by the query of the subtree.
    fn leaf(&mut self) {}

    fn object<S: Simd>(&mut self, _: S, subtree: u32, _: &Ray) -> ControlFlow<(), f32> {
        self.subtree(subtree)
    }
}

impl<G: RaySource, F: Filter, C: Collect, O: Observer> SubtreeVisitor for Subtrees<'_, '_, G, F, C, O> {
    fn mask(&self) -> Option<u32> {
        self.filter.mask()
    }

    fn node(&mut self) {
        self.observer.node();
    }

    fn subtree(&mut self, subtree: u32) -> ControlFlow<(), f32> {
        let Subtrees { set, tree_ray, filter, ref mut collect, ref mut observer, .. } = *self;
        let tree = self.tree.subtree(set, subtree);
        let (collect, observer) = (&mut **collect, &mut **observer);
        dispatch(self.simd, TraverseWide { tree, set, ray: tree_ray, filter, collect, observer });
        if self.collect.is_final() { ControlFlow::Break(()) } else { ControlFlow::Continue(self.collect.limit()) }
    }
}
