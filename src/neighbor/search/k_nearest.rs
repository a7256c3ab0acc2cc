//! The k nearest points: collect first, select at the end.
//!
//! A sorted list of the k best costs a search more than the distances do. So candidates under a
//! threshold are only appended, sixteen at a time; whenever there are more than about 2k, the threshold
//! is lowered until between k and 1.5k remain, by counting. The threshold never falls below the k-th
//! least distance seen, so what is dropped can not be an answer. One sort at the end puts them in order.

use super::candidates::{Candidates, append};
use super::sort::sort_lanes;
use super::waiting::Waiting;
use super::walk::{Collect, keys, unpack};
use super::{Keep, Observe, kept};
use crate::neighbor::view::{Target, View};
use crate::simd::{LANES, Simd, lanes_at};

/// The search for k nearest.
pub(in crate::neighbor) struct KNearest<'a, K, O> {
    k: usize,
    /// What is farther than this can not be an answer.
    threshold: f32,
    cull: f32,
    shrink: f32,
    candidates: &'a mut Candidates,
    waiting: Waiting,
    keep: &'a K,
    observe: &'a mut O,
}

impl<'a, K: Keep, O: Observe> KNearest<'a, K, O> {
    /// Nothing found yet; what lies at `bound` itself still counts. `k` must not be 0.
    #[inline(always)]
    pub(in crate::neighbor) fn within(
        k: usize,
        bound: f32,
        shrink: f32,
        candidates: &'a mut Candidates,
        keep: &'a K,
        observe: &'a mut O,
    ) -> Self {
        candidates.count = 0;
        let waiting = Waiting::new();
        KNearest { k, threshold: bound, cull: bound * shrink, shrink, candidates, waiting, keep, observe }
    }

    /// The observer.
    pub(in crate::neighbor) fn observed(&self) -> &O {
        self.observe
    }

    /// Candidates above which the threshold is lowered.
    #[inline(always)]
    fn limit(&self) -> usize {
        self.k.saturating_mul(2).saturating_add(8)
    }

    /// Candidates that a new threshold should have under it.
    #[inline(always)]
    fn aim(&self) -> f32 {
        (self.k + self.k / 4 + 2) as f32
    }

    /// A threshold that has between k and about 1.5k of the distances under it, found by counting from a
    /// guess; nothing where equal distances prevent it. There are a multiple of [`LANES`] distances.
    #[inline(always)]
    fn lower<S: Simd>(&self, s: S, distances: &[f32], guess: f32) -> Option<f32> {
        let most = self.k + self.k / 2 + 4;
        let aim = self.aim();
        // `low` has fewer than k under it, `high` too many.
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
            let next = scaled(threshold, aim, under as f32);
            let between = next > low && next < high;
            threshold = if between { next } else { middle(low, high) };
        }
        found
    }

    /// Lowers the threshold until at most about 1.5k candidates are under it.
    #[inline(always)]
    fn tighten<S: Simd>(&mut self, s: S, guess: f32) {
        let count = self.candidates.count;
        self.candidates.distances[count..count + LANES].fill(f32::INFINITY);
        match self.lower(s, &self.candidates.distances[..count.next_multiple_of(LANES)], guess) {
            Some(threshold) => {
                self.threshold = threshold;
                self.candidates.retain(s, threshold);
            }
            None => self.threshold = self.candidates.retain_exactly(self.k),
        }
        self.cull = self.threshold * self.shrink;
    }

    /// Looks at the leaves on the list.
    #[inline(always)]
    fn look<S: Simd, V: View>(&mut self, s: S, view: &V, target: &Target<S>) {
        let leaves = self.waiting.take();
        let blocks = view.leaf_blocks();
        self.candidates.reserve(leaves.len() * blocks * LANES);
        let limit = s.splat(self.threshold);
        let Candidates { distances, ids, count, .. } = &mut *self.candidates;
        let mut end = *count;
        for &leaf in leaves {
            for block in leaf as usize..leaf as usize + blocks {
                self.observe.block();
                let distance = view.point_distances(s, target, block);
                let names = view.ids(block);
                let under = kept(self.keep, names, s.le(distance, limit));
                end = append(s, distances, ids, end, (distance, s.load_u(names)), under);
            }
        }
        *count = end;
        if end > self.limit() {
            self.tighten(s, self.threshold * 0.75);
        }
    }

    /// The first bottom node: the distances of all its points, a threshold from them, and only then ids.
    #[inline(always)]
    fn seed<S: Simd, V: View>(&mut self, s: S, view: &V, target: &Target<S>, first: usize, lanes: u16) {
        let begin = self.candidates.count;
        let blocks = view.leaf_blocks();
        let (mut least, mut count) = (s.splat(f32::MAX), begin);
        let (mut rest, mut end) = (lanes, 0);
        while rest != 0 {
            let leaf = first + rest.trailing_zeros() as usize * blocks;
            rest &= rest - 1;
            for block in leaf..leaf + blocks {
                self.observe.block();
                let distance = view.point_distances(s, target, block);
                let under = kept(self.keep, view.ids(block), s.le(distance, s.splat(self.threshold)));
                let distance = s.select(under, distance, s.splat(f32::INFINITY));
                self.candidates.write(s, end, distance);
                least = s.min(distance, least);
                count += under.count_ones() as usize;
                end += LANES;
            }
        }
        let mut threshold = self.threshold;
        if self.k <= MOST_COLUMNS {
            // As many points as columns are at or below the k-th least of the columns' minima.
            let mut columns = [0; LANES];
            s.store_u(sort_lanes(s, s.to_bits(least)), &mut columns);
            let kth = f32::from_bits(columns[self.k - 1]);
            threshold = if kth < threshold { kth } else { threshold };
        } else if count > self.limit() && begin == 0 {
            // About a dozen points are under the mean of sixteen columns' minima.
            let mut column = [0.0; LANES];
            s.store(least, &mut column);
            let mean = sum(&column) * (1.0 / LANES as f32);
            let guess = scaled(mean, self.aim(), 12.0);
            let guess = if guess < threshold { guess } else { middle(0.0, threshold) };
            if let Some(lower) = self.lower(s, &self.candidates.raw[..end], guess) {
                threshold = lower;
            }
        }
        // In place: what is written never overtakes what is read.
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
            self.tighten(s, middle(0.0, threshold));
        } else if self.candidates.count >= self.k {
            self.threshold = threshold;
            self.cull = threshold * self.shrink;
        }
    }
}

