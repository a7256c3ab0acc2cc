//! The k-nearest search: collect first, select at the end.
//!
//! A sorted list of the k best costs a search more than the distances do. So candidates under a
//! threshold are only appended, sixteen at a time; whenever there are more than about 2k, the threshold
//! is lowered until between k and 1.5k remain, by counting. The threshold never falls below the k-th
//! least distance seen, so no candidate that is dropped can be an answer. One sort at the end puts them in order.
//!
//! The first threshold is estimated from the size of the leaf at the query: a ball that should hold a few more than k
//! points. All leaves that it touches are known before the first of them has arrived from memory, and nothing has to
//! wait for a distance. If the ball turns out to hold fewer than k points, the search restarts with a larger
//! one. If k is much less than a leaf holds, the distances in the nearest leaves give a better threshold than an estimate.

use super::candidates::{Candidates, append};
use super::keys::{LANE_BITS, keys, smallest, unpack};
use super::leaf_queue::LeafQueue;
use super::threshold::{Origin, Threshold};
use super::{Keep, Observe};
use crate::point::layout::view::{LeafView, Target, View};
use crate::simd::{LANES, Mask, Simd, lanes_at};
use crate::tuning::points::SEVERAL;
use core::ops::Range;

/// The largest k for which a threshold comes from the minima of sixteen columns: it is tight if k is well below
/// their number.
const MOST_COLUMNS: usize = 10;

/// The state of a search for the k nearest points.
pub(in crate::point) struct KNearest<'a, K, O> {
    threshold: Threshold,
    candidates: &'a mut Candidates,
    queue: LeafQueue,
    /// Leaves of the current bottom node that are queued or visited, while its other leaves wait for a threshold.
    seen: Mask,
    keep: &'a K,
    observe: &'a mut O,
}

impl<'a, K: Keep, O: Observe> KNearest<'a, K, O> {
    /// A search that has found nothing yet; points exactly at `bound` count. `k` must not be 0.
    #[inline(always)]
    pub(in crate::point) fn within(
        k: usize,
        bound: f32,
        shrink: f32,
        candidates: &'a mut Candidates,
        keep: &'a K,
        observe: &'a mut O,
    ) -> Self {
        candidates.count = 0;
        let (threshold, queue) = (Threshold::new(k, bound, shrink), LeafQueue::new());
        KNearest { threshold, candidates, queue, seen: 0, keep, observe }
    }

