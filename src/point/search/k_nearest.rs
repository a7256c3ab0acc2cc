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
//!
//! Thresholds are sought beyond the distance of the nearest leaf: from far away all distances are about that, and one in proportion
//! to the whole distance would have all points below it or none.

use super::candidates::{Candidates, append};
use super::keys::{LANE_BITS, keys, smallest, unpack};
use super::leaf_queue::LeafQueue;
use super::{Keep, Observe};
use crate::point::layout::snapshot::{LeafView, Target, View};
use crate::simd::{LANES, Mask, Simd, lanes_at};
use crate::tuning::points::SEVERAL;
use core::ops::Range;

/// How often a threshold is estimated before the search continues without.
const GUESSES: u32 = 3;

/// The largest k for which it is estimated: beyond, there may well be fewer than k points, and an estimate that is too
/// small costs much.
const MOST_GUESSED: usize = 1 << 12;

/// The largest k for which a threshold comes from the minima of sixteen columns: it is tight if k is well below
/// their number.
const MOST_COLUMNS: usize = 10;

/// The origin of a threshold.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Origin {
    /// Given by the caller; it may be far too large.
    Caller,
    /// Estimated: fewer than k points may lie within it.
    Guess,
    /// Confirmed by k points that lie within it, or given by the caller and less than the estimate.
    Known,
}

