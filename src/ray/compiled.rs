//! The queries of a tree as function pointers, compiled once, in the crate that builds the tree.
//!
//! A query is generic over the geometry, the filter and the observer, and is compiled for each instruction set and
//! layout. If callers instantiated it, every crate with a query would compile all of that again. So a tree carries the
//! addresses of its queries, which this crate compiled for triangles and for primitives of any type ([`super::erased_shapes`]);
//! builds are compiled likewise. Filters, observers and visitors are called through `dyn`, once per accepted hit or
//! visited block. One form of each query looks for them at run time ([`Guards`]); except for SSE2, in lazy trees, and for closest
//! points in k-d trees, a second form is compiled without them.

use super::closest_point::closest_search::{
    ClosestPoint, ClosestPointSource, closest_point_in_kd, closest_point_in_wide, plain_closest_point_in_wide,
};
use super::closest_point::lazy_search::closest_point_in_lazy;
use super::closest_point::point_query::PlacedQuery;
use super::filter::{Filter, Offer};
use super::guards::Guards;
use super::kernel::outline::Outline;
use super::traversal::batch::{Batch, BatchQuery, By, Task, Way};
use super::traversal::collect::HitVisitor;
use super::traversal::interleave::Interleaved;
use super::traversal::intersect::RaySource;
use super::traversal::lazy::answer_lazily;
use super::traversal::query::{
    AllHits, AnyHit, ClosestHit, QueryArgs, QueryCall, RayQuery, WideTreeQuery, WideTreeQueryInto,
};
use super::traversal::stream::Streams;
use super::{Everything, Hit, Observer, Ray, Visible};
use crate::error::BuildError;
use crate::file::{Encoder, FileError, FileKind};
use crate::geometry::{Frame, LinearBounds};
use crate::kd::{KdTree, build_kd};
use crate::layout::{ChildRef, LazyTree, Statistics, WideSource, WideTree};
use crate::params::{BuildParams, Policy};
use crate::primitive::Scene;
use crate::progress::Progress;
use crate::simd::{SimdLevel, dispatch, dispatch_or};
use core::ops::ControlFlow;

/// Not inlined into the wide layout's traversal, which has fewer registers to save without it.
#[inline(never)]
fn answer_in_kd<G: RaySource, F: Filter, O: Observer, Q: RayQuery>(
    call: QueryCall<'_, G, F, O, Q>,
    tree: &KdTree,
) -> Q::Answer {
    call.answer(tree)
}

/// The arrays that queries traverse.
#[derive(Clone)]
pub(crate) enum Layout {
    Wide(WideTree),
    Kd(KdTree),
    Lazy(LazyTree),
}

impl Layout {
    /// The wide tree at the top: all of a wide tree, or what is above the subtrees of a lazy one.
    pub fn top(&self) -> Option<&WideTree> {
        match self {
            Layout::Wide(tree) => Some(tree),
            Layout::Lazy(tree) => Some(&tree.top),
            Layout::Kd(_) => None,
        }
    }

    /// The outline of a tree with this layout.
    pub fn outline(&self, frame: &Frame) -> Outline {
        let bounds = self.top().and_then(|tree| tree.linear_bounds(&Frame::WORLD));
        let swept = || LinearBounds::fixed(Frame::WORLD.box_to_world(frame.outward(frame.bounds)));
        Outline::new(&bounds.unwrap_or_else(swept), frame)
    }

    /// Whether a query with this mask is known to see everything, so that it may do without the mask.
    pub fn hides_nothing_from(&self, mask: u32) -> bool {
        match self {
            Layout::Wide(tree) => tree.masks.hide_nothing_from(mask),
            Layout::Kd(_) | Layout::Lazy(_) => false,
        }
    }

    /// Whether a ray may find a primitive in several leaves.
    fn repeats(&self) -> bool {
        !matches!(self, Layout::Wide(tree) if !tree.presplit)
    }
}

/// The tree that a query is answered from.
pub(crate) struct Target<'a, G> {
    pub layout: &'a Layout,
    pub geometry: &'a G,
    /// `None` if rays are known not to miss it.
    pub outline: Option<&'a Outline>,
    pub simd: SimdLevel,
}

/// A geometry that a tree can be made of, with its compiled queries and build.
pub(crate) trait Compiled: RaySource + ClosestPointSource + Sized {
    /// The compiled queries.
    const QUERIES: Queries<Self>;
    /// Builds the layout that the parameters choose.
    fn lay_out(&mut self, params: &BuildParams, progress: &Progress) -> Result<(Layout, Statistics), BuildError>;
    /// The kind of a file with such a tree.
    const FILE: FileKind;
    /// Writes the geometry to a file.
    fn write(&self, to: &mut Encoder<'_>) -> Result<(), FileError>;
}

impl Compiled for Scene {
    const QUERIES: Queries<Scene> = Queries::TABLE;

