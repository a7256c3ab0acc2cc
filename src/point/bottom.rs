//! Ordering the few hundred points below a bottom node, a vector of them at a time.
//!
//! Points lie in rows. Of a range the widest axis is found, then a threshold below which the left part's coordinates are,
//! by counting what is below a guess and guessing again, and then every vector is compressed twice: what is on the left
//! to the front of the same rows, the rest to spare ones that are copied behind it. Nothing is overwritten before it is read, because no
//! more is written to the front than was read. A range has whole vectors, and so have its parts.

use super::complete_tree::left_part;
use crate::simd::{Item, Kernel, LANES, Lanes, Mask, Simd, lanes_at};

/// Most points that are ordered here: those below a bottom node whose leaves have two vectors.
pub(super) const MOST: usize = 2 * LANES * LANES;

/// Guesses before coordinates are gone through one after the other, from the best lower guess.
///
/// Evenly spread points take four to six.
const GUESSES: usize = 10;

/// Orders points whose number is a multiple of [`LANES`] and at most [`MOST`], as `order` does.
pub(super) struct Bottom<'a> {
    pub(super) items: &'a mut [Item],
    /// Points per leaf, one or two vectors of them.
    pub(super) leaf: usize,
}

impl Kernel for Bottom<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (mut rows, mut spare) = (Rows::<MOST>::EMPTY, Rows::EMPTY);
        for (i, item) in self.items.iter().enumerate() {
            rows.set(i, item);
        }
        // Ranges whose turn has not come: at most one for each halving, of which there are four.
        let mut open = [(0, self.items.len()); LANES];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (begin, end) = open[count];
            if end - begin > self.leaf {
                let middle = begin + left_part(end - begin, self.leaf);
                rows.split(s, (begin, middle, end), &mut spare);
                open[count] = (begin, middle);
                open[count + 1] = (middle, end);
                count += 2;
            }
        }
        for (i, item) in self.items.iter_mut().enumerate() {
            *item = rows.get(i);
        }
    }
}

/// Room for the right part of a range, which is not the larger one, and to the end of a vector behind it.
const SPARE: usize = MOST / 2 + LANES;

/// Points in rows.
struct Rows<const N: usize> {
    at: [[f32; N]; 3],
    index: [u32; N],
}

impl<const N: usize> Rows<N> {
    const EMPTY: Rows<N> = Rows { at: [[0.0; N]; 3], index: [0; N] };

    #[inline(always)]
    fn set(&mut self, i: usize, item: &Item) {
        let [x, y, z] = &mut self.at;
        (x[i], y[i], z[i], self.index[i]) = (item.at[0], item.at[1], item.at[2], item.index);
    }

    #[inline(always)]
    fn get(&self, i: usize) -> Item {
        let [x, y, z] = &self.at;
        Item { at: [x[i], y[i], z[i]], index: self.index[i] }
    }

    /// Brings the lowest coordinates along the widest axis of `begin..end` into `begin..middle`.
    #[inline(always)]
    fn split<S: Simd>(&mut self, s: S, (begin, middle, end): (usize, usize, usize), spare: &mut Rows<SPARE>) {
        let (axis, least, most) = self.widest_axis(s, begin, end);
        let keys = self.at[axis][begin..end].as_chunks().0;
        let (bound, mut equal) = threshold(s, keys, middle - begin, (least, most));
        let bound = s.splat(bound);
        let (mut left, mut right) = (begin, 0);
        for from in (begin..end).step_by(LANES) {
            let key = s.load(lanes_at(&self.at[axis], from));
            let mut below = s.lt(key, bound);
            if equal > 0 {
                let ties = first_lanes(s.eq(key, bound), equal);
                equal -= ties.count_ones() as usize;
                below |= ties;
            }
            let [x, y, z] = &self.at;
            let at = [s.load(lanes_at(x, from)), s.load(lanes_at(y, from)), s.load(lanes_at(z, from))];
            let index = s.load_u(lanes_at(&self.index, from));
            self.write(s, left, (at, index), below);
            spare.write(s, right, (at, index), !below);
            left += below.count_ones() as usize;
            right += (!below).count_ones() as usize;
        }
        for (from, to) in (middle..end).step_by(LANES).enumerate() {
            for axis in 0..3 {
                let key = s.load(lanes_at(&spare.at[axis], from * LANES));
                s.store(key, lanes_at_mut(&mut self.at[axis], to));
            }
            s.store_u(s.load_u(lanes_at(&spare.index, from * LANES)), lanes_at_mut(&mut self.index, to));
        }
    }

