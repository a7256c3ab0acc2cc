//! The three kinds of ray queries, independent of the layout.

use super::collect::{All, Any, Closest, Found};
use super::filter::Filter;
use super::hit::Hit;
use super::intersect::RaySource;
use super::observer::Observer;
use super::outline::Outline;
use super::ray_layout::RayLayout;
use super::tree_ray::TreeRay;
use super::wide_traversal::Wide;
use crate::geometry::{Frame, Ray};
use crate::layout::WideTree;
use crate::simd::{Kernel, Simd};
use crate::traverse::StackOf;
use core::ops::ControlFlow;

/// A query with all its state but the layout.
///
/// The prepared ray and the best answer so far live in registers where the layout's traversal is inlined into the
/// query; so the whole query is dispatched to the instruction set of the layout.
pub(crate) trait Query {
    /// The answer.
    type Answer;
    /// The answer of a ray that hits nothing.
    const NOTHING: Self::Answer;
    /// The ray, and the map to tree space.
    fn placed_ray(&self) -> (&Ray, &Frame);
    /// Answers the query from a layout.
    fn answer(self, layout: impl RayLayout) -> Self::Answer;
}

/// The arguments of a query: a ray, its geometry, a filter and an observer.
pub(crate) struct QueryArgs<'a, G, F, O> {
    pub set: &'a G,
    pub ray: &'a Ray,
    pub filter: &'a F,
    pub observer: &'a mut O,
}

impl<G: RaySource, F, O> QueryArgs<'_, G, F, O> {
    /// See [`Query::placed_ray`].
    #[inline(always)]
    fn placed_ray(&self) -> (&Ray, &Frame) {
        (self.ray, self.set.frame())
    }
}

/// The closest-hit query.
pub(crate) struct ClosestQuery<'a, G, F, O>(pub QueryArgs<'a, G, F, O>);

impl<G: RaySource, F: Filter, O: Observer> Query for ClosestQuery<'_, G, F, O> {
    type Answer = Option<Hit>;
    const NOTHING: Option<Hit> = None;

    #[inline(always)]
    fn placed_ray(&self) -> (&Ray, &Frame) {
        self.0.placed_ray()
    }

    #[inline(always)]
    fn answer(self, layout: impl RayLayout) -> Option<Hit> {
        let QueryArgs { set, ray, filter, observer } = self.0;
        let (mut of, regular) = TreeRay::of(ray, set.frame());
        if !regular {
            of.recompute(set.frame());
        }
        let ray = &of;
        if ray.has_empty_range() {
            return None;
        }
        let accept = |found: &Found| filter.accepts(|| found.answer(set));
        let mut collect = Closest::new(ray, accept);
        layout.traverse(set, ray, filter, &mut collect, observer);
        collect.best.map(|found| found.answer(set))
    }
}

/// The occlusion query: whether there is a hit.
pub(crate) struct AnyQuery<'a, G, F, O>(pub QueryArgs<'a, G, F, O>);

impl<G: RaySource, F: Filter, O: Observer> Query for AnyQuery<'_, G, F, O> {
    type Answer = bool;
    const NOTHING: bool = false;

    #[inline(always)]
    fn placed_ray(&self) -> (&Ray, &Frame) {
        self.0.placed_ray()
    }

    #[inline(always)]
    fn answer(self, layout: impl RayLayout) -> bool {
        let QueryArgs { set, ray, filter, observer } = self.0;
        let (mut of, regular) = TreeRay::of(ray, set.frame());
        if !regular {
            of.recompute(set.frame());
        }
        let ray = &of;
        if ray.has_empty_range() {
            return false;
        }
        let accept = |found: &Found| filter.accepts(|| found.answer(set));
        let mut collect = Any::new(ray, filter.accepts_all(), accept);
        layout.traverse(set, ray, filter, &mut collect, observer);
        collect.found
    }
}

/// The caller's function that is called with each hit.
pub(super) type Visitor<'a> = &'a mut dyn FnMut(Hit) -> ControlFlow<()>;

/// The query for all hits.
pub(crate) struct AllQuery<'a, G, F, O> {
    pub args: QueryArgs<'a, G, F, O>,
    pub visitor: Visitor<'a>,
}

impl<G: RaySource, F: Filter, O: Observer> Query for AllQuery<'_, G, F, O> {
    type Answer = ControlFlow<()>;
    const NOTHING: ControlFlow<()> = ControlFlow::Continue(());

    #[inline(always)]
    fn placed_ray(&self) -> (&Ray, &Frame) {
        self.args.placed_ray()
    }

    #[inline(always)]
    fn answer(self, layout: impl RayLayout) -> ControlFlow<()> {
        let QueryArgs { set, ray, filter, observer } = self.args;
        let (mut of, regular) = TreeRay::of(ray, set.frame());
        if !regular {
            of.recompute(set.frame());
        }
        let ray = &of;
        if ray.has_empty_range() {
            return ControlFlow::Continue(());
        }
        let mut collect = All::new(ray, |found: &Found| {
            let hit = found.answer(set);
            if filter.accepts(|| hit) { (self.visitor)(hit) } else { ControlFlow::Continue(()) }
        });
        layout.traverse(set, ray, filter, &mut collect, observer);
        collect.flow
    }
}

/// A query of the wide layout, to be dispatched to an instruction set.
pub(crate) struct OfWide<'a, Q> {
    pub tree: &'a WideTree,
    pub outline: &'a Outline,
    pub query: Q,
}

impl<Q: Query> Kernel for OfWide<'_, Q> {
    type Output = Q::Answer;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Q::Answer {
        let (ray, frame) = self.query.placed_ray();
        if self.outline.is_missed(s, ray, frame) {
            return Q::NOTHING;
        }
        let mut memory = StackOf::new();
        let stack = memory.stack(self.tree.max_stack());
        self.query.answer(Wide { tree: self.tree, simd: s, stack })
    }
}
