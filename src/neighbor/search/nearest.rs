//! The nearest point.
//!
//! In the first bottom node the nearest leaf goes first. Its bound leaves few others, here and in the nodes that
//! the walk comes to after it; they are put on a list and scanned into sixteen running minima without a branch.

use super::waiting::Waiting;
use super::walk::{Collect, keys, unpack};
use super::{Keep, Observe, kept};
use crate::neighbor::view::{Target, View};
use crate::simd::Simd;

/// The best so far, lane by lane.
pub(in crate::neighbor) struct Best<'a, S: Simd, K, O> {
    distance: S::F,
    id: S::U,
    bound: f32,
    /// The bound at the begin; below it something has been found.
    start: f32,
    cull: f32,
    shrink: f32,
    keep: &'a K,
    observe: &'a mut O,
    waiting: Waiting,
}

impl<'a, S: Simd, K: Keep, O: Observe> Best<'a, S, K, O> {
    /// Nothing found yet; what lies at `bound` itself still counts.
    #[inline(always)]
    pub(in crate::neighbor) fn within(s: S, bound: f32, shrink: f32, keep: &'a K, observe: &'a mut O) -> Self {
        let id = s.splat_u(u32::MAX);
        Best {
            distance: s.splat(bound),
            id,
            bound,
            start: bound,
            cull: bound * shrink,
            shrink,
            keep,
            observe,
            waiting: Waiting::new(),
        }
    }

    /// Id and squared distance of the nearest, lowest id first.
    #[inline(always)]
    pub(in crate::neighbor) fn finish(self, s: S) -> Option<(u32, f32)> {
        let nearest = s.eq(self.distance, s.splat(self.bound));
        let id = s.reduce_min_u(s.select_u(nearest, self.id, s.splat_u(u32::MAX)));
        (id != u32::MAX).then_some((id, self.bound))
    }

    #[inline(always)]
    fn leaf<V: View>(&mut self, s: S, view: &V, target: &Target<S>, leaf: usize) {
        for block in leaf..leaf + view.leaf_blocks() {
            self.observe.block();
            let distance = view.point_distances(s, target, block);
            let ids = view.ids(block);
            let id = s.load_u(ids);
            let nearer = s.lt(distance, self.distance);
            let tied = s.eq(distance, self.distance) & s.lt_u(id, self.id);
            let take = kept(self.keep, ids, nearer | tied);
            self.distance = s.select(take, distance, self.distance);
            self.id = s.select_u(take, id, self.id);
        }
    }

    /// Looks at the leaves on the list.
    #[inline(always)]
    fn look<V: View>(&mut self, s: S, view: &V, target: &Target<S>) {
        let mut waiting = core::mem::replace(&mut self.waiting, Waiting::new());
        for &leaf in waiting.take() {
            self.leaf(s, view, target, leaf as usize);
        }
        self.tighten(s);
    }

    #[inline(always)]
    fn tighten(&mut self, s: S) {
        self.bound = f32::from_bits(s.reduce_min_u(s.to_bits(self.distance)));
        self.cull = self.bound * self.shrink;
    }
}

impl<S: Simd, K: Keep, O: Observe> Collect<S> for Best<'_, S, K, O> {
    #[inline(always)]
    fn cull(&self) -> f32 {
        self.cull
    }

    #[inline(always)]
    fn node(&mut self) {
        self.observe.node();
    }

    #[inline(always)]
    fn bottom<V: View>(&mut self, s: S, view: &V, target: &Target<S>, node: usize, boxes: S::F) {
        let first = view.first_block(node);
        if self.bound < self.start {
            self.waiting.add(s, view, first, s.le(boxes, s.splat(self.cull)));
            if self.waiting.many() {
                self.look(s, view, target);
            }
            return;
        }
        let left = keys(s, boxes);
        let (lane, distance) = unpack(s.reduce_min_u(left));
        // An absent lane's key may unpack to NaN, which is not within any bound.
        let within = distance <= self.cull;
        if !within {
            return;
        }
        let (second, near) = unpack(s.reduce_min_u(s.select_u(1 << lane, s.splat_u(u32::MAX), left)));
        if near <= self.cull {
            view.expect_leaf(first + second * view.leaf_blocks());
        }
        self.leaf(s, view, target, first + lane * view.leaf_blocks());
        self.tighten(s);
        self.waiting.add(s, view, first, s.le(boxes, s.splat(self.cull)) & !(1 << lane));
        if self.waiting.many() {
            self.look(s, view, target);
        }
    }

    #[inline(always)]
    fn end<V: View>(&mut self, s: S, view: &V, target: &Target<S>) {
        if !self.waiting.is_empty() {
            self.look(s, view, target);
        }
    }
}
