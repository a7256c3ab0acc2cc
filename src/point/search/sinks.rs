//! What is done with the points of a block that lie within a radius: gathered, or shown to a visitor.

use super::Keep;
use super::candidates::{Candidates, append};
use super::radius::Sink;
use crate::point::snapshot::Leaves;
use crate::simd::{LANES, Mask, Simd};
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

/// What is called with ids and squared distances of points within the radius, some at a time.
pub(in crate::point) type VisitFound<'a> = &'a mut dyn FnMut(&[u32], &[f32]) -> ControlFlow<()>;

/// Hands on what is found. It is gathered first: that takes no branch for each block, nor a call.
pub(in crate::point) struct Visit<'v> {
    visit: VisitFound<'v>,
    ids: [u32; ROOM],
    distances: [f32; ROOM],
    count: usize,
}

/// Room for what is gathered: little, since it is cleared for each query.
const ROOM: usize = 5 * LANES;

impl<'v> Visit<'v> {
    #[inline(always)]
    pub(in crate::point) fn new(visit: VisitFound<'v>) -> Visit<'v> {
        Visit { visit, ids: [0; ROOM], distances: [0.0; ROOM], count: 0 }
    }

    /// Hands on what is left.
    #[inline(always)]
    pub(in crate::point) fn finish(&mut self) -> ControlFlow<()> {
        let count = core::mem::take(&mut self.count);
        (self.visit)(&self.ids[..count], &self.distances[..count])
    }
}

impl<S: Simd> Sink<S> for Visit<'_> {
    const TAKES_NONE: bool = true;
    #[inline(always)]
    fn take<V: Leaves>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let found = (distance, s.load_u(view.ids(block)));
        self.count = append(s, &mut self.distances, &mut self.ids, self.count, found, hits);
        if self.count > ROOM - LANES { self.finish() } else { ControlFlow::Continue(()) }
    }
}