/// The state of a search for the k nearest points.
pub(in crate::point) struct KNearest<'a, K, O> {
    k: usize,
    /// Points farther than this are no answers.
    threshold: f32,
    /// The origin of the threshold.
    origin: Origin,
    /// Of points exactly at the threshold, those with greater ids are no answers: k others are known.
    last: u32,
    /// Boxes beyond this are culled: the threshold, or less if answers may be approximate and k points are
    /// within it.
    cull: f32,
    /// The caller's bound.
    bound: f32,
    /// The squared distance of the nearest leaf in the first bottom node: about the least that there is, and far from zero if the
    /// query is far from all points.
    nearest: f32,
    shrink: f32,
    /// How often a threshold may still be estimated, and a factor on the next estimate.
    guesses: u32,
    scale: f32,
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
        let queue = LeafQueue::new();
        KNearest {
            // As good as any larger number, and small multiples of it do not overflow.
            k: k.min(usize::MAX / 4),
            threshold: bound,
            origin: Origin::Caller,
            last: u32::MAX,
            cull: bound,
            bound,
            nearest: 0.0,
            shrink,
            guesses: if k <= MOST_GUESSED { GUESSES } else { 0 },
            scale: 1.0,
            candidates,
            queue,
            seen: 0,
            keep,
            observe,
        }
    }

    /// Continues the search with another filter and another observer, between two traversals.
    #[inline(always)]
    pub(in crate::point) fn with_filter<L, P>(
        &mut self,
        keep: &L,
        observe: &mut P,
        go: impl FnOnce(&mut KNearest<'_, L, P>),
    ) {
        let KNearest { k, threshold, origin, last, cull, bound, nearest, shrink, guesses, scale, .. } = *self;
        let (candidates, queue, seen) = (&mut *self.candidates, LeafQueue::new(), 0);
        let mut lent = KNearest {
            k,
            threshold,
            origin,
            last,
            cull,
            bound,
            nearest,
            shrink,
            guesses,
            scale,
            candidates,
            queue,
            seen,
            keep,
            observe,
        };
        go(&mut lent);
        let KNearest { threshold, origin, last, cull, nearest, guesses, scale, .. } = lent;
        (self.threshold, self.origin, self.last, self.cull) = (threshold, origin, last, cull);
        (self.nearest, self.guesses, self.scale) = (nearest, guesses, scale);
    }

    /// Whether the estimate was too small: then the traversal of all layers has to be repeated.
    #[inline(always)]
    pub(in crate::point) fn retry(&mut self) -> bool {
        let retry = self.origin == Origin::Guess && self.candidates.count < self.k;
        if retry {
            self.guesses -= 1;
            self.scale = scaled(self.scale, 1.5 * self.expected_in_ball(), self.candidates.count as f32);
            self.candidates.count = 0;
            self.origin = Origin::Caller;
            (self.threshold, self.cull) = (self.bound, self.bound);
        }
        retry
    }

    /// Sets the threshold to one that k points are within, or are expected to be. The caller's bound is not shrunk:
    /// boxes within it may hold one of the first k points.
    #[inline(always)]
    fn set_threshold(&mut self, threshold: f32) {
        self.threshold = threshold;
        self.last = u32::MAX;
        self.cull = threshold * self.shrink;
    }

    /// The number of points that the estimated ball should hold, such that it seldom holds fewer than k.
    #[inline(always)]
    fn expected_in_ball(&self) -> f32 {
        let k = self.k as f32;
        k + 1.5 * k.sqrt()
    }

    /// The number of candidates above which the threshold is lowered.
    #[inline(always)]
    fn limit(&self) -> usize {
        self.k.saturating_mul(2).saturating_add(8)
    }

    /// The number of candidates that a new threshold should have below it.
    #[inline(always)]
    fn aim(&self) -> f32 {
        (self.k + self.k / 4 + 2) as f32
    }

    /// A threshold that has between k and about 1.5k of the distances below it, found by counting from an initial
    /// guess; `None` if equal distances prevent it. The number of distances is a multiple of [`LANES`].
    #[inline(always)]
    fn find_threshold<S: Simd>(&self, s: S, distances: &[f32], guess: f32) -> Option<f32> {
        let most = self.k + self.k / 2 + 4;
        let aim = self.aim();
        // `low` has fewer than k below it, `high` too many.
        let (mut low, mut high) = (-1.0f32, self.threshold);
        let mut threshold = guess;
        let mut found = None;
        for _ in 0..12 {
            let mut under = 0;
            let limit = s.splat(threshold);
            for at in (0..distances.len()).step_by(LANES) {
                under += s.le(s.load(lanes_at(distances, at)), limit).count_ones() as usize;
            }
            if under < self.k {
                low = threshold;
            } else {
                high = threshold;
                found = (under <= self.limit()).then_some(threshold);
                if under <= most {
                    break;
                }
            }
            let next = self.scaled_from(threshold, aim, under as f32);
            let between = next > low && next < high;
            // Hardly any point is nearer than the nearest leaf.
            let from = if low < self.nearest && self.nearest < high { self.nearest } else { low };
            threshold = if between { next } else { middle(from, high) };
        }
        found
    }

    /// Lowers the threshold until at most about 1.5k candidates are below it.
    #[inline(always)]
    fn tighten<S: Simd>(&mut self, s: S, guess: f32) {
        let count = self.candidates.count;
        self.candidates.distances[count..count + LANES].fill(f32::INFINITY);
        let distances = &self.candidates.distances[..count.next_multiple_of(LANES)];
        if let Some(threshold) = self.find_threshold(s, distances, guess) {
            self.candidates.retain(s, threshold);
            self.set_threshold(threshold);
        } else {
            let last = self.candidates.retain_exactly(self.k);
            self.set_threshold(last.distance_squared);
            self.last = last.id;
        }
        self.origin = Origin::Known;
    }

    /// An initial guess for the first threshold if none was estimated, from at least k candidates.
    #[inline(always)]
    fn first_threshold<S: Simd>(&self, s: S) -> f32 {
        let whole = self.candidates.count / LANES * LANES;
        let mut sum = s.splat(0.0);
        for at in (0..whole).step_by(LANES) {
            sum = sum + s.load(lanes_at(&self.candidates.distances, at));
        }
        let mut columns = [0.0; LANES];
        s.store(sum, &mut columns);
        // More than half of the distances are below their mean.
        let mean = self::sum(&columns) / whole as f32;
        self.scaled_from(mean, self.aim(), 0.6 * whole as f32)
    }

    /// A threshold with `wanted` points below it where one has `found`, by the distance beyond the nearest leaf: from far away, all
    /// points are about equally far.
    #[inline(always)]
    fn scaled_from(&self, threshold: f32, wanted: f32, found: f32) -> f32 {
        let beyond = threshold - self.nearest;
        if beyond > 0.0 { self.nearest + scaled(beyond, wanted, found) } else { scaled(threshold, wanted, found) }
    }

    /// Remembers the squared distance of the nearest leaf of a bottom node, if there is one at this time.
    #[inline(always)]
    fn set_nearest(&mut self, near: f32) {
        self.nearest = if near < f32::INFINITY { near } else { 0.0 };
    }

    /// A threshold that somewhat fewer points are below.
    #[inline(always)]
    fn lower(&self, threshold: f32) -> f32 {
        threshold - 0.25 * (threshold - self.nearest).max(0.0)
    }

    /// Tests the points of the queued leaves.
    #[inline(always)]
    pub(super) fn visit_leaves<S: Simd, V: LeafView>(&mut self, s: S, view: &V, target: &Target<S>) {
        let leaves = self.queue.drain();
        let blocks = view.leaf_blocks();
        self.candidates.reserve(leaves.len() * blocks * LANES);
        let (limit, last) = (s.splat(self.threshold), self.last);
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
        let first = self.origin == Origin::Caller;
        let lower = if first { end >= self.k } else { end > self.limit() };
        if lower {
            let guess = if first { self.first_threshold(s) } else { self.lower(self.threshold) };
            self.tighten(s, guess);
        }
    }

    /// Estimates a threshold from the size of the nearest leaf. The number of points grows with the 3/2th power of the
    /// squared radius in space and with its first power on a surface; the exponent lies in between.
    #[inline(always)]
    fn guess<S: Simd, V: View>(&mut self, s: S, view: &V, target: &Target<S>, node: usize, boxes: S::F) {
        let (mut lane, near) = unpack(s.reduce_min_u(keys(s, boxes)));
        self.set_nearest(near);
        let holding = s.le(boxes, s.splat(0.0));
        if holding & holding.wrapping_sub(1) != 0 {
            lane = smallest(s, view, target, node, holding) as usize;
        }
        let share = self.expected_in_ball() / (LANES * view.leaf_blocks()) as f32;
        let ball = V::BALL * (share * share.sqrt()).sqrt() * self.scale * s.lane(view.box_sizes(s, target, node), lane);
        let threshold = near + ball;
        if near == f32::INFINITY {
            // The node is empty at this time; another layer may have points.
        } else if near > 4.0 * ball {
            // Only the edge of the ball would reach the points.
            self.guesses = 0;
        } else if threshold < self.threshold {
            self.set_threshold(threshold);
            // The nearest leaf is visited in any case: however large epsilon is, the search finds points.
            let near = f32::from_bits(near.to_bits() | LANE_BITS);
            self.cull = if self.cull > near { self.cull } else { near };
            self.origin = Origin::Guess;
        } else {
            self.origin = Origin::Known;
        }
    }

    /// Visits the nearest leaves first: computes their distances, a threshold from these, and only then appends ids.
    #[inline(always)]
    fn seed<S: Simd, V: View>(&mut self, s: S, view: &V, target: &Target<S>, first: usize, boxes: S::F) -> Mask {
        let blocks = view.leaf_blocks();
        // As many leaves as hold three times k points, and one more: with a threshold from them few of the others
        // are needed.
        let (mut lanes, mut left) = (0, keys(s, boxes));
        self.set_nearest(unpack(s.reduce_min_u(left)).1);
        for _ in 0..(3 * self.k).div_ceil(LANES * blocks) + 1 {
            let (lane, _) = unpack(s.reduce_min_u(left));
            lanes |= 1 << lane;
            left = s.select_u(1 << lane, s.splat_u(u32::MAX), left);
        }
        lanes &= s.le(boxes, s.splat(self.cull));
        self.candidates.reserve(LANES * LANES * blocks);
        let mut least = s.splat(f32::MAX);
        let (mut rest, mut end) = (lanes, 0);
        while rest != 0 {
            let leaf = first + rest.trailing_zeros() as usize * blocks;
            rest &= rest - 1;
            for block in leaf..leaf + blocks {
                self.observe.block();
                let distance = view.point_distances(s, target, block);
                let under = self.keep.kept(view.ids(block), s.le(distance, s.splat(self.threshold)));
                let distance = s.select(under, distance, s.splat(f32::INFINITY));
                self.candidates.write(s, end, distance);
                least = s.min(distance, least);
                end += LANES;
            }
        }
        // At least k points are at or below the k-th least of the columns' minima.
        let mut columns = [0; LANES];
        s.store_u(s.sort_u(s.to_bits(least)), &mut columns);
        let kth = f32::from_bits(columns[self.k - 1]);
        let threshold = if kth < self.threshold { kth } else { self.threshold };
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
        if self.candidates.count > self.limit() {
            self.tighten(s, self.lower(threshold));
        } else if self.candidates.count >= self.k {
            self.set_threshold(threshold);
            self.origin = Origin::Known;
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
        self.cull
    }

    /// Counts a node that is about to be tested.
    #[inline(always)]
    pub(super) fn count_node(&mut self) {
        self.observe.node();
    }

    /// Whether no leaf was visited yet: the descent to the first bottom node.
    #[inline(always)]
    pub(super) fn at_start(&self) -> bool {
        self.origin == Origin::Caller && self.candidates.count == 0
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
        if self.origin == Origin::Caller {
            let few = self.k <= MOST_COLUMNS;
            let much_less_than_leaf = few && self.k < LANES * view.leaf_blocks() / 2;
            // Earlier candidates may lie beyond the ball and must not count as found within it.
            if self.guesses > 0 && self.candidates.count == 0 && !much_less_than_leaf {
                self.guess(s, view, target, node, boxes);
            }
            if few && self.origin == Origin::Caller && found == 0 {
                found = self.seed(s, view, target, first, boxes);
            }
        }
        let left = s.le(boxes, s.splat(self.cull)) & !found;
        // From far away, and where points are few: points of the nearest leaves give a threshold for the others. Also where many
        // are left: then the threshold is from leaves that are large or far away, as outliers have, and is loose.
        let several = if self.origin == Origin::Caller { 0 } else { SEVERAL };
        let enough = (2 * self.k).div_ceil(LANES * view.leaf_blocks()) + 1;
        if left.count_ones() as usize > enough + several {
            let nearest = nearest_leaves(s, boxes, left, enough);
            self.queue.push_lanes(s, view, first, nearest);
            self.seen = found | nearest;
            return true;
        }
        self.queue.push_lanes(s, view, first, left);
        self.queue.is_ready() || self.origin == Origin::Caller
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

/// Pairwise sum, without a long chain of dependent additions.
#[inline(always)]
fn sum(x: &[f32; LANES]) -> f32 {
    let eight: [f32; 8] = core::array::from_fn(|i| x[i] + x[i + 8]);
    let four: [f32; 4] = core::array::from_fn(|i| eight[i] + eight[i + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

/// `threshold · (wanted / found)^(3/4)`, roughly, within factors of eight: the number of points grows with the cube of
/// the distance, which gives 2/3, but the points counted lie more to one side of the query than to the other. Bits
/// of floats replace logarithms; the result is only an estimate anyway.
#[inline(always)]
fn scaled(threshold: f32, wanted: f32, found: f32) -> f32 {
    let more = wanted.to_bits() as i32 - found.max(0.125).to_bits() as i32;
    let by = (more / 4 * 3).clamp(-3 << 23, 3 << 23);
    // The caller rejects thresholds whose bits leave the range of floats.
    f32::from_bits(threshold.to_bits().saturating_add_signed(by))
}

/// The float half-way between two floats in the order of their bits.
#[inline(always)]
fn middle(low: f32, high: f32) -> f32 {
    let low = low.max(0.0).to_bits();
    f32::from_bits(low + (high.to_bits() - low) / 2)
}
