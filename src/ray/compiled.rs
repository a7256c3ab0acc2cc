//! The queries of a tree as function pointers, compiled once, in the crate that builds the tree.
//!
//! A query is generic over the geometry, the filter and the observer, and is compiled for each instruction set and
//! layout. If callers instantiated it, every crate with a query would compile all of that again. So a tree carries the
//! addresses of its queries, which this crate compiled for triangles and for primitives of any type ([`super::erased_shapes`]);
//! builds are compiled likewise. Filters, observers and visitors are called through `dyn`, once per accepted hit or
//! visited block. One form of each query looks for them at run time ([`Guards`]); except for SSE2 and for lazy trees, a
//! second form is compiled without them.

use super::batch::{AnyHits, Batch, BatchQuery, ClosestHits};
use super::closest_point::{
    ClosestPoint, ClosestPointSource, closest_point_in_kd, closest_point_in_wide, plain_closest_point_in_wide,
};
use super::interleave::Interleaved;
use super::intersect::RaySource;
use super::lazy::LazyQuery;
use super::lazy_closest_point::closest_point_in_lazy;
use super::outline::Outline;
use super::point_query::PlacedQuery;
use super::query::{AllQuery, AnyQuery, ClosestQuery, OfWide, Query, QueryArgs, Visitor};
use super::stream::Streams;
use super::{Everything, Hit, Observer, Ray, Visible};
use crate::error::BuildError;
use crate::geometry::{Frame, LinearBounds};
use crate::layout::{ChildRef, LazyTree, Statistics, WideSource, WideTree};
use crate::mbkd::{KdTree, build_kd};
use crate::params::{BuildParams, Policy};
use crate::primitive::Scene;
use crate::progress::Progress;
use crate::simd::{SimdLevel, dispatch, dispatch_or};
use core::ops::ControlFlow;

/// Not inlined into the wide layout's traversal, which has fewer registers to save without it.
#[inline(never)]
fn answer_in_kd<Q: Query>(query: Q, tree: &KdTree) -> Q::Answer {
    query.answer(tree)
}

/// The arrays that queries traverse.
pub(crate) enum Layout {
    Wide(WideTree),
    Kd(KdTree),
    Lazy(LazyTree),
}

impl Layout {
    /// The outline of a tree with this layout.
    pub fn outline(&self, frame: &Frame) -> Outline {
        let bounds = match self {
            Layout::Wide(tree) => tree.linear_bounds(&Frame::WORLD),
            Layout::Lazy(tree) => tree.top.linear_bounds(&Frame::WORLD),
            Layout::Kd(_) => None,
        };
        let swept = || LinearBounds::fixed(Frame::WORLD.box_to_world(frame.outward(frame.bounds)));
        Outline::new(&bounds.unwrap_or_else(swept), frame)
    }
}

/// The tree that a query is answered from.
pub(crate) struct Target<'a, G> {
    pub layout: &'a Layout,
    pub geometry: &'a G,
    pub outline: &'a Outline,
    pub simd: SimdLevel,
}

/// A geometry that a tree can be made of, with its compiled queries and build.
pub(crate) trait Compiled: RaySource + ClosestPointSource + Sized {
    /// The compiled queries.
    const QUERIES: Queries<Self>;
    /// Builds the layout that the parameters choose.
    fn lay_out(&mut self, params: &BuildParams, progress: &Progress) -> Result<(Layout, Statistics), BuildError>;
}

impl Compiled for Scene {
    const QUERIES: Queries<Scene> = Queries::TABLE;

    fn lay_out(&mut self, params: &BuildParams, progress: &Progress) -> Result<(Layout, Statistics), BuildError> {
        lay_out(self, params, progress)
    }
}

/// Builds the layout that the parameters choose over a set of primitives.
pub(super) fn lay_out<G: WideSource>(
    geometry: &mut G,
    params: &BuildParams,
    progress: &Progress,
) -> Result<(Layout, Statistics), BuildError> {
    match &params.policy {
        Policy::Wide(params) => {
            let tree = WideTree::build(geometry, params, progress)?;
            geometry.release_build_data();
            let statistics = tree.statistics(geometry);
            Ok((Layout::Wide(tree), statistics))
        }
        Policy::Kd(params) => {
            let (tree, times) = build_kd(geometry, params, progress)?;
            let statistics = tree.statistics(geometry).with_times(times);
            Ok((Layout::Kd(tree), statistics))
        }
        Policy::Lazy(params) => {
            let tree = LazyTree::build(geometry, params, progress)?;
            let statistics = tree.statistics(geometry);
            Ok((Layout::Lazy(tree), statistics))
        }
    }
}