    fn lay_out(&mut self, params: &BuildParams, progress: &Progress) -> Result<(Layout, Statistics), BuildError> {
        lay_out(self, params, progress)
    }

    const FILE: FileKind = FileKind::Scene;

    fn write(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        self.encode(to)
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

/// A query `Q` with answers of type `R`.
pub(crate) type Plain<G, Q, R> = fn(Target<'_, G>, &Q) -> R;

/// A query with guards, whose filter predicate takes a `T`.
type Guarded<G, Q, T, R> = fn(Target<'_, G>, &Q, Guards<'_, T>) -> R;

/// All hits of a ray.
type OfAll<G> = fn(Target<'_, G>, &Ray, HitVisitor<'_>) -> ControlFlow<()>;

/// The same with guards.
type GuardedAll<G> = fn(Target<'_, G>, &Ray, Guards<'_, Offer>, HitVisitor<'_>) -> ControlFlow<()>;

/// A query of many rays with one `R` each.
pub(crate) type Batched<G, R> = fn(Target<'_, G>, Task<'_, R>);

/// All queries of a geometry.
#[derive(Clone)]
pub(crate) struct Queries<G> {
    pub closest: Plain<G, Ray, Option<Hit>>,
    pub closest_guarded: Guarded<G, Ray, Offer, Option<Hit>>,
    pub any: Plain<G, Ray, bool>,
    pub any_guarded: Guarded<G, Ray, Offer, bool>,
    pub closest_point: Plain<G, PlacedQuery, Option<ClosestPoint>>,
    pub closest_point_guarded: Guarded<G, PlacedQuery, ClosestPoint, Option<ClosestPoint>>,
    pub all: OfAll<G>,
    pub all_guarded: GuardedAll<G>,
    /// Rays one by one.
    pub singly_closest: Batched<G, Option<Hit>>,
    /// Interleaved traversal through the wide layout.
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
        any_guarded: Queries::guarded_any,
        closest_point: Queries::plain_closest_point,
        closest_point_guarded: Queries::guarded_closest_point,
        all: Queries::plain_all,
        all_guarded: Queries::guarded_all,
        singly_closest: Queries::each_closest,
        // For custom primitives, rays one by one take as long.
        interleaved_closest: if G::TRIANGLES { Queries::interleaved_closest } else { Queries::each_closest },
        streams_closest: Queries::streams_closest,
        streams_any: Queries::streams_any,
    };

    // The plain queries are functions of their own: the address of a closure is that of a shim which calls it. They are
    // compiled for the layouts and instruction sets where speed matters and the plain form is faster than the guarded
    // one.

    /// The closest hit.
    fn plain_closest(on: Target<'_, G>, ray: &Ray) -> Option<Hit> {
        let observer = &mut ();
        on.answer_plain(
            || QueryCall(ClosestHit, QueryArgs { set: on.geometry, ray, filter: &Everything, observer }),
            |_| Queries::guarded_closest(on, ray, Guards::none()),
        )
    }

    /// Whether there is a hit.
    fn plain_any(on: Target<'_, G>, ray: &Ray) -> bool {
        let observer = &mut ();
        on.answer_plain(
            || QueryCall(AnyHit, QueryArgs { set: on.geometry, ray, filter: &Everything, observer }),
            |_| Queries::guarded_any(on, ray, Guards::none()),
        )
    }

    /// All hits.
    fn plain_all(on: Target<'_, G>, ray: &Ray, visitor: HitVisitor<'_>) -> ControlFlow<()> {
        let observer = &mut ();
        on.answer_plain(
            || {
                let query = AllHits { visitor: Some(visitor), repeats: on.layout.repeats() };
                QueryCall(query, QueryArgs { set: on.geometry, ray, filter: &Everything, observer })
            },
            |query| on.answer(query, ray, Guards::none()),
        )
    }

    /// The closest point.
    fn plain_closest_point(on: Target<'_, G>, query: &PlacedQuery) -> Option<ClosestPoint> {
        let guarded = || Queries::guarded_closest_point(on, query, Guards::none());
        match on.layout {
            Layout::Wide(tree) => plain_closest_point_in_wide(on.simd, tree, on.geometry, query, guarded),
            Layout::Kd(_) | Layout::Lazy(_) => guarded(),
        }
    }

    fn guarded_closest(on: Target<'_, G>, ray: &Ray, guards: Guards<'_, Offer>) -> Option<Hit> {
        on.answer(ClosestHit, ray, guards)
    }

    fn guarded_any(on: Target<'_, G>, ray: &Ray, guards: Guards<'_, Offer>) -> bool {
        on.answer(AllHits { visitor: None, repeats: false }, ray, guards).is_break()
    }

    fn guarded_all(
        on: Target<'_, G>,
        ray: &Ray,
        guards: Guards<'_, Offer>,
        visitor: HitVisitor<'_>,
    ) -> ControlFlow<()> {
        on.answer(AllHits { visitor: Some(visitor), repeats: on.layout.repeats() }, ray, guards)
    }

    fn each_closest(on: Target<'_, G>, task: Task<'_, Option<Hit>>) {
        on.singly(task, Queries::plain_closest, Queries::guarded_closest);
    }

    fn each_any(on: Target<'_, G>, task: Task<'_, bool>) {
        on.singly(task, Queries::plain_any, Queries::guarded_any);
    }

    fn interleaved_closest(on: Target<'_, G>, task: Task<'_, Option<Hit>>) {
        on.batch(Interleaved, ClosestHit, task, Queries::each_closest);
    }

    fn streams_closest(on: Target<'_, G>, task: Task<'_, Option<Hit>>) {
        on.batch(Streams, ClosestHit, task, Queries::each_closest);
    }

    fn streams_any(on: Target<'_, G>, task: Task<'_, bool>) {
        on.batch(Streams, AnyHit, task, Queries::each_any);
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

/// Whether some rays may have to be traversed in pieces.
fn any_in_pieces(tree: &WideTree, frame: &Frame, rays: &[Ray]) -> bool {
    let is_far = |ray: &Ray| frame.point(ray.origin).abs().max_element() > tree.near;
    tree.near < f32::INFINITY && rays.iter().any(is_far)
}

impl<G> Clone for Target<'_, G> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<G> Copy for Target<'_, G> {}

impl<G: RaySource> Target<'_, G> {
    /// Answers a query from whichever layout the tree has.
    fn answer<Q: RayQuery>(self, query: Q, ray: &Ray, guards: Guards<'_, Offer>) -> Q::Answer {
        let Guards { visible, mut observer } = guards;
        let args = QueryArgs { set: self.geometry, ray, filter: &visible, observer: &mut observer };
        match self.layout {
            Layout::Wide(tree) => {
                let (query, mut collect) = (Some(query), None);
                dispatch(
                    self.simd,
                    WideTreeQueryInto { tree, outline: self.outline, query, args, collect: &mut collect },
                );
                collect.map_or(Q::NOTHING, |collect| Q::answer(collect, self.geometry))
            }
            Layout::Kd(tree) => answer_in_kd(QueryCall(query, args), tree),
            Layout::Lazy(tree) => answer_lazily(QueryCall(query, args), tree, self.simd),
        }
    }

    /// Answers a query without guards, where that form is compiled. The query is constructed at its place of use: moved
    /// there, it would be copied by wide loads that stall on the narrow stores before them.
    #[inline(always)]
    fn answer_plain<'b, Q: RayQuery>(
        self,
        call: impl FnOnce() -> QueryCall<'b, G, Everything, (), Q>,
        guarded: impl FnOnce(Q) -> Q::Answer,
    ) -> Q::Answer
    where
        G: 'b,
    {
        match self.layout {
            Layout::Wide(tree) => {
                dispatch_or(self.simd, WideTreeQuery { tree, outline: self.outline, call: call() }, |it| {
                    guarded(it.call.0)
                })
            }
            Layout::Kd(tree) => answer_in_kd(call(), tree),
            Layout::Lazy(_) => guarded(call().0),
        }
    }

    /// Answers a task in a wide layout, if this is compiled, and otherwise `singly`.
    #[inline(always)]
    fn batch<Q: BatchQuery>(self, way: impl Way, query: Q, task: Task<'_, Q::Answer>, singly: Batched<G, Q::Answer>) {
        let Target { layout, geometry: set, simd, .. } = self;
        let outline = self.outline.unwrap_or(&Outline::EVERYTHING);
        let tree = match layout {
            Layout::Wide(tree) if tree.root != ChildRef::NOTHING && !any_in_pieces(tree, set.frame(), task.rays) => {
                tree
            }
            _ => return singly(self, task),
        };
        match task.visible {
            None => {
                let batch = Batch { tree, outline, set, filter: &Everything, query, task };
                dispatch_or(simd, By(way, batch), |By(_, it)| singly(self, it.task));
            }
            Some(filter) => {
                let batch = Batch { tree, outline, set, filter: &filter, query, task };
                dispatch_or(simd, By(way, batch), |By(_, it)| singly(self, it.task));
            }
        }
    }

    /// Answers a task, one ray after the other.
    fn singly<R>(self, task: Task<'_, R>, plain: Plain<G, Ray, R>, guarded: Guarded<G, Ray, Offer, R>) {
        for (i, (ray, answer)) in task.rays.iter().zip(task.answers).enumerate() {
            *answer = match task.visible {
                None => plain(self, ray),
                Some(Visible { mask, accept: None }) => guarded(self, ray, Guards::masked(mask)),
                Some(Visible { mask, accept: Some(accept) }) => {
                    guarded(self, ray, Guards::filtered(mask, &|&(_, hit)| accept(&(i, hit))))
                }
            };
        }
    }
}
