//! The search for the nearest point.
//!
//! It descends to the nearest leaf first; the bound from there leaves few other candidates. These are kept as masks: the
//! rest of the bottom node, then the remaining children of the nodes above it.
//!
//! Every further step depends on the bound, so the bound is the critical path: it is kept separate from the ids, which
//! are needed at the end only, and in all lanes, so that it can be compared with boxes.

use super::Keep;
use super::kd_search::KdFront;
use super::keys::{keys, smallest, unpack};
use crate::limits::MAX_LEVELS;
use crate::point::layout::kd_points::KdPointsView;
use crate::point::layout::view::{LeafView, Target, View};
use crate::simd::{LANES, Mask, Simd};
use crate::tuning::points::NEAR;
use glam::Vec3;

/// The best so far, lane by lane.
pub(in crate::point) struct Best<'a, S: Simd, K> {
    distance: S::F,
    id: S::U,
    /// The least distance, in all lanes.
    least: S::F,
    /// The same, or less if answers may be approximate: boxes farther away than this are culled.
    cull: S::F,
    /// The caller's bound, and the factor of approximate answers.
    bound: f32,
    shrink: f32,
    keep: &'a K,
}

impl<'a, S: Simd, K: Keep> Best<'a, S, K> {
    /// A search that has found nothing yet; points exactly at `bound` count.
    #[inline(always)]
    pub(in crate::point) fn within(s: S, bound: f32, shrink: f32, keep: &'a K) -> Self {
        let (least, id) = (s.splat(bound), s.splat_u(u32::MAX));
        Best { distance: least, id, least, cull: least, bound, shrink, keep }
    }

    /// Id and squared distance of the nearest, lowest id first.
    #[inline(always)]
    pub(in crate::point) fn finish(self, s: S) -> Option<(u32, f32)> {
        let nearest = s.eq(self.distance, self.least);
        let id = s.reduce_min_u(s.select_u(nearest, self.id, s.splat_u(u32::MAX)));
        (id != u32::MAX).then_some((id, s.lane(self.least, 0)))
    }

    /// Tests the points of a leaf; updates `least` at once, and the best distances with their ids.
    #[inline(always)]
    fn leaf<V: LeafView>(&mut self, s: S, view: &V, target: &Target<S>, least: &mut S::U, leaf: usize) {
        for block in leaf..leaf + view.leaf_blocks() {
            let distance = view.point_distances(s, target, block);
            let ids = view.ids(block);
            let id = s.load_u(ids);
            let nearer = s.lt(distance, self.distance);
            let tied = s.eq(distance, self.distance) & s.lt_u(id, self.id);
            let take = self.keep.kept(ids, nearer | tied);
            let near = if K::FILTERS { s.select(take, distance, s.splat(f32::INFINITY)) } else { distance };
            // The bits of distances are ordered like distances, and NaN, of absent points, is above all of them.
            *least = s.min_u(*least, s.to_bits(near));
            self.distance = s.select(take, distance, self.distance);
            self.id = s.select_u(take, id, self.id);
        }
    }

    /// Broadcasts the least distance to all lanes.
    #[inline(always)]
    fn tighten(&mut self, s: S, least: S::U) {
        let least = s.min_u(least, s.swap_lanes_u::<8>(least));
        let least = s.min_u(least, s.swap_lanes_u::<4>(least));
        let least = s.min_u(least, s.swap_lanes_u::<2>(least));
        let least = s.min_u(least, s.swap_lanes_u::<1>(least));
        self.least = s.from_bits(least);
        self.cull = self.least;
        if self.shrink < 1.0 {
            // Only a distance that was found may be shrunk, not the caller's bound.
            let found = s.lt(self.least, s.splat(self.bound));
            self.cull = s.select(found, self.least * s.splat(self.shrink), self.least);
        }
    }

