//! Sinks of a radius search: points are collected, counted, or passed to a visitor.

use super::Keep;
use super::candidates::{Candidates, append};
use super::radius::Sink;
use crate::point::layout::view::LeafView;
use crate::simd::{LANES, Mask, Simd};
use core::ops::ControlFlow;

/// Appends the points found to candidates.
pub(in crate::point) struct Gather<'a, K> {
    pub(in crate::point) candidates: &'a mut Candidates,
    pub(in crate::point) keep: &'a K,
}

impl<S: Simd, K: Keep> Sink<S> for Gather<'_, K> {
    #[inline(always)]
    fn take<V: LeafView>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let ids = view.ids(block);
        self.candidates.reserve(0);
        self.candidates.push(s, distance, s.load_u(ids), self.keep.kept(ids, hits));
        ControlFlow::Continue(())
    }
}

/// A callback for the ids and squared distances of some points within the radius.
pub(in crate::point) type VisitSome<'a> = &'a mut dyn FnMut(&[u32], &[f32]) -> ControlFlow<()>;

/// Number of points that are buffered before they are passed on.
const BATCH: usize = 64;

/// Passes points on in batches: a call for each block would cost more than the block.
pub(in crate::point) struct Visit<'v> {
    visit: VisitSome<'v>,
    distances: [f32; BATCH + LANES],
    ids: [u32; BATCH + LANES],
    count: usize,
}

impl<'v> Visit<'v> {
    #[inline(always)]
    pub(in crate::point) fn new(visit: VisitSome<'v>) -> Visit<'v> {
        Visit { visit, distances: [0.0; BATCH + LANES], ids: [0; BATCH + LANES], count: 0 }
    }

    /// Passes on the rest.
    #[inline(always)]
    pub(in crate::point) fn finish(&mut self) -> ControlFlow<()> {
        let count = core::mem::take(&mut self.count);
        if count == 0 {
            return ControlFlow::Continue(());
        }
        (self.visit)(&self.ids[..count], &self.distances[..count])
    }
}

impl<S: Simd> Sink<S> for Visit<'_> {
    #[inline(always)]
    fn take<V: LeafView>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let id = s.load_u(view.ids(block));
        self.count = append(s, &mut self.distances, &mut self.ids, self.count, (distance, id), hits);
        if self.count >= BATCH { self.finish() } else { ControlFlow::Continue(()) }
    }
}

/// Counts points.
pub(in crate::point) struct Count<'a, K> {
    pub(in crate::point) count: usize,
    pub(in crate::point) keep: &'a K,
}

impl<S: Simd, K: Keep> Sink<S> for Count<'_, K> {
    #[inline(always)]
    fn take<V: LeafView>(&mut self, _: S, view: &V, block: usize, _: S::F, hits: Mask) -> ControlFlow<()> {
        self.count += self.keep.kept(view.ids(block), hits).count_ones() as usize;
        ControlFlow::Continue(())
    }
}
