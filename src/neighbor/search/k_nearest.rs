//! The k nearest points: collect first, select at the end.
//!
//! A sorted list of the k best costs a search more than the distances do. So candidates under a
//! threshold are only appended, sixteen at a time; whenever there are more than about 2k, the threshold
//! is lowered until between k and 1.5k remain, by counting. The threshold never falls below the k-th
//! least distance seen, so what is dropped can not be an answer. One sort at the end puts them in order.

use super::sort::{pack, sort_lanes, unpack as unpack_pair};
use super::walk::{Collect, LANE, keys, unpack};
use super::{Keep, Observe, kept};
use crate::neighbor::view::{Target, View};
use crate::simd::{LANES, Mask, Simd, lanes_at};

/// Memory for candidates: distances and ids apart, with a vector of room at the end.
#[derive(Clone, Debug, Default)]
pub(in crate::neighbor) struct Candidates {
    pub(in crate::neighbor) distances: Vec<f32>,
    pub(in crate::neighbor) ids: Vec<u32>,
    pub(in crate::neighbor) count: usize,
    raw: Vec<f32>,
    /// Leaves still to be looked at.
    leaves: Vec<u32>,
    waiting: usize,
    pub(in crate::neighbor) packed: Vec<u64>,
}

impl Candidates {
    /// Makes room for `more` candidates and a vector.
    #[inline(always)]
    pub(in crate::neighbor) fn reserve(&mut self, more: usize) {
        if self.count + more + LANES > self.distances.len() {
            self.grow(more);
        }
    }

    #[cold]
    fn grow(&mut self, more: usize) {
        let size = (2 * (self.count + more + LANES)).next_multiple_of(LANES);
        self.distances.resize(size, 0.0);
        self.ids.resize(size, 0);
        self.raw.resize(size, 0.0);
    }

    /// Appends the lanes of a mask; there must be room.
    #[inline(always)]
    pub(in crate::neighbor) fn push<S: Simd>(&mut self, s: S, distance: S::F, id: S::U, mask: u16) {
        self.count = append(s, &mut self.distances, &mut self.ids, self.count, (distance, id), mask);
    }

    /// Overwrites sixteen distances.
    #[inline(always)]
    fn write<S: Simd>(&mut self, s: S, at: usize, distance: S::F) {
        let to: &mut [f32; LANES] = (&mut self.raw[at..at + LANES]).try_into().expect("sixteen");
        s.store(distance, to);
    }

    /// Drops everything above the threshold. What follows the last candidate up to a whole vector is above it.
    #[inline(always)]
    fn retain<S: Simd>(&mut self, s: S, threshold: f32) {
        let count = core::mem::take(&mut self.count);
        for at in (0..count).step_by(LANES) {
            let distance = s.load(lanes_at(&self.distances, at));
            let id = s.load_u(lanes_at(&self.ids, at));
            self.push(s, distance, id, s.le(distance, s.splat(threshold)));
        }
    }

    /// Keeps the k least pairs and returns the greatest distance among them. For sets with so many
    /// equal distances that no threshold tells them apart.
    #[cold]
    #[inline(never)]
    fn retain_exactly(&mut self, k: usize) -> f32 {
        let pairs = self.distances.iter().zip(&self.ids).take(self.count);
        self.packed.clear();
        self.packed.extend(pairs.map(|(&distance, &id)| pack(distance, id)));
        let (_, &mut last, _) = self.packed.select_nth_unstable(k - 1);
        for (i, &key) in self.packed[..k].iter().enumerate() {
            let pair = unpack_pair(key);
            (self.distances[i], self.ids[i]) = (pair.distance_squared, pair.id);
        }
        self.count = k;
        unpack_pair(last).distance_squared
    }
}

