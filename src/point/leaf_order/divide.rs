//! Dividing many points at a coordinate, a vector of them at a time.
//!
//! The coordinate is found first. Among few points it is guessed, and what is below a guess is counted. Among many, the two
//! between which it must be are taken from a sample, the keys between them are set apart while the others are counted, and only
//! among those few it is looked for. Then each vector of points is compressed twice, into the side before and the side behind
//! it. The positions of both sides are known, points stay in the order in which they were, so the result is the same however many
//! threads do it. Points are read from one set of rows and written to another.

use super::point_rows::PointRows;
use super::selection::{counted, extremes, guess, lowest_lanes, with_ties};
use super::widest_axis::widest_axis;
use crate::parallel;
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch, lanes_at, lanes_at_mut};

/// Points that one thread divides at a time. A whole number of vectors.
const SHARE: usize = 1 << 15;

/// Keys of a sample: at most so many, and one of [`KEYS_PER`].
const KEYS: usize = 1024;

/// Up to so many keys, which stay in the L1 cache, are counted a few times instead: that costs less than a sample.
const FEW: usize = 4096;

/// See [`KEYS`].
const KEYS_PER: usize = 32;

/// Writes the points of `from` to `to` so that no coordinate of the first `count` along the widest axis is above one of the others.
///
/// Both consist of whole vectors, and `count` is less than their length. There may be infinite coordinates behind, on
/// all axes at once.
pub(in crate::point) fn divide(from: &PointRows, count: usize, to: &mut PointRows) {
    let axis = widest_axis(from.len(), |i| from.get(i).at);
    divide_by(from, &*from.at[axis], count, to);
}

/// The same by any keys, one for each point; those behind the last point are infinite.
pub(in crate::point) fn divide_by(from: &PointRows, keys: &[f32], count: usize, to: &mut PointRows) {
    let level = SimdLevel::best();
    let (bound, equal) = dispatch(level, Threshold { keys, count, scratch: to.at[0] });
    let (mut low, mut high) = to.borrow().split_at(count);
    if parallel::threads() == 1 || keys.len() <= SHARE {
        let (low, high) = (low.borrow(), high.borrow());
        return dispatch(level, DivideRange { from, range: [0, keys.len()], keys, bound, equal, low, high });
    }
    let counts = parallel::map(keys.len().div_ceil(SHARE), |share| {
        let keys = &keys[share * SHARE..keys.len().min((share + 1) * SHARE)];
        dispatch(level, Count { keys, bound })
    });
    let (mut shares, mut equal, mut begin) = (Vec::with_capacity(counts.len()), equal, 0);
    for (below, with_equal) in counts {
        let end = keys.len().min(begin + SHARE);
        let own = equal.min(with_equal - below);
        let (own_low, more_low) = low.split_at(below + own);
        let (own_high, more_high) = high.split_at(end - begin - below - own);
        shares.push(Some(DivideRange {
            from,
            range: [begin, end],
            keys,
            bound,
            equal: own,
            low: own_low,
            high: own_high,
        }));
        (low, high, equal, begin) = (more_low, more_high, equal - own, end);
    }
    parallel::each(&mut shares, |share| share.take().map(|share| dispatch(level, share)));
}

/// What divides the `count` lowest keys from the others: those below a bound, and so many of those equal to it.
struct Threshold<'a> {
    keys: &'a [f32],
    count: usize,
    /// As long as the keys.
    scratch: &'a mut [f32],
}

