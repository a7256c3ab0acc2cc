//! The nearest point.
//!
//! In a bottom node the nearest leaf goes first; after it one comparison with the new bound leaves
//! few others, and those are scanned into sixteen running minima without a branch.

use super::walk::{Collect, keys, unpack};
use super::{Keep, Observe, kept};
use crate::neighbor::view::{Target, View};
use crate::simd::Simd;

/// The best so far, lane by lane.
pub(in crate::neighbor) struct Best<'a, S: Simd, K, O> {
    distance: S::F,
    id: S::U,
    bound: f32,
    cull: f32,
    shrink: f32,
    keep: &'a K,
    observe: &'a mut O,
}

impl<'a, S: Simd, K: Keep, O: Observe> Best<'a, S, K, O> {
    /// Nothing found yet; what lies at `bound` itself still counts.
    #[inline(always)]
    pub(in crate::neighbor) fn within(s: S, bound: f32, shrink: f32, keep: &'a K, observe: &'a mut O) -> Self {
        let id = s.splat_u(u32::MAX);
        Best { distance: s.splat(bound), id, bound, cull: bound * shrink, shrink, keep, observe }
    }

    /// Id and squared distance of the nearest, lowest id first.
    #[inline(always)]
    pub(in crate::neighbor) fn finish(self, s: S) -> Option<(u32, f32)> {
        let least = s.reduce_min(self.distance);
        let ties = s.eq(self.distance, s.splat(least));
        let id = s.reduce_min_u(s.select_u(ties, self.id, s.splat_u(u32::MAX)));
        (id != u32::MAX).then_some((id, least))
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

    #[inline(always)]
    fn tighten(&mut self, s: S) {
        self.bound = s.reduce_min(self.distance);
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
        let mut rest = s.le(boxes, s.splat(self.cull)) & !(1 << lane);
        if rest == 0 {
            return;
        }
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            self.leaf(s, view, target, first + lane * view.leaf_blocks());
        }
        self.tighten(s);
    }
}