    /// The axis along which a range spreads most, and its least and greatest coordinate there.
    #[inline(always)]
    fn widest_axis<S: Simd>(&self, s: S, begin: usize, end: usize) -> (usize, f32, f32) {
        let (mut least, mut most) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            let keys: &[Lanes<f32>] = self.at[axis][begin..end].as_chunks().0;
            let mut lo = s.load(&keys[0]);
            let mut hi = lo;
            for key in &keys[1..] {
                let key = s.load(key);
                (lo, hi) = (s.min(key, lo), s.max(key, hi));
            }
            (least[axis], most[axis]) = (least_lane(s, lo), -least_lane(s, s.splat(0.0) - hi));
        }
        let size = |axis: usize| most[axis] - least[axis];
        let yz = if size(1) >= size(2) { 1 } else { 2 };
        let axis = if size(0) >= size(yz) { 0 } else { yz };
        (axis, least[axis], most[axis])
    }

    /// Writes the lanes of a mask to place `at` and on, and anything to the rest of a vector there.
    #[inline(always)]
    fn write<S: Simd>(&mut self, s: S, at: usize, ([x, y, z], index): ([S::F; 3], S::U), mask: Mask) {
        let [to_x, to_y, to_z] = &mut self.at;
        s.store_compressed(x, mask, lanes_at_mut(to_x, at));
        s.store_compressed(y, mask, lanes_at_mut(to_y, at));
        s.store_compressed(z, mask, lanes_at_mut(to_z, at));
        s.store_compressed_u(index, mask, lanes_at_mut(&mut self.index, at));
    }
}

/// What divides the `count` lowest keys from the others: those below a bound, and so many of those equal to it. `least`
/// and `most` are the least and the greatest key, which must be numbers.
#[inline(always)]
fn threshold<S: Simd>(s: S, keys: &[Lanes<f32>], count: usize, (least, most): (f32, f32)) -> (f32, usize) {
    // So many keys are below `lo`, and so many, or fewer, below `hi`.
    let (mut lo, mut below) = (least, 0);
    let (mut hi, mut not_above) = (most, keys.len() * LANES);
    for guess in 1..=GUESSES {
        // Where keys are evenly spread in between; each third time in the middle, in case they are not.
        let share = if guess % 3 == 0 { 0.5 } else { (count - below) as f32 / (not_above - below) as f32 };
        let at = lo + (hi - lo) * share;
        if !(lo < at && at < hi) {
            break;
        }
        let found = counted(s, keys, at).0;
        if found == count {
            return (at, 0);
        }
        if found < count { (lo, below) = (at, found) } else { (hi, not_above) = (at, found) }
    }
    // One key after the other: it ends with the greatest one at the latest.
    loop {
        let mut next = s.splat(f32::INFINITY);
        for key in keys {
            let key = s.load(key);
            next = s.select(s.le(s.splat(lo), key), s.min(key, next), next);
        }
        let key = least_lane(s, next);
        let (found, with_equal) = counted(s, keys, key);
        if with_equal >= count || key >= most {
            return (key, count - found);
        }
        lo = key.next_up();
    }
}

/// How many keys are below a bound, and how many are not above it.
#[inline(always)]
fn counted<S: Simd>(s: S, keys: &[Lanes<f32>], bound: f32) -> (usize, usize) {
    let (bound, mut below, mut not_above) = (s.splat(bound), 0, 0);
    for key in keys {
        let key = s.load(key);
        below += s.lt(key, bound).count_ones() as usize;
        not_above += s.le(key, bound).count_ones() as usize;
    }
    (below, not_above)
}

