//! The kinds of batched ray queries, and the state of each ray while a batch traverses the wide layout.
//!
//! Two kernels traverse batches: streams ([`super::stream`]) and interleaved single rays ([`super::interleave`]).

use super::collect::{Any, Closest, Collect, Found};
use super::filter::Everything;
use super::hit::Hit;
use super::intersect::RaySource;
use super::outline::Outline;
use super::shear::Sheared;
use super::traverser::Traverser;
use super::tree_ray::TreeRay;
use super::wide_traversal::RayQuery;
use crate::geometry::Ray;
use crate::layout::WideTree;

/// The query that a batch answers for each of its rays.
pub(crate) trait BatchQuery: Copy {
    /// The answer of one ray.
    type Answer: Copy + Send + PartialEq;
    /// The answer of a ray that hits nothing.
    const NOTHING: Self::Answer;
    /// Collects the hits of one ray.
    type Collect: Collect + Copy;
    /// Whether blocks are visited front to back.
    const ORDERED: bool = Self::Collect::ORDERED;
    /// A collector for a ray's hits.
    fn collect(ray: &TreeRay) -> Self::Collect;
    /// Whether no hit can change the answer any more.
    fn is_final(collect: &Self::Collect) -> bool;
    /// The answer, once the traversal has finished.
    fn answer(collect: &Self::Collect, set: &impl RaySource) -> Self::Answer;
}

type Accept = fn(&Found) -> bool;

fn accept(_: &Found) -> bool {
    true
}

/// The closest hit of each ray.
#[derive(Clone, Copy)]
pub(crate) struct ClosestHits;

impl BatchQuery for ClosestHits {
    type Answer = Option<Hit>;
    const NOTHING: Option<Hit> = None;
    type Collect = Closest<Accept>;

    #[inline(always)]
    fn collect(ray: &TreeRay) -> Closest<Accept> {
        Closest::new(ray, accept)
    }

    #[inline(always)]
    fn is_final(_: &Closest<Accept>) -> bool {
        false
    }

    #[inline(always)]
    fn answer(collect: &Closest<Accept>, set: &impl RaySource) -> Option<Hit> {
        collect.best.map(|found| found.answer(set))
    }
}

/// Whether each ray hits anything (occlusion).
#[derive(Clone, Copy)]
pub(crate) struct AnyHits;

impl BatchQuery for AnyHits {
    type Answer = bool;
    const NOTHING: bool = false;
    type Collect = Any<Accept>;

    #[inline(always)]
    fn collect(ray: &TreeRay) -> Any<Accept> {
        Any::new(ray, true, accept)
    }

    #[inline(always)]
    fn is_final(collect: &Any<Accept>) -> bool {
        collect.found
    }

    #[inline(always)]
    fn answer(collect: &Any<Accept>, _: &impl RaySource) -> bool {
        collect.found
    }
}

/// Rays for a tree that is not empty, and one answer per ray, initially [`BatchQuery::NOTHING`].
pub(super) struct Batch<'a, G, Q: BatchQuery> {
    pub tree: &'a WideTree,
    pub outline: &'a Outline,
    pub set: &'a G,
    pub rays: &'a [Ray],
    pub answers: &'a mut [Q::Answer],
}

impl<'a, G, Q: BatchQuery> Batch<'a, G, Q> {
    /// The state that all rays of the batch share.
    #[inline(always)]
    pub fn traverser(&self) -> Traverser<'a, G, Everything> {
        Traverser { arena: &self.tree.arena, lists: self.tree.lists, set: self.set, filter: &Everything }
    }
}

/// A ray of a batch during its traversal.
#[derive(Clone, Copy)]
pub(super) struct Member<'a, Q: BatchQuery> {
    /// Its index in the batch.
    pub index: usize,
    pub ray: TreeRay<'a>,
    sheared: Option<Sheared>,
    pub collect: Q::Collect,
}

impl<'a, Q: BatchQuery> Member<'a, Q> {
    #[inline(always)]
    pub fn new(index: usize, ray: TreeRay<'a>) -> Member<'a, Q> {
        let collect = Q::collect(&ray);
        Member { index, ray, sheared: None, collect }
    }

    /// The query of this ray for the traversal loop, with an observer.
    #[inline(always)]
    pub fn query<'b, G>(
        &'b mut self,
        traverser: &'b Traverser<'b, G, Everything>,
        observer: &'b mut (),
    ) -> RayQuery<'b, G, Everything, Q::Collect, ()> {
        let Member { ray, sheared, collect, .. } = self;
        RayQuery { traverser, ray, sheared, collect, observer }
    }
}