/// Writes the lanes of a mask from place `end` on and returns the new end. (With the end apart from the buffers it
/// stays in a register.)
#[inline(always)]
fn append<S: Simd>(
    s: S,
    distances: &mut [f32],
    ids: &mut [u32],
    end: usize,
    (distance, id): (S::F, S::U),
    mask: Mask,
) -> usize {
    let to: &mut [f32; LANES] = (&mut distances[end..end + LANES]).try_into().expect("sixteen");
    s.store(s.compress(distance, mask), to);
    let to: &mut [u32; LANES] = (&mut ids[end..end + LANES]).try_into().expect("sixteen");
    s.store_u(s.compress_u(id, mask), to);
    end + mask.count_ones() as usize
}

/// The first `count` lanes; all where there are more than that many.
#[inline(always)]
pub(in crate::neighbor) fn there(count: usize) -> Mask {
    if count < LANES { (1 << count) - 1 } else { Mask::MAX }
}

/// The search for k nearest.
pub(in crate::neighbor) struct KNearest<'a, K, O> {
    k: usize,
    /// What is farther than this can not be an answer.
    threshold: f32,
    cull: f32,
    shrink: f32,
    candidates: &'a mut Candidates,
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
        candidates.waiting = 0;
        if candidates.leaves.is_empty() {
            candidates.leaves.resize(DEFER + 2 * LANES, 0);
        }
        KNearest { k, threshold: bound, cull: bound * shrink, shrink, candidates, keep, observe }
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

    /// Puts leaves on the list.
    #[inline(always)]
    fn wait<S: Simd, V: View>(&mut self, s: S, view: &V, first: usize, lanes: Mask) {
        let Candidates { leaves, waiting, .. } = &mut *self.candidates;
        let to: &mut [u32; LANES] = (&mut leaves[*waiting..*waiting + LANES]).try_into().expect("sixteen");
        let offsets = s.load_u(&OFFSETS[view.leaf_blocks() - 1]);
        s.store_u(s.compress_u(s.add_u(s.splat_u(first as u32), offsets), lanes), to);
        *waiting += lanes.count_ones() as usize;
    }

    /// Looks at the leaves on the list.
    #[inline(always)]
    fn look<S: Simd, V: View>(&mut self, s: S, view: &V, target: &Target<S>) {
        let waiting = core::mem::take(&mut self.candidates.waiting);
        let blocks = view.leaf_blocks();
        self.candidates.reserve(waiting * blocks * LANES);
        let limit = s.splat(self.threshold);
        let Candidates { distances, ids, leaves, count, .. } = &mut *self.candidates;
        let mut end = *count;
        for &leaf in &leaves[..waiting] {
            let leaf = leaf as usize;
            for block in leaf..leaf + blocks {
                self.observe.block();
                let distance = view.point_distances(s, target, block);
                let names = view.ids(block);
                let under = kept(self.keep, names, s.le(distance, limit));
                end = append(s, distances, ids, end, (distance, s.load_u(names)), under);
            }
        }
        *count = end;
        if self.candidates.count > self.limit() {
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
            let mut column = [0; LANES];
            s.store_u(sort_lanes(s, s.to_bits(least)), &mut column);
            let kth = f32::from_bits(column[self.k - 1]);
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

const MOST_COLUMNS: usize = 10;
const DEFER: usize = 16;
const OFFSETS: [[u32; LANES]; 2] = [LANE, [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30]];

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
            self.wait(s, view, first, within);
            if self.candidates.waiting > DEFER {
                self.look(s, view, target);
            }
            return;
        }
        self.candidates.reserve(LANES * LANES * view.leaf_blocks());
        // As many of the nearest leaves as hold three times what is wanted; with a threshold from
        // them few of the others are needed.
        let enough = (3 * self.k.min(1 << 20)).div_ceil(LANES * view.leaf_blocks()) + usize::from(self.k <= MOST_COLUMNS);
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
        self.wait(s, view, first, s.le(boxes, s.splat(self.cull)) & within & !chosen);
        // A threshold from columns is tight already.
        if self.candidates.count < self.k || self.k > MOST_COLUMNS {
            self.look(s, view, target);
        }
    }

    #[inline(always)]
    fn end<V: View>(&mut self, s: S, view: &V, target: &Target<S>) {
        if self.candidates.waiting > 0 {
            self.look(s, view, target);
        }
    }
}