    /// Visits the nearest leaf of a bottom node; returns its lane. If leaves are not in a near cache, the next two
    /// are prefetched meanwhile.
    #[inline(always)]
    fn nearest_leaf<V: View>(
        &mut self,
        s: S,
        view: &V,
        target: &Target<S>,
        first: usize,
        (boxes, holding): (S::F, Mask),
    ) -> usize {
        let nearest = nearest_lane(s, boxes, holding);
        let shift = shift(view);
        if view.leaf_bytes() > NEAR {
            let others = s.select(1 << nearest, s.splat(f32::INFINITY), boxes);
            let second = nearest_lane(s, others, 0);
            view.prefetch_leaf(first + (second << shift));
            let third = nearest_lane(s, s.select(1 << second, s.splat(f32::INFINITY), others), 0);
            view.prefetch_leaf(first + (third << shift));
        }
        let mut least = s.to_bits(self.least);
        self.leaf(s, view, target, &mut least, first + (nearest << shift));
        self.tighten(s, least);
        nearest
    }

    /// Visits some leaves of a bottom node.
    #[inline(always)]
    fn leaves<V: View>(&mut self, s: S, view: &V, target: &Target<S>, first: usize, lanes: Mask) {
        let mut least = s.to_bits(self.least);
        let mut rest = lanes;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            self.leaf(s, view, target, &mut least, first + (lane << shift(view)));
        }
        self.tighten(s, least);
    }

    /// Searches a tree for points nearer than the best so far.
    #[inline(always)]
    pub(in crate::point) fn search<V: View>(&mut self, s: S, view: &V, target: &Target<S>) {
        let (top, root) = view.root();
        // Per level the distances of children not visited yet, infinite for the others, and the child of lane 0.
        let mut open = [[f32::INFINITY; LANES]; MAX_LEVELS];
        let mut first = [0; MAX_LEVELS];
        let (mut level, mut node) = (top, root);
        let mut found_leaf = false;
        loop {
            let (mut left, mut holding) = view.boxes(s, target, node);
            if level == 0 {
                let first = view.first_block(node);
                let mut rest = s.le(left, self.cull);
                if !found_leaf && rest != 0 {
                    found_leaf = true;
                    let seen = self.nearest_leaf(s, view, target, first, (left, holding));
                    rest = s.le(left, self.cull) & !(1 << seen);
                }
                if rest != 0 {
                    self.leaves(s, view, target, first, rest);
                }
                level = 1;
                if level > top {
                    return;
                }
                left = s.load(&open[1]);
                holding = 0;
            } else {
                first[level] = view.first_child(level, node);
            }
            // A child that holds the point is within any bound.
            if holding == 0 {
                while s.le(left, self.cull) == 0 {
                    level += 1;
                    if level > top {
                        return;
                    }
                    left = s.load(&open[level]);
                }
            }
            let lane = if holding & holding.wrapping_sub(1) != 0 && !found_leaf {
                smallest(s, view, target, node, holding) as usize
            } else {
                nearest_lane(s, left, holding)
            };
            left = s.select(1 << lane, s.splat(f32::INFINITY), left);
            s.store(left, &mut open[level]);
            node = first[level] + lane;
            if level == 1 && view.leaf_bytes() > NEAR {
                view.prefetch_node(first[level] + nearest_lane(s, left, 0));
            }
            level -= 1;
        }
    }

    /// Searches a k-d tree for points nearer than the best so far.
    #[inline(always)]
    pub(in crate::point) fn search_kd(&mut self, s: S, view: &KdPointsView<'_>, point: Vec3) {
        let target = view.target(s, point);
        let mut front = KdFront::begin();
        while let Some(blocks) = front.next(view, point, s.lane(self.cull, 0), || ()) {
            let mut least = s.to_bits(self.least);
            for block in blocks {
                self.leaf(s, view, &target, &mut least, block);
            }
            self.tighten(s, least);
        }
    }
}

/// A box that holds the point, or the nearest one if there is none. A mask is known long before the least of sixteen
/// numbers, and few points lie between the boxes of nodes.
#[inline(always)]
fn nearest_lane<S: Simd>(s: S, boxes: S::F, holding: Mask) -> usize {
    if holding != 0 { holding.trailing_zeros() as usize } else { unpack(s.reduce_min_u(keys(s, boxes))).0 }
}

/// Binary logarithm of the number of blocks per leaf, which is 1 or 2.
#[inline(always)]
fn shift<V: LeafView>(view: &V) -> usize {
    view.leaf_blocks() >> 1
}