    /// Continues the search with another filter and another observer, between two traversals.
    #[inline(always)]
    pub(in crate::point) fn with_filter<L, P>(
        &mut self,
        keep: &L,
        observe: &mut P,
        go: impl FnOnce(&mut KNearest<'_, L, P>),
    ) {
        let (candidates, queue) = (&mut *self.candidates, LeafQueue::new());
        let mut lent = KNearest { threshold: self.threshold, candidates, queue, seen: 0, keep, observe };
        go(&mut lent);
        self.threshold = lent.threshold;
    }

    /// Whether the estimate was too small: then the traversal of all layers has to be repeated.
    #[inline(always)]
    pub(in crate::point) fn retry(&mut self) -> bool {
        let retry = self.threshold.retry(self.candidates.count);
        if retry {
            self.candidates.count = 0;
        }
        retry
    }

    /// Lowers the threshold until at most about 1.5k candidates are below it.
    #[inline(always)]
    fn tighten<S: Simd>(&mut self, s: S, guess: f32) {
        let count = self.candidates.count;
        self.candidates.distances[count..count + LANES].fill(f32::INFINITY);
        let distances = &self.candidates.distances[..count.next_multiple_of(LANES)];
        if let Some(threshold) = self.threshold.find(s, distances, guess) {
            self.candidates.retain(s, threshold);
            self.threshold.set(threshold);
        } else {
            let last = self.candidates.retain_exactly(self.threshold.k);
            self.threshold.set(last.distance_squared);
            self.threshold.last = last.id;
        }
        self.threshold.origin = Origin::Known;
    }

    /// Tests the points of the queued leaves.
    #[inline(always)]
    pub(super) fn visit_leaves<S: Simd, V: LeafView>(&mut self, s: S, view: &V, target: &Target<S>) {
        let leaves = self.queue.drain();
        let blocks = view.leaf_blocks();
        self.candidates.reserve(leaves.len() * blocks * LANES);
        let (limit, last) = (s.splat(self.threshold.distance), self.threshold.last);
        let Candidates { distances, ids, count, .. } = &mut *self.candidates;
        let mut end = *count;
        for &leaf in leaves {
            for block in leaf as usize..leaf as usize + blocks {
                self.observe.block();
                let distance = view.point_distances(s, target, block);
                let ids_of_block = view.ids(block);
                let id = s.load_u(ids_of_block);
                let mut under = s.le(distance, limit);
                if last < u32::MAX {
                    under &= s.lt(distance, limit) | s.lt_u(id, s.splat_u(last));
                }
                let under = self.keep.kept(ids_of_block, under);
                end = append(s, distances, ids, end, (distance, id), under);
            }
        }
        *count = end;
        let first = self.threshold.origin == Origin::Caller;
        let lower = if first { end >= self.threshold.k } else { end > self.threshold.most() };
        if lower {
            let guess = if first {
                self.threshold.first(s, &self.candidates.distances[..end])
            } else {
                self.threshold.lower(self.threshold.distance)
            };
            self.tighten(s, guess);
        }
    }

    /// Estimates a threshold from the size of the nearest leaf. The number of points grows with the 3/2th power of the
    /// squared radius in space and with its first power on a surface; the exponent lies in between.
    #[inline(always)]
    fn guess<S: Simd, V: View>(&mut self, s: S, view: &V, target: &Target<S>, node: usize, boxes: S::F) {
        let (mut lane, near) = unpack(s.reduce_min_u(keys(s, boxes)));
        self.threshold.set_nearest(near);
        let holding = s.le(boxes, s.splat(0.0));
        if holding & holding.wrapping_sub(1) != 0 {
            lane = smallest(s, view, target, node, holding) as usize;
        }
        let share = self.threshold.expected_in_ball() / (LANES * view.leaf_blocks()) as f32;
        let ball = V::BALL
            * (share * share.sqrt()).sqrt()
            * self.threshold.scale
            * s.lane(view.box_sizes(s, target, node), lane);
        let threshold = near + ball;
        if near == f32::INFINITY {
            // The node is empty at this time; another layer may have points.
        } else if near > 4.0 * ball {
            // Only the edge of the ball would reach the points.
            self.threshold.guesses = 0;
        } else if threshold < self.threshold.distance {
            self.threshold.set(threshold);
            // The nearest leaf is visited in any case: however large epsilon is, the search finds points.
            let near = f32::from_bits(near.to_bits() | LANE_BITS);
            self.threshold.cull = if self.threshold.cull > near { self.threshold.cull } else { near };
            self.threshold.origin = Origin::Guess;
        } else {
            self.threshold.origin = Origin::Known;
        }
    }

    /// Visits the nearest leaves first: computes their distances, a threshold from these, and only then appends ids.
    #[inline(always)]
    fn seed<S: Simd, V: View>(&mut self, s: S, view: &V, target: &Target<S>, first: usize, boxes: S::F) -> Mask {
        let blocks = view.leaf_blocks();
        // As many leaves as hold three times k points, and one more: with a threshold from them few of the others
        // are needed.
        let (mut lanes, mut left) = (0, keys(s, boxes));
        self.threshold.set_nearest(unpack(s.reduce_min_u(left)).1);
        for _ in 0..(3 * self.threshold.k).div_ceil(LANES * blocks) + 1 {
            let (lane, _) = unpack(s.reduce_min_u(left));
            lanes |= 1 << lane;
            left = s.select_u(1 << lane, s.splat_u(u32::MAX), left);
        }
        lanes &= s.le(boxes, s.splat(self.threshold.cull));
        self.candidates.reserve(LANES * LANES * blocks);
        let mut least = s.splat(f32::MAX);
        let (mut rest, mut end) = (lanes, 0);
        while rest != 0 {
            let leaf = first + rest.trailing_zeros() as usize * blocks;
            rest &= rest - 1;
            for block in leaf..leaf + blocks {
                self.observe.block();
                let distance = view.point_distances(s, target, block);
                let under = self.keep.kept(view.ids(block), s.le(distance, s.splat(self.threshold.distance)));
                let distance = s.select(under, distance, s.splat(f32::INFINITY));
                self.candidates.write(s, end, distance);
                least = s.min(distance, least);
                end += LANES;
            }
        }
        // At least k points are at or below the k-th least of the columns' minima.
        let mut columns = [0; LANES];
        s.store_u(s.sort_u(s.to_bits(least)), &mut columns);
        let kth = f32::from_bits(columns[self.threshold.k - 1]);
        let threshold = if kth < self.threshold.distance { kth } else { self.threshold.distance };
        // In place: writing never overtakes reading.
        let limit = s.splat(threshold);
        let (mut rest, mut from) = (lanes, 0);
        let Candidates { distances, ids, raw, count, .. } = &mut *self.candidates;
        let mut end = *count;
        while rest != 0 {
            let leaf = first + rest.trailing_zeros() as usize * blocks;
            rest &= rest - 1;
            for block in leaf..leaf + blocks {
                let distance = s.load(lanes_at(raw, from));
                from += LANES;
                end = append(s, distances, ids, end, (distance, s.load_u(view.ids(block))), s.le(distance, limit));
            }
        }
        *count = end;
        if self.candidates.count > self.threshold.most() {
            self.tighten(s, self.threshold.lower(threshold));
        } else if self.candidates.count >= self.threshold.k {
            self.threshold.set(threshold);
            self.threshold.origin = Origin::Known;
        }
        lanes
    }

    /// Whether leaves of the bottom node that was tested last wait for a threshold: it is to be tested again once the queued ones
    /// are visited.
    #[inline(always)]
    pub(super) fn has_waiting_leaves(&self) -> bool {
        self.seen != 0
    }

    /// The squared distance above which boxes are culled (strictly).
    #[inline(always)]
    pub(super) fn cull(&self) -> f32 {
        self.threshold.cull
    }

    /// Counts a node that is about to be tested.
    #[inline(always)]
    pub(super) fn count_node(&mut self) {
        self.observe.node();
    }

    /// Whether no leaf was visited yet: the descent to the first bottom node.
    #[inline(always)]
    pub(super) fn at_start(&self) -> bool {
        self.threshold.origin == Origin::Caller && self.candidates.count == 0
    }

    /// Queues the leaves of a bottom node, whose squared distances are `boxes`. Returns whether it is time to
    /// [visit](Self::visit_leaves) them.
    #[inline(always)]
    pub(super) fn push_leaves<S: Simd, V: View>(
        &mut self,
        s: S,
        view: &V,
        target: &Target<S>,
        node: usize,
        boxes: S::F,
    ) -> bool {
        let first = view.first_block(node);
        let mut found = core::mem::take(&mut self.seen);
        if self.threshold.origin == Origin::Caller {
            let few = self.threshold.k <= MOST_COLUMNS;
            let much_less_than_leaf = few && self.threshold.k < LANES * view.leaf_blocks() / 2;
            // Earlier candidates may lie beyond the ball and must not count as found within it.
            if self.threshold.guesses > 0 && self.candidates.count == 0 && !much_less_than_leaf {
                self.guess(s, view, target, node, boxes);
            }
            if few && self.threshold.origin == Origin::Caller && found == 0 {
                found = self.seed(s, view, target, first, boxes);
            }
        }
        let left = s.le(boxes, s.splat(self.threshold.cull)) & !found;
        // From far away, and where points are few: points of the nearest leaves give a threshold for the others. Also where many
        // are left: then the threshold is from leaves that are large or far away, as outliers have, and is loose.
        let several = if self.threshold.origin == Origin::Caller { 0 } else { SEVERAL };
        let enough = (2 * self.threshold.k).div_ceil(LANES * view.leaf_blocks()) + 1;
        if left.count_ones() as usize > enough + several {
            let nearest = nearest_leaves(s, boxes, left, enough);
            self.queue.push_lanes(s, view, first, nearest);
            self.seen = found | nearest;
            return true;
        }
        self.queue.push_lanes(s, view, first, left);
        self.queue.is_ready() || self.threshold.origin == Origin::Caller
    }

    /// Visits a leaf of a tree without boxes.
    #[inline(always)]
    pub(super) fn leaf<S: Simd, V: LeafView>(&mut self, s: S, view: &V, target: &Target<S>, mut blocks: Range<usize>) {
        while !blocks.is_empty() {
            while !self.queue.is_ready() {
                let Some(block) = blocks.next() else { break };
                self.queue.push(block);
            }
            // The next leaf depends on the threshold.
            self.visit_leaves(s, view, target);
        }
    }
}

/// Of more leaves of a bottom node so many nearest ones, or all of them if none has points at this time.
#[inline(always)]
fn nearest_leaves<S: Simd>(s: S, boxes: S::F, leaves: Mask, enough: usize) -> Mask {
    let mut left = keys(s, s.select(leaves, boxes, s.splat(f32::INFINITY)));
    let mut nearest = 0;
    for _ in 0..enough {
        let (lane, _) = unpack(s.reduce_min_u(left));
        nearest |= 1 << lane;
        left = s.select_u(1 << lane, s.splat_u(u32::MAX), left);
    }
    // Leaves without points are infinitely far away, as are lanes that are not among them.
    if nearest & leaves == 0 { leaves } else { nearest & leaves }
}