impl Kernel for Threshold<'_> {
    type Output = (f32, usize);
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> (f32, usize) {
        let Threshold { keys, count, scratch } = self;
        if keys.len() <= FEW {
            let vectors = keys.as_chunks().0;
            if let Ok(found) = guess(s, vectors, count, extremes(s, vectors)) {
                return found;
            }
        }
        let (lo, hi) = bracket(keys, count);
        let (mut below, mut inside) = between(s, keys, (lo, hi), scratch);
        if !(below..below + inside).contains(&(count - 1)) {
            scratch.copy_from_slice(keys);
            (below, inside) = (0, keys.len());
        }
        let whole = inside.next_multiple_of(LANES);
        scratch[inside..whole].fill(f32::INFINITY);
        let vectors = scratch[..whole].as_chunks().0;
        if let Ok(found) = guess(s, vectors, count - below, extremes(s, vectors)) {
            return found;
        }
        // The last key on the left, how many of those set apart are less, and how many are equal.
        let rank = count - 1 - below;
        let (lower, &mut key, higher) = scratch[..inside]
            .select_nth_unstable_by(rank, |a, b| a.partial_cmp(b).unwrap_or(core::cmp::Ordering::Equal));
        let less = lower.iter().filter(|&&other| other < key).count();
        let equal = inside - less - higher.iter().filter(|&&other| other > key).count();
        let wanted = count - below - less;
        with_ties(key, wanted, equal)
    }
}

/// Two keys of a sample between which the one of this rank very likely is: three standard deviations from where it is in the
/// sample.
fn bracket(keys: &[f32], count: usize) -> (f32, f32) {
    let step = (keys.len() / KEYS).max(KEYS_PER);
    let mut sample = [0.0; 2 * KEYS];
    let sample = &mut sample[..keys.len().div_ceil(step).min(2 * KEYS)];
    sample.iter_mut().zip(keys.iter().step_by(step)).for_each(|(to, key)| *to = *key);
    let (rank, margin) = (count / step, (1.5 * (sample.len() as f32).sqrt()) as usize + 1);
    let compare = |a: &f32, b: &f32| a.partial_cmp(b).unwrap_or(core::cmp::Ordering::Equal);
    let (lo, mut rest) = (rank.checked_sub(margin), sample);
    let mut begin = 0;
    let lo = lo.map_or(f32::NEG_INFINITY, |lo| {
        let (_, &mut key, behind) = core::mem::take(&mut rest).select_nth_unstable_by(lo, compare);
        (rest, begin) = (behind, lo + 1);
        key
    });
    let hi = rank + margin - begin;
    (lo, if hi < rest.len() { *rest.select_nth_unstable_by(hi, compare).1 } else { f32::INFINITY })
}

/// Vectors of which it is found out first what is written where, so that reading does not wait for writing.
const AHEAD: usize = 32;

/// How many keys are below `lo`, and how many from there to `hi`, which are copied.
#[inline(always)]
fn between<S: Simd>(s: S, keys: &[f32], (lo, hi): (f32, f32), to: &mut [f32]) -> (usize, usize) {
    let (lo, hi) = (s.splat(lo), s.splat(hi));
    let (mut below, mut inside) = (0, 0);
    let keys: &[Lanes<f32>] = keys.as_chunks().0;
    let mut masks = [0; AHEAD];
    for keys in keys.chunks(AHEAD) {
        for (mask, key) in masks.iter_mut().zip(keys) {
            let key = s.load(key);
            let less = s.lt(key, lo);
            below += less.count_ones() as usize;
            *mask = s.le(key, hi) & !less;
        }
        for (&mask, key) in masks.iter().zip(keys) {
            // No more is written than was read.
            s.store_compressed(s.load(key), mask, lanes_at_mut(to, inside));
            inside += mask.count_ones() as usize;
        }
    }
    (below, inside)
}

/// How many keys are below a bound, and how many are not above it.
struct Count<'a> {
    keys: &'a [f32],
    bound: f32,
}

impl Kernel for Count<'_> {
    type Output = (usize, usize);
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> (usize, usize) {
        counted(s, self.keys.as_chunks().0, self.bound)
    }
}

/// Divides a range of the points.
struct DivideRange<'a, 'b> {
    from: &'a PointRows<'a>,
    range: [usize; 2],
    /// The keys of all points.
    keys: &'a [f32],
    /// What is below goes to `low`, and so do the first `equal` of those that are equal.
    bound: f32,
    equal: usize,
    low: PointRows<'b>,
    high: PointRows<'b>,
}

