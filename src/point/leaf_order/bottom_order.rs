//! Ordering the few hundred points below a bottom node, a vector of them at a time.
//!
//! Points lie in rows. To halve a range: find its widest axis; find a threshold by repeated counting; compress each vector
//! twice, left points to the front, right points to a spare buffer that is copied behind them. Nothing is overwritten before
//! it is read, because no more is written to the front than was read. A range has whole vectors, and so have its halves.

use super::complete_tree::left_part;
use super::point_rows::{NO_POINT, PointRows, PointVector, item, set_item, store_compressed, vector};
use super::selection::{extremes, lowest_lanes, threshold};
use super::widest_axis::longest;
use crate::simd::{Item, Kernel, LANES, Mask, Simd, SimdLevel, dispatch, lanes_at, lanes_at_mut};

/// Most points that are ordered here: those below a bottom node whose leaves have two vectors.
pub(in crate::point) const MOST: usize = 2 * LANES * LANES;

/// Room for the right half of a range, which is not the larger one, and to the end of a vector behind it.
pub(in crate::point) const SPARE: usize = MOST / 2 + LANES;

/// Points in rows.
pub(in crate::point) struct Rows<const N: usize> {
    pub(in crate::point) at: [[f32; N]; 3],
    pub(in crate::point) index: [u32; N],
}

impl<const N: usize> Rows<N> {
    pub(in crate::point) const EMPTY: Rows<N> = Rows { at: [[0.0; N]; 3], index: [0; N] };

    #[inline(always)]
    pub(in crate::point) fn set(&mut self, i: usize, item: &Item) {
        let [x, y, z] = &mut self.at;
        set_item([x, y, z], &mut self.index, i, item);
    }

    #[inline(always)]
    pub(in crate::point) fn get(&self, i: usize) -> Item {
        let [x, y, z] = &self.at;
        item([x, y, z], &self.index, i)
    }

    /// Takes `count` points of other rows, from number `first` on.
    #[inline(always)]
    pub(in crate::point) fn take(&mut self, from: &PointRows, first: usize, count: usize) {
        let range = first..first + count;
        for (to, from) in self.at.iter_mut().zip(&from.at) {
            to[..count].copy_from_slice(&from[range.clone()]);
        }
        self.index[..count].copy_from_slice(&from.index[range]);
    }

    /// The sixteen points from `at` on.
    #[inline(always)]
    pub(in crate::point) fn vector<S: Simd>(&self, s: S, at: usize) -> PointVector<S> {
        let [x, y, z] = &self.at;
        vector(s, [x, y, z], &self.index, at)
    }

    /// Writes sixteen points to index `at` and on.
    #[inline(always)]
    pub(in crate::point) fn store<S: Simd>(&mut self, s: S, at: usize, points: &PointVector<S>) {
        for (row, &lanes) in self.at.iter_mut().zip(&points.at) {
            s.store(lanes, lanes_at_mut(row, at));
        }
        s.store_u(points.index, lanes_at_mut(&mut self.index, at));
    }

    /// Brings the lowest coordinates along the widest axis of `begin..end` into `begin..middle`.
    #[inline(always)]
    fn split<S: Simd>(&mut self, s: S, (begin, middle, end): (usize, usize, usize), spare: &mut Rows<SPARE>) {
        let (axis, least, most) = self.widest_axis(s, begin, end);
        let keys = self.at[axis][begin..end].as_chunks().0;
        let (bound, mut equal) = threshold(s, keys, middle - begin, (least, most));
        let bound = s.splat(bound);
        let (mut left, mut right) = (begin, 0);
        // What goes where is found out first, so that reading does not wait for writing.
        let mut masks = [0; MOST / LANES];
        for (mask, from) in masks.iter_mut().zip((begin..end).step_by(LANES)) {
            let key = s.load(lanes_at(&self.at[axis], from));
            *mask = s.lt(key, bound);
            if equal > 0 {
                let ties = lowest_lanes(s.eq(key, bound), equal);
                equal -= ties.count_ones() as usize;
                *mask |= ties;
            }
        }
        for (&below, from) in masks.iter().zip((begin..end).step_by(LANES)) {
            let points = self.vector(s, from);
            self.write(s, left, &points, below);
            spare.write(s, right, &points, !below);
            left += below.count_ones() as usize;
            right += (!below).count_ones() as usize;
        }
        for (from, to) in (middle..end).step_by(LANES).enumerate() {
            let points = spare.vector(s, from * LANES);
            self.store(s, to, &points);
        }
    }