/// A mask and the caller's filter predicate.
type Seen<'a, T> = Visible<&'a dyn Fn(&T) -> bool>;

/// The optional parts of a query: a mask with the caller's filter predicate, and an observer.
///
/// They are tested at run time, so that one compiled form serves every combination.
pub(crate) struct Guards<'a, T> {
    visible: Option<Seen<'a, T>>,
    observer: Option<&'a mut dyn Observer>,
}

impl<'a, T> Guards<'a, T> {
    pub const NONE: Guards<'a, T> = Guards { visible: None, observer: None };

    pub fn filtered(mask: u32, accept: &'a dyn Fn(&T) -> bool) -> Guards<'a, T> {
        Guards { visible: Some(Visible { mask, accept }), observer: None }
    }

    pub fn observed(observer: &'a mut dyn Observer) -> Guards<'a, T> {
        Guards { visible: None, observer: Some(observer) }
    }
}

/// A query `Q` with answers of type `R`.
pub(crate) type Plain<G, Q, R> = fn(Target<'_, G>, &Q) -> R;

/// A query with guards, whose filter predicate takes a `T`.
type Guarded<G, Q, T, R> = fn(Target<'_, G>, &Q, Guards<'_, T>) -> R;

/// A query of many rays with one `R` each.
pub(crate) type Batched<G, R> = fn(Target<'_, G>, &[Ray], &mut [R]);

/// All queries of a geometry.
pub(crate) struct Queries<G> {
    pub closest: Plain<G, Ray, Option<Hit>>,
    pub closest_guarded: Guarded<G, Ray, Hit, Option<Hit>>,
    pub any: Plain<G, Ray, bool>,
    pub closest_point: Plain<G, PlacedQuery, Option<ClosestPoint>>,
    pub closest_point_guarded: Guarded<G, PlacedQuery, ClosestPoint, Option<ClosestPoint>>,
    /// All hits; with a visitor that breaks at the first hit, any hit with guards.
    pub all: fn(Target<'_, G>, &Ray, Guards<'_, Hit>, Visitor<'_>) -> ControlFlow<()>,
    /// Interleaved traversal of many rays through the wide layout.
    pub interleaved_closest: Batched<G, Option<Hit>>,
    /// Streams of rays through the wide layout.
    pub streams_closest: Batched<G, Option<Hit>>,
    pub streams_any: Batched<G, bool>,
}

impl<G: RaySource + ClosestPointSource> Queries<G> {
    /// The addresses of all queries; naming this constant compiles them.
    pub(super) const TABLE: Queries<G> = Queries {
        closest: Queries::plain_closest,
        closest_guarded: Queries::guarded_closest,
        any: Queries::plain_any,
        closest_point: Queries::plain_closest_point,
        closest_point_guarded: Queries::guarded_closest_point,
        all: Queries::guarded_all,
        interleaved_closest: |on, rays, hits| on.interleaved::<ClosestHits>(rays, hits, Queries::plain_closest),
        streams_closest: |on, rays, hits| on.streams::<ClosestHits>(rays, hits, Queries::plain_closest),
        streams_any: |on, rays, hits| on.streams::<AnyHits>(rays, hits, Queries::plain_any),
    };

    // The plain queries are functions of their own: the address of a closure is that of a shim which calls it. They are
    // compiled for the layouts and instruction sets where speed matters and the plain form is faster than the guarded
    // one.

    /// The closest hit.
    fn plain_closest(on: Target<'_, G>, ray: &Ray) -> Option<Hit> {
        let observer = &mut ();
        on.answer_plain(
            || ClosestQuery(QueryArgs { set: on.geometry, ray, filter: &Everything, observer }),
            || Queries::guarded_closest(on, ray, Guards::NONE),
        )
    }

    /// Whether there is a hit.
    fn plain_any(on: Target<'_, G>, ray: &Ray) -> bool {
        let observer = &mut ();
        on.answer_plain(
            || AnyQuery(QueryArgs { set: on.geometry, ray, filter: &Everything, observer }),
            || Queries::guarded_all(on, ray, Guards::NONE, &mut |_| ControlFlow::Break(())).is_break(),
        )
    }

    /// The closest point.
    fn plain_closest_point(on: Target<'_, G>, query: &PlacedQuery) -> Option<ClosestPoint> {
        let guarded = || Queries::guarded_closest_point(on, query, Guards::NONE);
        match on.layout {
            Layout::Wide(tree) => plain_closest_point_in_wide(on.simd, tree, on.geometry, query, guarded),
            Layout::Kd(_) | Layout::Lazy(_) => guarded(),
        }
    }

    fn guarded_closest(on: Target<'_, G>, ray: &Ray, guards: Guards<'_, Hit>) -> Option<Hit> {
        let Guards { visible, mut observer } = guards;
        on.answer(ClosestQuery(QueryArgs { set: on.geometry, ray, filter: &visible, observer: &mut observer }))
    }

    fn guarded_all(on: Target<'_, G>, ray: &Ray, guards: Guards<'_, Hit>, visitor: Visitor<'_>) -> ControlFlow<()> {
        let Guards { visible, mut observer } = guards;
        on.answer(AllQuery {
            args: QueryArgs { set: on.geometry, ray, filter: &visible, observer: &mut observer },
            visitor,
        })
    }

    fn guarded_closest_point(
        on: Target<'_, G>,
        query: &PlacedQuery,
        guards: Guards<'_, ClosestPoint>,
    ) -> Option<ClosestPoint> {
        let Guards { visible, mut observer } = guards;
        let (filter, observer) = (&visible, &mut observer);
        match on.layout {
            Layout::Wide(tree) => closest_point_in_wide(on.simd, tree, on.geometry, query, filter, observer),
            Layout::Kd(tree) => closest_point_in_kd(tree, on.geometry, query, filter, observer),
            Layout::Lazy(tree) => closest_point_in_lazy(on.simd, tree, on.geometry, query, filter, observer),
        }
    }
}

impl<G> Clone for Target<'_, G> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<G> Copy for Target<'_, G> {}

impl<'a, G: RaySource> Target<'a, G> {
    /// Answers a query from whichever layout the tree has.
    fn answer<Q: LazyQuery>(self, query: Q) -> Q::Answer {
        match self.layout {
            Layout::Wide(tree) => dispatch(self.simd, OfWide { tree, outline: self.outline, query }),
            Layout::Kd(tree) => answer_in_kd(query, tree),
            Layout::Lazy(tree) => query.answer_lazily(tree, self.simd),
        }
    }

    /// Answers a query without guards, where that form is compiled. The query is constructed at its place of use: moved
    /// there, it would be copied by wide loads that stall on the narrow stores before them.
    #[inline(always)]
    fn answer_plain<Q: Query>(self, query: impl FnOnce() -> Q, guarded: impl FnOnce() -> Q::Answer) -> Q::Answer {
        match self.layout {
            Layout::Wide(tree) => {
                dispatch_or(self.simd, OfWide { tree, outline: self.outline, query: query() }, |_| guarded())
            }
            Layout::Kd(tree) => answer_in_kd(query(), tree),
            Layout::Lazy(_) => guarded(),
        }
    }

    /// Answers a batch by interleaved traversal.
    #[inline(always)]
    fn interleaved<Q: BatchQuery>(self, rays: &[Ray], answers: &mut [Q::Answer], one: Plain<G, Ray, Q::Answer>) {
        if let Some(batch) = self.batch::<Q>(rays, answers) {
            dispatch_or(self.simd, Interleaved(batch), |it| self.singly(it.0.rays, it.0.answers, one));
        }
    }

    /// Answers a batch in streams.
    #[inline(always)]
    fn streams<Q: BatchQuery>(self, rays: &[Ray], answers: &mut [Q::Answer], one: Plain<G, Ray, Q::Answer>) {
        if let Some(batch) = self.batch::<Q>(rays, answers) {
            dispatch_or(self.simd, Streams(batch), |it| self.singly(it.0.rays, it.0.answers, one));
        }
    }

    /// A batch for a wide layout that is not empty; with other layouts the rays are answered one by one.
    #[inline(always)]
    fn batch<Q: BatchQuery>(self, rays: &'a [Ray], answers: &'a mut [Q::Answer]) -> Option<Batch<'a, G, Q>> {
        match self.layout {
            Layout::Wide(tree) if tree.root != ChildRef::NOTHING => {
                Some(Batch { tree, outline: self.outline, set: self.geometry, rays, answers })
            }
            _ => None,
        }
    }

    /// One ray after the other.
    pub fn singly<R>(self, rays: &[Ray], answers: &mut [R], one: Plain<G, Ray, R>) {
        for (ray, answer) in rays.iter().zip(answers) {
            *answer = one(self, ray);
        }
    }
}