/// The least lane.
#[inline(always)]
fn least_lane<S: Simd>(s: S, a: S::F) -> f32 {
    let a = s.min(a, s.swap_lanes::<8>(a));
    let a = s.min(a, s.swap_lanes::<4>(a));
    let a = s.min(a, s.swap_lanes::<2>(a));
    s.lane(s.min(a, s.swap_lanes::<1>(a)), 0)
}

/// The first `count` lanes of a mask, or all of them.
#[inline(always)]
fn first_lanes(mask: Mask, count: usize) -> Mask {
    let mut rest = mask;
    for _ in 0..count.min(LANES) {
        rest &= rest.wrapping_sub(1);
    }
    mask & !rest
}

/// Sixteen elements of `to`, beginning at `at`.
#[inline(always)]
fn lanes_at_mut<T>(to: &mut [T], at: usize) -> &mut Lanes<T> {
    (&mut to[at..at + LANES]).try_into().expect("a slice of sixteen")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::simd::{SimdLevel, dispatch};

    /// The same on every instruction set, all points still there, and each half below the other along some axis.
    fn check(items: &[Item], leaf: usize) {
        let mut orders = Vec::new();
        for level in SimdLevel::available() {
            let mut items = items.to_vec();
            dispatch(level, Bottom { items: &mut items, leaf });
            orders.push(items);
        }
        for order in &orders {
            let indices = |items: &[Item]| items.iter().map(|item| item.index).collect::<Vec<_>>();
            assert_eq!(indices(order), indices(&orders[0]));
            let mut seen = indices(order);
            seen.sort_unstable();
            assert!(seen.into_iter().eq(0..items.len() as u32));
            assert!(order.iter().all(|item| item.at == items[item.index as usize].at));
        }
        separated(&orders[0], leaf);
    }

    fn separated(items: &[Item], leaf: usize) {
        if items.len() <= leaf {
            return;
        }
        let (left, right) = items.split_at(left_part(items.len(), leaf));
        let apart = |axis: usize| {
            let most = left.iter().map(|item| item.at[axis]).fold(f32::MIN, f32::max);
            right.iter().all(|item| item.at[axis] >= most)
        };
        assert!((0..3).any(apart), "{} points", items.len());
        separated(left, leaf);
        separated(right, leaf);
    }

    #[test]
    fn halves_are_apart_however_points_lie() {
        let mut random = Random(5);
        // Evenly, on a lattice, over many magnitudes, all at one place, two zeros, and one far from all others.
        let kinds: [fn(&mut Random) -> f32; 6] = [
            |random| random.signed(),
            |random| (random.signed() * 2.0).floor(),
            |random| (random.signed() * 60.0).exp2() * random.signed(),
            |_| 3.5,
            |random| if random.signed() < 0.0 { -0.0 } else { 0.0 },
            |random| if random.signed() > 0.99 { 1e18 } else { 1e-18 * random.signed() },
        ];
        for leaf in [LANES, 2 * LANES] {
            for vectors in [1, 2, 3, 7, 16, 31, 32] {
                let count = (vectors * LANES).min(leaf * LANES) as u32;
                for kind in kinds {
                    let at = |random: &mut Random| core::array::from_fn(|_| kind(random));
                    let items: Vec<Item> = (0..count).map(|index| Item { at: at(&mut random), index }).collect();
                    check(&items, leaf);
                }
            }
        }
    }

    #[test]
    fn thresholds_count_ties() {
        struct Threshold<'a>(&'a [Lanes<f32>], usize);
        impl Kernel for Threshold<'_> {
            type Output = (f32, usize);
            #[inline(always)]
            fn run<S: Simd>(self, s: S) -> (f32, usize) {
                threshold(s, self.0, self.1, (0.0, 31.0))
            }
        }
        let even: [Lanes<f32>; 2] = core::array::from_fn(|v| core::array::from_fn(|i| (16 * v + i) as f32));
        for level in SimdLevel::available() {
            let (bound, equal) = dispatch(level, Threshold(&even, 16));
            assert!(15.0 < bound && bound <= 16.0 && equal == 0, "{bound} {equal}");
            let mut ties = even;
            ties[0] = [7.0; LANES];
            ties[0][0] = 0.0;
            assert_eq!(dispatch(level, Threshold(&ties, 5)), (7.0, 4));
        }
    }
}