impl Kernel for DivideRange<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let DivideRange { from, range: [begin, end], keys, bound, mut equal, mut low, mut high } = self;
        let bound = s.splat(bound);
        let (mut left, mut right) = (0, 0);
        let mut masks = [0; AHEAD];
        for begin in (begin..end).step_by(AHEAD * LANES) {
            let vectors = (begin..end.min(begin + AHEAD * LANES)).step_by(LANES);
            for (mask, at) in masks.iter_mut().zip(vectors.clone()) {
                let key = s.load(lanes_at(keys, at));
                *mask = s.lt(key, bound);
                if equal > 0 {
                    let ties = lowest_lanes(s.eq(key, bound), equal);
                    equal -= ties.count_ones() as usize;
                    *mask |= ties;
                }
            }
            for (&below, at) in masks.iter().zip(vectors) {
                let points = from.vector(s, at);
                low.store_compressed_only(s, left, &points, below);
                high.store_compressed_only(s, right, &points, !below);
                left += below.count_ones() as usize;
                right += (!below).count_ones() as usize;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::simd::Item;

    /// Divided so, on every instruction set: all points still there, in the order in which they were.
    fn check(items: &[Item], count: usize) {
        let mut memory = [PointRows::memory(items.len()), PointRows::memory(items.len())];
        let [from, to] = &mut memory;
        let mut from = PointRows::in_blocks(from, items.len());
        from.take(items.iter().copied());
        let mut to = PointRows::in_blocks(to, items.len());
        divide(&from, count, &mut to);
        let axis = widest_axis(from.len(), |i| from.get(i).at);
        let divided: Vec<Item> = (0..to.len()).map(|i| to.get(i)).collect();
        let (low, high) = divided.split_at(count);
        let key = |item: &Item| item.at[axis];
        let most = low.iter().map(key).fold(f32::NEG_INFINITY, f32::max);
        assert!(high.iter().all(|item| key(item) >= most));
        for half in [low, &high[..items.len() - count]] {
            assert!(half.windows(2).all(|two| two[0].index < two[1].index));
            assert!(half.iter().all(|item| item.at == items[item.index as usize].at));
        }
        for level in SimdLevel::available() {
            let mut scratch = vec![f32::NAN; from.len()];
            let (bound, equal) = dispatch(level, Threshold { keys: from.at[axis], count, scratch: &mut scratch });
            let (below, not_above) = dispatch(level, Count { keys: from.at[axis], bound });
            assert!(below + equal == count && count <= not_above);
            let mut memory = PointRows::memory(items.len());
            let mut other = PointRows::in_blocks(&mut memory, items.len());
            let range = [0, from.len()];
            let (low, high) = other.borrow().split_at(count);
            dispatch(level, DivideRange { from: &from, range, keys: from.at[axis], bound, equal, low, high });
            assert!((0..other.len()).all(|i| other.get(i).index == divided[i].index));
        }
    }

    #[test]
    fn parts_are_separated_and_stay_in_order() {
        let mut random = Random(4);
        for total in [17usize, 32, 640, 5000, 40_000, 100_003] {
            let whole = total.div_ceil(LANES) / 2 * LANES;
            let coarse = 1.0 + (total % 7) as f32;
            for kind in 0..4 {
                let items: Vec<Item> = (0..total as u32)
                    .map(|index| {
                        let at = [random.unit(), random.unit(), random.unit()];
                        let at = match kind {
                            0 => at,
                            1 => at.map(|x| (x * coarse).floor()),
                            2 => [(at[0] * 60.0).exp2() - 1e9, at[1], at[2]],
                            _ => [if index % 3 == 0 { 0.0 } else { -0.0 }, 0.0, 0.0],
                        };
                        Item { at, index }
                    })
                    .collect();
                check(&items, whole.max(LANES));
                check(&items, LANES);
            }
        }
    }
}
