//! The three kinds of ray queries, independent of the layout.

use super::collect::{All, Any, Closest, Collect, HitVisitor};
use super::ray_layout::RayLayout;
use super::wide_traversal::Wide;
use crate::geometry::Ray;
use crate::layout::WideTree;
use crate::primitive::{PrimitiveSet, Scene};
use crate::ray::filter::Filter;
use crate::ray::hit::Hit;
use crate::ray::kernel::outline::Outline;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;
use crate::simd::{Kernel, Simd};
use crate::traverse::StackOf;
use core::ops::ControlFlow;

/// What is asked about a ray.
pub(crate) trait RayQuery {
    /// The answer.
    type Answer;
    /// The answer of a ray that hits nothing.
    const NOTHING: Self::Answer;
    /// Collects the hits of a ray.
    type Collect: Collect;
    /// A collector for a ray's hits. `all` tells whether the filter accepts every hit.
    fn collect(self, ray: &TreeRay, all: bool) -> Self::Collect;
    /// The answer, once the traversal has finished.
    fn answer(collect: Self::Collect, scene: &Scene) -> Self::Answer;
}

/// The closest hit.
#[derive(Clone, Copy)]
pub(crate) struct ClosestHit;

impl RayQuery for ClosestHit {
    type Answer = Option<Hit>;
    const NOTHING: Option<Hit> = None;
    type Collect = Closest;

    #[inline(always)]
    fn collect(self, ray: &TreeRay, _: bool) -> Closest {
        Closest::new(ray)
    }

    #[inline(always)]
    fn answer(collect: Closest, scene: &Scene) -> Option<Hit> {
        // Not by `map`: that may become a call, for which the best hit so far would be kept in memory.
        let found = collect.best?;
        Some(found.answer(scene))
    }
}

/// Whether there is a hit (occlusion).
#[derive(Clone, Copy)]
pub(crate) struct AnyHit;

impl RayQuery for AnyHit {
    type Answer = bool;
    const NOTHING: bool = false;
    type Collect = Any;

    #[inline(always)]
    fn collect(self, ray: &TreeRay, all: bool) -> Any {
        Any::new(ray, all)
    }

    #[inline(always)]
    fn answer(collect: Any, _: &Scene) -> bool {
        collect.found
    }
}

/// All hits, for a visitor; without one, whether there is a hit. (What is not worth compiling for [`AnyHit`] as well.)
pub(crate) struct AllHits<'a> {
    pub visitor: Option<HitVisitor<'a>>,
    /// Whether a ray may find a primitive in several leaves.
    pub repeats: bool,
}

impl<'a> RayQuery for AllHits<'a> {
    /// `Break` if the visitor returned it; without one, if there is a hit.
    type Answer = ControlFlow<()>;
    const NOTHING: ControlFlow<()> = ControlFlow::Continue(());
    type Collect = All<'a>;

    #[inline(always)]
    fn collect(self, ray: &TreeRay, all: bool) -> All<'a> {
        All::new(ray, self.visitor, all, self.repeats || ray.in_pieces)
    }

    #[inline(always)]
    fn answer(collect: All<'a>, _: &Scene) -> ControlFlow<()> {
        collect.flow
    }
}

/// The arguments of a query: a ray, its geometry, a filter and an observer.
pub(crate) struct QueryArgs<'a, F, O> {
    pub scene: &'a Scene,
    pub ray: &'a Ray,
    pub filter: &'a F,
    pub observer: &'a mut O,
}

/// A call of a query: the query, and its arguments.
pub(crate) struct QueryCall<'a, F, O, Q>(pub Q, pub QueryArgs<'a, F, O>);

impl<F: Filter, O: Observer, Q: RayQuery> QueryCall<'_, F, O, Q> {
    /// Answers the query from a layout.
    ///
    /// The prepared ray and the best answer so far live in registers where the layout's traversal is inlined here; so the
    /// whole query is dispatched to the instruction set of the layout.
    #[inline(always)]
    pub fn answer(self, layout: impl RayLayout) -> Q::Answer {
        let QueryCall(query, QueryArgs { scene, ray, filter, observer }) = self;
        let near = layout.near();
        let (mut ray, regular) = TreeRay::of(ray, scene.frame(), near);
        if !regular {
            ray.recompute(scene.frame(), near);
        }
        if ray.has_empty_range() {
            return Q::NOTHING;
        }
        let mut collect = query.collect(&ray, filter.accepts_all());
        layout.traverse(scene, &mut ray, filter, &mut collect, observer);
        Q::answer(collect, scene)
    }
}

/// A query of the wide layout, or the part of a query of a lazy tree that a subtree answers, to be dispatched to an instruction
/// set. One form of it is compiled for both.
pub(in crate::ray) struct WideTreeQueryInto<'a, F, O, Q: RayQuery> {
    pub tree: &'a WideTree,
    /// `None` if the ray is known not to miss it.
    pub outline: Option<&'a Outline>,
    /// The query, if it begins here.
    pub query: Option<Q>,
    pub args: QueryArgs<'a, F, O>,
    /// The collector, made here if the query begins here. There is none afterwards if the ray misses the outline or can hit
    /// nothing.
    pub collect: &'a mut Option<Q::Collect>,
}

impl<F: Filter, O: Observer, Q: RayQuery> Kernel for WideTreeQueryInto<'_, F, O, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let WideTreeQueryInto { tree, outline, query, args: QueryArgs { scene, ray, filter, observer }, collect } =
            self;
        if outline.is_some_and(|outline| outline.is_missed(s, ray, scene.frame())) {
            return;
        }
        let mut memory = StackOf::new();
        let stack = memory.stack(tree.max_stack());
        let (mut ray, regular) = TreeRay::of(ray, scene.frame(), tree.near);
        if !regular {
            ray.recompute(scene.frame(), tree.near);
        }
        if ray.has_empty_range() {
            return;
        }
        if let Some(query) = query {
            *collect = Some(query.collect(&ray, filter.accepts_all()));
        }
        if let Some(collect) = collect {
            Wide { tree, simd: s, stack }.traverse(scene, &mut ray, filter, collect, observer);
        }
    }
}

/// A query of the wide layout, to be dispatched to an instruction set.
pub(crate) struct WideTreeQuery<'a, F, O, Q> {
    pub tree: &'a WideTree,
    /// `None` if the ray is known not to miss it.
    pub outline: Option<&'a Outline>,
    pub call: QueryCall<'a, F, O, Q>,
}

impl<F: Filter, O: Observer, Q: RayQuery> Kernel for WideTreeQuery<'_, F, O, Q> {
    type Output = Q::Answer;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Q::Answer {
        let QueryArgs { scene, ray, .. } = self.call.1;
        if let Some(outline) = self.outline
            && outline.is_missed(s, ray, scene.frame())
        {
            return Q::NOTHING;
        }
        let mut memory = StackOf::new();
        let stack = memory.stack(self.tree.max_stack());
        self.call.answer(Wide { tree: self.tree, simd: s, stack })
    }
}