    /// The axis along which a range spreads most, and its least and greatest coordinate there.
    #[inline(always)]
    fn widest_axis<S: Simd>(&self, s: S, begin: usize, end: usize) -> (usize, f32, f32) {
        let (mut least, mut most) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            (least[axis], most[axis]) = extremes(s, self.at[axis][begin..end].as_chunks().0);
        }
        let axis = longest([most[0] - least[0], most[1] - least[1], most[2] - least[2]]);
        (axis, least[axis], most[axis])
    }

    /// Writes the lanes of a mask to index `at` and on, and anything to the rest of a vector there.
    #[inline(always)]
    fn write<S: Simd>(&mut self, s: S, at: usize, points: &PointVector<S>, mask: Mask) {
        let [x, y, z] = &mut self.at;
        store_compressed(s, [x, y, z], &mut self.index, at, (points, mask));
    }
}

impl Rows<MOST> {
    /// Orders the first `count` points so that leaf i holds the i-th run of `leaf` of them. The rest of the last vector becomes no
    /// points.
    #[inline(always)]
    pub(in crate::point) fn order<S: Simd>(&mut self, s: S, count: usize, leaf: usize, spare: &mut Rows<SPARE>) {
        s.call(Order { rows: self, count, leaf, spare });
    }
}

/// See [`Rows::order`].
struct Order<'a> {
    rows: &'a mut Rows<MOST>,
    count: usize,
    leaf: usize,
    spare: &'a mut Rows<SPARE>,
}

impl Kernel for Order<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Order { rows, count, leaf, spare } = self;
        let whole = count.next_multiple_of(LANES);
        for i in count..whole {
            rows.set(i, &NO_POINT);
        }
        // Ranges that are not processed yet: at most one for each halving, of which there are four.
        let mut open = [(0, whole); LANES];
        let mut ranges = 1;
        while ranges > 0 {
            ranges -= 1;
            let (begin, end) = open[ranges];
            if end - begin > leaf {
                let middle = begin + left_part(end - begin, leaf);
                rows.split(s, (begin, middle, end), spare);
                open[ranges] = (begin, middle);
                open[ranges + 1] = (middle, end);
                ranges += 2;
            }
        }
    }
}

/// Orders the first `count` points, which are in the order of bottom nodes, so that leaf i holds the i-th run of `leaf` of them.
pub(in crate::point) fn order_bottoms(rows: &mut PointRows, count: usize, leaf: usize) {
    dispatch(SimdLevel::best(), Bottoms { rows, count, leaf });
}

/// The largest extent of each run of so many points.
pub(in crate::point) fn extents(rows: &PointRows, run: usize) -> Vec<f32> {
    dispatch(SimdLevel::best(), Extents { rows, run })
}

/// See [`order_bottoms`].
struct Bottoms<'a, 'b> {
    rows: &'a mut PointRows<'b>,
    count: usize,
    leaf: usize,
}

impl Kernel for Bottoms<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Bottoms { rows, count, leaf } = self;
        let (mut bottom, mut spare) = (Rows::<MOST>::EMPTY, Rows::<SPARE>::EMPTY);
        for first in (0..count).step_by(leaf * LANES) {
            let count = (count - first).min(leaf * LANES);
            bottom.take(rows, first, count);
            bottom.order(s, count, leaf, &mut spare);
            for (to, from) in rows.at.iter_mut().zip(&bottom.at) {
                to[first..first + count].copy_from_slice(&from[..count]);
            }
            rows.index[first..first + count].copy_from_slice(&bottom.index[..count]);
        }
    }
}

/// See [`extents`].
struct Extents<'a, 'b> {
    rows: &'a PointRows<'b>,
    run: usize,
}

impl Kernel for Extents<'_, '_> {
    type Output = Vec<f32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<f32> {
        let Extents { rows, run } = self;
        let mut extents = Vec::with_capacity(rows.len().div_ceil(run));
        for first in (0..rows.len()).step_by(run) {
            let mut extent = 0.0f32;
            for row in &rows.at {
                let (lo, hi) = extremes(s, row[first..rows.len().min(first + run)].as_chunks().0);
                extent = extent.max(hi - lo);
            }
            extents.push(extent);
        }
        extents
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Orders at most [`MOST`] points.
    struct Bottom<'a> {
        items: &'a mut [Item],
        /// Points per leaf, one or two vectors of them.
        leaf: usize,
    }

    impl Kernel for Bottom<'_> {
        type Output = ();
        #[inline(always)]
        fn run<S: Simd>(self, s: S) {
            let (mut rows, mut spare) = (Rows::<MOST>::EMPTY, Rows::EMPTY);
            for (i, item) in self.items.iter().enumerate() {
                rows.set(i, item);
            }
            rows.order(s, self.items.len(), self.leaf, &mut spare);
            for (i, item) in self.items.iter_mut().enumerate() {
                *item = rows.get(i);
            }
        }
    }

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
}
