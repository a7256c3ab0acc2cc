//! The threshold of a k-nearest search: points beyond it are no answers.
//!
//! It is sought beyond the distance of the nearest leaf: from far away all distances are about that, and one in proportion to the
//! whole distance would have all points below it or none.

use crate::simd::{LANES, Simd, lanes_at};

/// How often a threshold is estimated before the search continues without.
const GUESSES: u32 = 3;

/// The largest k for which it is estimated: beyond, there may well be fewer than k points, and an estimate that is too
/// small costs much.
const MOST_GUESSED: usize = 1 << 12;

/// The origin of a threshold.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Origin {
    /// Given by the caller; it may be far too large.
    Caller,
    /// Estimated: fewer than k points may lie within it.
    Guess,
    /// Confirmed by k points that lie within it, or given by the caller and less than the estimate.
    Known,
}

/// The threshold of a search for the k nearest points, and what is known for the next one.
#[derive(Clone, Copy)]
pub(super) struct Threshold {
    pub(super) k: usize,
    /// Points farther than this are no answers.
    pub(super) distance: f32,
    pub(super) origin: Origin,
    /// Of points exactly at the threshold, those with greater ids are no answers: k others are known.
    pub(super) last: u32,
    /// Boxes beyond this are culled: the threshold, or less if answers may be approximate and k points are
    /// within it.
    pub(super) cull: f32,
    /// The caller's bound.
    bound: f32,
    /// The squared distance of the nearest leaf in the first bottom node: about the least that there is, and far from zero if the
    /// query is far from all points.
    nearest: f32,
    shrink: f32,
    /// How often a threshold may still be estimated, and a factor on the next estimate.
    pub(super) guesses: u32,
    pub(super) scale: f32,
}

impl Threshold {
    /// The caller's bound.
    #[inline(always)]
    pub(super) fn new(k: usize, bound: f32, shrink: f32) -> Threshold {
        Threshold {
            // As good as any larger number, and small multiples of it do not overflow.
            k: k.min(usize::MAX / 4),
            distance: bound,
            origin: Origin::Caller,
            last: u32::MAX,
            cull: bound,
            bound,
            nearest: 0.0,
            shrink,
            guesses: if k <= MOST_GUESSED { GUESSES } else { 0 },
            scale: 1.0,
        }
    }

    /// Whether the estimate was too small, given the number of points found: then it is the caller's bound again.
    #[inline(always)]
    pub(super) fn retry(&mut self, found: usize) -> bool {
        let retry = self.origin == Origin::Guess && found < self.k;
        if retry {
            self.guesses -= 1;
            self.scale = scaled(self.scale, 1.5 * self.expected_in_ball(), found as f32);
            self.origin = Origin::Caller;
            (self.distance, self.cull) = (self.bound, self.bound);
        }
        retry
    }

    /// Sets it to one that k points are within, or are expected to be. The caller's bound is not shrunk:
    /// boxes within it may hold one of the first k points.
    #[inline(always)]
    pub(super) fn set(&mut self, distance: f32) {
        self.distance = distance;
        self.last = u32::MAX;
        self.cull = distance * self.shrink;
    }

    /// The number of points that the estimated ball should hold, such that it seldom holds fewer than k.
    #[inline(always)]
    pub(super) fn expected_in_ball(&self) -> f32 {
        let k = self.k as f32;
        k + 1.5 * k.sqrt()
    }

    /// The number of candidates above which the threshold is lowered.
    #[inline(always)]
    pub(super) fn most(&self) -> usize {
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
    pub(super) fn find<S: Simd>(&self, s: S, distances: &[f32], guess: f32) -> Option<f32> {
        let enough = self.k + self.k / 2 + 4;
        let aim = self.aim();
        // `low` has fewer than k below it, `high` too many.
        let (mut low, mut high) = (-1.0f32, self.distance);
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
                found = (under <= self.most()).then_some(threshold);
                if under <= enough {
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

    /// An initial guess for the first threshold if none was estimated, from at least k distances.
    #[inline(always)]
    pub(super) fn first<S: Simd>(&self, s: S, distances: &[f32]) -> f32 {
        let whole = distances.len() / LANES * LANES;
        let mut sum = s.splat(0.0);
        for at in (0..whole).step_by(LANES) {
            sum = sum + s.load(lanes_at(distances, at));
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
    pub(super) fn set_nearest(&mut self, near: f32) {
        self.nearest = if near < f32::INFINITY { near } else { 0.0 };
    }

    /// A threshold that somewhat fewer points are below.
    #[inline(always)]
    pub(super) fn lower(&self, threshold: f32) -> f32 {
        threshold - 0.25 * (threshold - self.nearest).max(0.0)
    }
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
