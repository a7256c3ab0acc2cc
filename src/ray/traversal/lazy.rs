//! Ray queries in a lazy tree: the coarse tree leads to subtrees, which are built when a ray first reaches them.
//!
//! All trees share one tree space. So a ray is prepared alike for each of them, and its hits are collected across subtrees as they
//! are across the leaves of a whole tree: each has the same bits as there, and of several at the same `t` the same one wins.

use super::collect::Collect;
use super::object_traversal::{LeafVisitor, ObjectTraversal};
use super::query::{QueryArgs, QueryCall, RayQuery, WideTreeQueryInto};
use crate::geometry::Ray;
use crate::layout::{ChildRef, LazyTree};
use crate::primitive::{PrimitiveSet, Scene};
use crate::ray::filter::Filter;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;
use crate::simd::{Simd, SimdLevel, dispatch};
use core::ops::ControlFlow;

/// Answers a query from all subtrees that the ray reaches.
#[inline(never)]
pub(in crate::ray) fn answer_lazily<F: Filter, O: Observer, Q: RayQuery>(
    call: QueryCall<'_, F, O, Q>,
    tree: &LazyTree,
    simd: SimdLevel,
) -> Q::Answer {
    let QueryCall(query, QueryArgs { scene, ray, filter, observer }) = call;
    if tree.top.root == ChildRef::NOTHING {
        return Q::NOTHING;
    }
    let Some(tree_ray) = &TreeRay::new(ray, scene.frame()) else { return Q::NOTHING };
    let collect = Some(query.collect(tree_ray, filter.accepts_all()));
    let top = &tree.top;
    let mut subtrees = Subtrees::<_, _, Q> { tree, simd, scene, ray, filter, collect, observer };
    // Compiled once for all queries: the query of a subtree takes far longer than the call.
    let visitor: &mut dyn SubtreeVisitor = &mut subtrees;
    match Q::Collect::ORDERED {
        true => dispatch(simd, ObjectTraversal::<'_, true, _> { tree: top, ray, tree_ray, visitor }),
        false => dispatch(simd, ObjectTraversal::<'_, false, _> { tree: top, ray, tree_ray, visitor }),
    }
    subtrees.collect.map_or(Q::NOTHING, |collect| Q::answer(collect, scene))
}

/// The subtrees that a ray reaches, and the parts of its query.
struct Subtrees<'a, F, O, Q: RayQuery> {
    tree: &'a LazyTree,
    simd: SimdLevel,
    scene: &'a Scene,
    ray: &'a Ray,
    filter: &'a F,
    /// There is one throughout.
    collect: Option<Q::Collect>,
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

impl<F: Filter, O: Observer, Q: RayQuery> SubtreeVisitor for Subtrees<'_, F, O, Q> {
    fn mask(&self) -> Option<u32> {
        self.filter.mask()
    }

    fn node(&mut self) {
        self.observer.node();
    }

    fn subtree(&mut self, subtree: u32) -> ControlFlow<(), f32> {
        let args = QueryArgs { scene: self.scene, ray: self.ray, filter: self.filter, observer: &mut *self.observer };
        let tree = self.tree.subtree(self.scene, subtree);
        let collect = &mut self.collect;
        dispatch(self.simd, WideTreeQueryInto::<_, _, Q> { tree, outline: None, query: None, args, collect });
        match &self.collect {
            Some(collect) if !collect.is_final() => ControlFlow::Continue(collect.limit()),
            _ => ControlFlow::Break(()),
        }
    }
}
