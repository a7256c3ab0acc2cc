//! Batches of rays in the wide layout, and the state of each ray while a batch is traversed.
//!
//! There are two ways to traverse them: streams ([`super::stream`]) and interleaved single rays ([`super::interleave`]).

use super::collect::Collect;
use super::query::{AnyHit, ClosestHit, RayQuery};
use super::traverser::Traverser;
use super::wide_traversal::RayState;
use crate::geometry::Ray;
use crate::layout::WideTree;
use crate::primitive::Scene;
use crate::ray::filter::{Filter, Offer, Seen};
use crate::ray::kernel::outline::Outline;
use crate::ray::kernel::shear::Sheared;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::simd::{Kernel, Simd};

/// A query that can be asked about many rays at a time.
pub(crate) trait BatchQuery: RayQuery<Collect: Copy> + Copy {}

impl BatchQuery for ClosestHit {}
impl BatchQuery for AnyHit {}

/// Rays that are answered together, and one answer per ray, initially that of a ray that hits nothing.
pub(crate) struct Task<'a, R> {
    pub rays: &'a [Ray],
    pub answers: &'a mut [R],
    /// The mask and the filter of the batch.
    pub visible: Option<Seen<'a, Offer>>,
}

/// A way to traverse a wide layout with many rays.
pub(in crate::ray) trait Way {
    /// Answers a batch.
    fn run<S: Simd, F: Filter, Q: BatchQuery>(s: S, batch: Batch<'_, F, Q>);
}

/// A task for a tree that is not empty.
pub(in crate::ray) struct Batch<'a, F, Q: RayQuery> {
    pub tree: &'a WideTree,
    pub outline: &'a Outline,
    pub scene: &'a Scene,
    pub filter: &'a F,
    pub query: Q,
    pub task: Task<'a, Q::Answer>,
}

impl<'a, F: Filter, Q: RayQuery> Batch<'a, F, Q> {
    /// The state that all rays of the batch share.
    #[inline(always)]
    pub fn traverser(&self) -> Traverser<'a, F> {
        Traverser::new(self.tree, self.scene, self.filter)
    }
}

/// A batch with its way, to be dispatched to an instruction set.
pub(in crate::ray) struct By<'a, W, F, Q: RayQuery>(pub W, pub Batch<'a, F, Q>);

impl<W: Way, F: Filter, Q: BatchQuery> Kernel for By<'_, W, F, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        W::run(s, self.1);
    }
}

/// A ray of a batch during its traversal. Its fields stay in this order: with the collector before the shear, occlusion rays in
/// streams take 4 % longer.
#[derive(Clone, Copy)]
#[repr(C)]
pub(in crate::ray) struct Member<'a, C> {
    pub ray: TreeRay<'a>,
    sheared: Option<Sheared>,
    pub collect: C,
}

impl<'a, C: Collect> Member<'a, C> {
    /// The ray at this index of the batch.
    #[inline(always)]
    pub fn new(index: usize, mut ray: TreeRay<'a>, collect: C) -> Member<'a, C> {
        ray.index = index;
        Member { ray, sheared: None, collect }
    }

    /// The query of this ray for the traversal loop, with an observer.
    #[inline(always)]
    pub fn query<'b, F>(&'b mut self, traverser: &'b Traverser<'b, F>, observer: &'b mut ()) -> RayState<'b, F, C, ()> {
        let Member { ray, sheared, collect } = self;
        RayState { traverser, ray, sheared, collect, observer }
    }
}
