//! What is done with the points of a block that lie within a radius: gathered, or shown to a visitor.

use super::Keep;
use super::candidates::Candidates;
use super::radius::Sink;
use crate::point::snapshot::Leaves;
use crate::simd::{LANES, Lanes, Mask, Simd};
use core::ops::ControlFlow;

/// Appends what is found to candidates.
pub(in crate::point) struct Gather<'a, K> {
    pub(in crate::point) candidates: &'a mut Candidates,
    pub(in crate::point) keep: &'a K,
}

impl<S: Simd, K: Keep> Sink<S> for Gather<'_, K> {
    const TAKES_NONE: bool = true;
    #[inline(always)]
    fn take<V: Leaves>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let ids = view.ids(block);
        self.candidates.reserve(0);
        self.candidates.push(s, distance, s.load_u(ids), self.keep.kept(ids, hits));
        ControlFlow::Continue(())
    }
}

/// What is called with the ids and squared distances of a block, and which lanes of it are within the radius.
pub(in crate::point) type VisitBlock<'a> = &'a mut dyn FnMut(&Lanes<u32>, &Lanes<f32>, Mask) -> ControlFlow<()>;

/// Hands blocks on.
pub(in crate::point) struct Visit<'v>(pub(in crate::point) VisitBlock<'v>);

impl<S: Simd> Sink<S> for Visit<'_> {
    const TAKES_NONE: bool = false;
    #[inline(always)]
    fn take<V: Leaves>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let mut distances = [0.0; LANES];
        s.store(distance, &mut distances);
        (self.0)(view.ids(block), &distances, hits)
    }
}
