//! The queries of a ray tree, each answered from whichever layout the tree has, on whichever instruction set.
//!
//! A query is generic over the filter and the observer, and is compiled for each instruction set and layout. If callers
//! instantiated it, every crate with a query would compile all of that again. So filters, observers and visitors are called through
//! `dyn`, once per accepted hit or visited block, and every query is compiled here, once. One form of each looks for them at run
//! time ([`Guards`]); except for SSE2, in lazy trees, and for closest points in k-d trees, a second form is compiled without them.

use super::closest_point::closest_search::{
    ClosestPoint, closest_point_in_kd, closest_point_in_wide, plain_closest_point_in_wide,
};
use super::closest_point::lazy_search::closest_point_in_lazy;
use super::closest_point::point_query::PlacedQuery;
use super::filter::{Filter, Offer};
use super::guards::Guards;
use super::kernel::outline::Outline;
use super::layout::Layout;
use super::traversal::batch::{Batch, BatchQuery, By, Task, Way};
use super::traversal::collect::HitVisitor;
use super::traversal::interleave::Interleaved;
use super::traversal::lazy::answer_lazily;
use super::traversal::query::{
    AllHits, AnyHit, ClosestHit, QueryArgs, QueryCall, RayQuery, WideTreeQuery, WideTreeQueryInto,
};
use super::traversal::stream::Streams;
use super::{Everything, Hit, Observer, Ray, Visible};
use crate::geometry::Frame;
use crate::kd::KdTree;
use crate::layout::{ChildRef, WideTree};
use crate::primitive::{PrimitiveSet, Scene};
use crate::simd::{SimdLevel, dispatch, dispatch_or};
use core::ops::ControlFlow;

/// The tree that a query is answered from.
#[derive(Clone, Copy)]
pub(super) struct Target<'a> {
    pub layout: &'a Layout,
    pub scene: &'a Scene,
    /// `None` if rays are known not to miss it.
    pub outline: Option<&'a Outline>,
    pub simd: SimdLevel,
}

/// A query of many rays with one `R` each.
pub(super) type Batched<'a, R> = fn(Target<'a>, Task<'_, R>);

// Queries without guards are compiled for the layouts and instruction sets where speed matters and this form is faster.
impl<'a> Target<'a> {
    /// The closest hit.
    pub fn closest(self, ray: &Ray) -> Option<Hit> {
        let observer = &mut ();
        self.answer_plain(
            || QueryCall(ClosestHit, QueryArgs { scene: self.scene, ray, filter: &Everything, observer }),
            |_| self.closest_guarded(ray, Guards::none()),
        )
    }

    pub fn closest_guarded(self, ray: &Ray, guards: Guards<'_, Offer>) -> Option<Hit> {
        self.answer(ClosestHit, ray, guards)
    }

    /// Whether there is a hit.
    pub fn any(self, ray: &Ray) -> bool {
        let observer = &mut ();
        self.answer_plain(
            || QueryCall(AnyHit, QueryArgs { scene: self.scene, ray, filter: &Everything, observer }),
            |_| self.any_guarded(ray, Guards::none()),
        )
    }

    pub fn any_guarded(self, ray: &Ray, guards: Guards<'_, Offer>) -> bool {
        self.answer(AllHits { visitor: None, repeats: false }, ray, guards).is_break()
    }

    /// All hits.
    pub fn all(self, ray: &Ray, visitor: HitVisitor<'_>) -> ControlFlow<()> {
        let observer = &mut ();
        self.answer_plain(
            || {
                let query = AllHits { visitor: Some(visitor), repeats: self.layout.repeats() };
                QueryCall(query, QueryArgs { scene: self.scene, ray, filter: &Everything, observer })
            },
            |query| self.answer(query, ray, Guards::none()),
        )
    }

    pub fn all_guarded(self, ray: &Ray, guards: Guards<'_, Offer>, visitor: HitVisitor<'_>) -> ControlFlow<()> {
        self.answer(AllHits { visitor: Some(visitor), repeats: self.layout.repeats() }, ray, guards)
    }

    /// The closest point.
    pub fn closest_point(self, query: &PlacedQuery) -> Option<ClosestPoint> {
        let guarded = || self.closest_point_guarded(query, Guards::none());
        match self.layout {
            Layout::Wide(tree) => plain_closest_point_in_wide(self.simd, tree, self.scene, query, guarded),
            Layout::Kd(_) | Layout::Lazy(_) => guarded(),
        }
    }