/// The largest k for which the first threshold comes from the minima of sixteen columns: it is tight where k is well
/// below their number.
const MOST_COLUMNS: usize = 10;

/// Leaves that are worth picking out one by one, nearest first.
const MOST_SORTED: usize = 6;

/// Sum by halves, so that it needs no chain of additions.
#[inline(always)]
fn sum(x: &[f32; LANES]) -> f32 {
    let eight: [f32; 8] = core::array::from_fn(|i| x[i] + x[i + 8]);
    let four: [f32; 4] = core::array::from_fn(|i| eight[i] + eight[i + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

/// `threshold · (wanted / found)^(3/4)`, roughly, within factors of eight: points grow with the cube of the
/// distance, which gives 2/3, but what was counted lies more to one side of the query than to the other. Bits
/// of floats stand in for logarithms; it is only a guess anyway.
#[inline(always)]
fn scaled(threshold: f32, wanted: f32, found: f32) -> f32 {
    let more = wanted.to_bits() as i32 - found.max(0.125).to_bits() as i32;
    let by = (more / 4 * 3).clamp(-3 << 23, 3 << 23);
    // Thresholds whose bits leave the range of floats are refused by whoever asks.
    f32::from_bits(threshold.to_bits().saturating_add_signed(by))
}

/// Half-way between two floats, counted in floats.
#[inline(always)]
fn middle(low: f32, high: f32) -> f32 {
    let low = low.max(0.0).to_bits();
    f32::from_bits(low + (high.to_bits() - low) / 2)
}

impl<S: Simd, K: Keep, O: Observe> Collect<S> for KNearest<'_, K, O> {
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
        let within = s.le(boxes, s.splat(self.cull));
        if self.candidates.count >= self.k {
            self.waiting.add(s, view, first, within);
            if self.waiting.many() {
                self.look(s, view, target);
            }
            return;
        }
        self.candidates.reserve(LANES * LANES * view.leaf_blocks());
        // As many of the nearest leaves as hold three times what is wanted, and one more where that is little; with
        // a threshold from them few of the others are needed.
        let few = self.k <= MOST_COLUMNS;
        let enough = (3 * self.k.min(1 << 20)).div_ceil(LANES * view.leaf_blocks()) + usize::from(few);
        if enough > MOST_SORTED {
            return self.seed(s, view, target, first, within);
        }
        let (mut chosen, mut left) = (0, keys(s, boxes));
        for _ in 0..enough {
            let (lane, _) = unpack(s.reduce_min_u(left));
            chosen |= 1 << lane;
            left = s.select_u(1 << lane, s.splat_u(u32::MAX), left);
        }
        self.seed(s, view, target, first, chosen & within);
        self.waiting.add(s, view, first, s.le(boxes, s.splat(self.cull)) & within & !chosen);
        // A threshold from columns is tight enough for the rest of the walk.
        if !few || self.candidates.count < self.k || self.waiting.many() {
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