    pub fn closest_point_guarded(self, query: &PlacedQuery, guards: Guards<'_, ClosestPoint>) -> Option<ClosestPoint> {
        let Guards { visible, mut observer } = guards;
        let (filter, observer) = (&visible, &mut observer);
        match self.layout {
            Layout::Wide(tree) => closest_point_in_wide(self.simd, tree, self.scene, query, filter, observer),
            Layout::Kd(tree) => closest_point_in_kd(tree, self.scene, query, filter, observer),
            Layout::Lazy(tree) => closest_point_in_lazy(self.simd, tree, self.scene, query, filter, observer),
        }
    }

    /// The closest hits of rays, one by one.
    pub fn closest_singly(self, task: Task<'_, Option<Hit>>) {
        self.singly(task, Target::closest, Target::closest_guarded);
    }

    /// Whether rays hit anything, one by one.
    fn any_singly(self, task: Task<'_, bool>) {
        self.singly(task, Target::any, Target::any_guarded);
    }

    /// The same by interleaved traversal of the wide layout.
    pub fn closest_interleaved(self, task: Task<'_, Option<Hit>>) {
        self.batch(Interleaved, ClosestHit, task, Target::closest_singly);
    }

    /// The same in streams through the wide layout.
    pub fn closest_in_streams(self, task: Task<'_, Option<Hit>>) {
        self.batch(Streams, ClosestHit, task, Target::closest_singly);
    }

    /// Whether rays hit anything, likewise.
    pub fn any_in_streams(self, task: Task<'_, bool>) {
        self.batch(Streams, AnyHit, task, Target::any_singly);
    }

    /// Answers a query from whichever layout the tree has.
    fn answer<Q: RayQuery>(self, query: Q, ray: &Ray, guards: Guards<'_, Offer>) -> Q::Answer {
        let Guards { visible, mut observer } = guards;
        let args = QueryArgs { scene: self.scene, ray, filter: &visible, observer: &mut observer };
        match self.layout {
            Layout::Wide(tree) => {
                let (query, mut collect) = (Some(query), None);
                dispatch(
                    self.simd,
                    WideTreeQueryInto { tree, outline: self.outline, query, args, collect: &mut collect },
                );
                collect.map_or(Q::NOTHING, |collect| Q::answer(collect, self.scene))
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
        call: impl FnOnce() -> QueryCall<'b, Everything, (), Q>,
        guarded: impl FnOnce(Q) -> Q::Answer,
    ) -> Q::Answer {
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
    fn batch<Q: BatchQuery>(self, way: impl Way, query: Q, task: Task<'_, Q::Answer>, singly: Batched<'a, Q::Answer>) {
        let Target { layout, scene, simd, .. } = self;
        let outline = self.outline.unwrap_or(&Outline::EVERYTHING);
        let tree = match layout {
            Layout::Wide(tree) if tree.root != ChildRef::NOTHING && !any_in_pieces(tree, scene.frame(), task.rays) => {
                tree
            }
            _ => return singly(self, task),
        };
        match task.visible {
            None => {
                let batch = Batch { tree, outline, scene, filter: &Everything, query, task };
                dispatch_or(simd, By(way, batch), |By(_, it)| singly(self, it.task));
            }
            Some(filter) => {
                let batch = Batch { tree, outline, scene, filter: &filter, query, task };
                dispatch_or(simd, By(way, batch), |By(_, it)| singly(self, it.task));
            }
        }
    }

    /// Answers a task, one ray after the other.
    fn singly<R>(
        self,
        task: Task<'_, R>,
        plain: fn(Target<'a>, &Ray) -> R,
        guarded: fn(Target<'a>, &Ray, Guards<'_, Offer>) -> R,
    ) {
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

/// Not inlined into the wide layout's traversal, which has fewer registers to save without it.
#[inline(never)]
fn answer_in_kd<F: Filter, O: Observer, Q: RayQuery>(call: QueryCall<'_, F, O, Q>, tree: &KdTree) -> Q::Answer {
    call.answer(tree)
}

/// Whether some rays may have to be traversed in pieces.
fn any_in_pieces(tree: &WideTree, frame: &Frame, rays: &[Ray]) -> bool {
    let is_far = |ray: &Ray| frame.point(ray.origin).abs().max_element() > tree.near;
    tree.near < f32::INFINITY && rays.iter().any(is_far)
}
