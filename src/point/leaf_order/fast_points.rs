//! Detecting points that move far relative to their neighbours.

use super::bottom_order::{MOST, Rows, SPARE, extents, order_bottoms};
use super::moving_reference::{References, take_positions};
use super::order::order_rows;
use super::point_rows::PointRows;
use super::segment_slice::SegmentSlice;
use super::selection::{extremes, least_lane};
use crate::progress::Progress;
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch};
use crate::tuning::points::FAST;

/// What is fast among some references.
pub(in crate::point) struct Fast {
    /// The numbers of those that move far during a time slice, relative to their neighbours at a phase of it.
    pub(in crate::point) numbers: Vec<u32>,
    /// The longest side of a leaf of usual size.
    pub(in crate::point) leaf_size: f32,
    /// The numbers of all, those of one leaf behind those of the other.
    pub(in crate::point) order: Vec<u32>,
}

impl Fast {
    pub(in crate::point) fn of<R: References + ?Sized>(references: &R, slice: &SegmentSlice, phase: f64) -> Fast {
        let (order, sizes) = ordered(references, phase);
        let Some(half) = sizes.len().checked_sub(1).map(|last| last / 2) else {
            return Fast { numbers: Vec::new(), leaf_size: 0.0, order: Vec::new() };
        };
        let (_, &mut leaf_size, _) = sizes.clone().select_nth_unstable_by(half, f32::total_cmp);
        let among = Among { references, slice, timed: true, leaf_size };
        let numbers = dispatch(SimdLevel::best(), Compare { among, numbers: &order, sizes: &sizes });
        Fast { numbers, leaf_size, order }
    }
}

/// The numbers of all references in an order by position at a phase, those of one leaf behind those of the other.
pub(in crate::point) fn order_at<R: References + ?Sized>(references: &R, phase: f64) -> Vec<u32> {
    ordered(references, phase).0
}

/// The same, and the longest side of each leaf.
fn ordered<R: References + ?Sized>(references: &R, phase: f64) -> (Vec<u32>, Vec<f32>) {
    let count = references.len();
    let (mut memory, mut more) = (PointRows::memory(count), PointRows::memory(count));
    let mut from = PointRows::in_blocks(&mut memory, count);
    take_positions(from.borrow(), references, phase);
    let mut rows = PointRows::in_blocks(&mut more, count);
    order_rows(from, &mut rows, LANES, None, &Progress::new(None));
    order_bottoms(&mut rows, count, LANES);
    (rows.index[..count].to_vec(), extents(&rows, LANES))
}

/// Where at most so many of the references of sixteen leaves are fast, the others stay in their leaves: a thirtieth of the lanes
/// remain empty at most, and putting the others in order again takes as long as the first time
/// (`neighbor_tables builds --rows fast`).
const FEW: usize = LANES / 2;

/// References some of which may be fast.
pub(in crate::point) struct Among<'a, R: ?Sized> {
    pub(in crate::point) references: &'a R,
    pub(in crate::point) slice: &'a SegmentSlice,
    /// Whether references are perhaps not active throughout the slice.
    pub(in crate::point) timed: bool,
    /// The longest side of a leaf of usual size.
    pub(in crate::point) leaf_size: f32,
}

/// What remains below a bottom node.
pub(in crate::point) struct Kept {
    /// How many references each leaf has.
    pub(in crate::point) in_leaves: Lanes<usize>,
    /// The leaves that have other references than before, as bits.
    pub(in crate::point) changed: Mask,
}

impl<R: References + ?Sized> Among<'_, R> {
    /// Moves the fast ones among the first `count` of a bottom node, which are in order, to `fast`; `displacements` are those of
    /// each leaf between the keys. The others are put in order again unless few are gone. If all are fast, none is.
    #[inline(always)]
    pub(in crate::point) fn take<S: Simd>(
        &self,
        s: S,
        (rows, count): (&mut Rows<MOST>, usize),
        displacements: &[[Lanes<f32>; 3]; LANES],
        spare: &mut Rows<SPARE>,
        fast: &mut Vec<u32>,
    ) -> Kept {
        let leaves = count.div_ceil(LANES);
        let (mut masks, mut in_leaves, mut found) = ([0; LANES], sizes_of_leaves(count), 0);
        for leaf in 0..leaves {
            let numbers = &rows.index[leaf * LANES..count.min((leaf + 1) * LANES)];
            masks[leaf] = self.lanes(s, numbers, &displacements[leaf], size(s, rows, leaf));
            in_leaves[leaf] -= masks[leaf].count_ones() as usize;
            found += masks[leaf].count_ones() as usize;
        }
        if found == 0 || found == count {
            return Kept { in_leaves: sizes_of_leaves(count), changed: 0 };
        }
        let stay = found <= FEW && in_leaves[..leaves].iter().all(|&kept| kept > 0);
        let (mut kept, mut changed) = (0, 0);
        for (leaf, &mask) in masks.iter().enumerate().take(leaves) {
            if stay {
                kept = leaf * LANES;
                if mask == 0 {
                    continue;
                }
                changed |= 1 << leaf;
            }
            for lane in 0..LANES.min(count - leaf * LANES) {
                let item = rows.get(leaf * LANES + lane);
                if mask >> lane & 1 != 0 {
                    fast.push(item.index);
                } else {
                    rows.set(kept, &item);
                    kept += 1;
                }
            }
        }
        if stay {
            return Kept { in_leaves, changed };
        }
        rows.order(s, kept, LANES, spare);
        Kept { in_leaves: sizes_of_leaves(kept), changed: Mask::MAX }
    }

    /// The fast ones of a leaf, given their displacements between the keys and its longest side.
    #[inline(always)]
    fn lanes<S: Simd>(&self, s: S, numbers: &[u32], displacement: &[Lanes<f32>; 3], size: f32) -> Mask {
        let SegmentSlice { interval, phases: [begin, end], .. } = *self.slice;
        let mut duration = [(end - begin) as f32; LANES];
        if self.timed {
            for (lane, &number) in numbers.iter().enumerate() {
                let m = self.references.reference(number);
                if m.interval != interval {
                    let [begin, end] = m.range(self.slice);
                    duration[lane] = (end - begin) as f32;
                }
            }
        }
        let limit = s.splat(FAST * if size < self.leaf_size { size } else { self.leaf_size });
        let (duration, exists) = (s.load(&duration), Mask::MAX >> (LANES - numbers.len()));
        let first = [displacement[0][0], displacement[1][0], displacement[2][0]];
        let most = duration * farthest(s, displacement, first);
        // No point is twice as far from the middle of all as all are from the first.
        if s.lt(limit, most + most) & exists == 0 {
            return 0;
        }
        let half = numbers.len() / 2;
        let [x, y, z] = displacement;
        let usual = [middle(s, x, half), middle(s, y, half), middle(s, z, half)];
        s.lt(limit, duration * farthest(s, displacement, usual)) & exists
    }
}

/// Displacements between the keys, given positions at both. Lanes without a reference are behind all others.
#[inline(always)]
pub(in crate::point) fn displacements<S: Simd>(
    s: S,
    (open, close): &([Lanes<f32>; 3], [Lanes<f32>; 3]),
    used: usize,
) -> [Lanes<f32>; 3] {
    let exists = Mask::MAX >> (LANES - used);
    let mut rows = [[0.0; LANES]; 3];
    for (axis, row) in rows.iter_mut().enumerate() {
        s.store(s.select(exists, s.load(&close[axis]) - s.load(&open[axis]), s.splat(f32::INFINITY)), row);
    }
    rows
}

/// The numbers of points in leaves that are filled one after the other.
#[inline(always)]
pub(in crate::point) fn sizes_of_leaves(count: usize) -> Lanes<usize> {
    core::array::from_fn(|leaf| count.saturating_sub(leaf * LANES).min(LANES))
}

/// How far each lane is from a place, along the axis on which it is farthest.
#[inline(always)]
fn farthest<S: Simd>(s: S, rows: &[Lanes<f32>; 3], place: [f32; 3]) -> S::F {
    let mut far = s.splat(0.0);
    for axis in 0..3 {
        let (row, place) = (s.load(&rows[axis]), s.splat(place[axis]));
        far = s.max(far, s.max(row - place, place - row));
    }
    far
}

/// The longest side of a leaf.
#[inline(always)]
fn size<S: Simd>(s: S, rows: &Rows<MOST>, leaf: usize) -> f32 {
    let mut size = 0.0;
    for row in &rows.at {
        let (least, most) = extremes(s, &row.as_chunks().0[leaf..=leaf]);
        size = if most - least > size { most - least } else { size };
    }
    size
}

/// Finds fast references among those of all leaves.
struct Compare<'a, R: ?Sized> {
    among: Among<'a, R>,
    /// Those of one leaf behind those of the other.
    numbers: &'a [u32],
    sizes: &'a [f32],
}

impl<R: References + ?Sized> Kernel for Compare<'_, R> {
    type Output = Vec<u32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<u32> {
        let Compare { among, numbers, sizes } = self;
        let mut fast = Vec::new();
        for (numbers, size) in numbers.chunks(LANES).zip(sizes) {
            let (mut open, mut close) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
            for (lane, &number) in numbers.iter().enumerate() {
                let reference = among.references.reference(number);
                for axis in 0..3 {
                    (open[axis][lane], close[axis][lane]) = (reference.open[axis], reference.close[axis]);
                }
            }
            let displacements = displacements(s, &(open, close), numbers.len());
            let mask = among.lanes(s, numbers, &displacements, *size);
            for (lane, &number) in numbers.iter().enumerate() {
                if mask >> lane & 1 != 0 {
                    fast.push(number);
                }
            }
        }
        fast
    }
}

/// The number that so many of sixteen are before in ascending order.
#[inline(always)]
fn middle<S: Simd>(s: S, row: &Lanes<f32>, number: usize) -> f32 {
    let (all, one) = (s.load(row), s.splat(1.0));
    let mut below = s.splat(0.0);
    for &x in row {
        below = s.select(s.lt(s.splat(x), all), below + one, below);
    }
    // It is the greatest of those that no more are below.
    let least = s.select(s.le(below, s.splat(number as f32)), s.splat(0.0) - all, s.splat(f32::INFINITY));
    -least_lane(s, least)
}

#[cfg(test)]
mod tests {
    use super::super::moving_reference::MovingReference;
    use super::*;
    use crate::geometry::TimeInterval;
    use crate::point::layout::moving_tree::{MovingTree, WithoutFast};
    use crate::point::layout::slice_tree::all_ids;
    use crate::random::Random;

    /// A tree without fast references, the numbers of those, and the numbers of what is in the tree, in ascending order.
    fn split(references: &[MovingReference], slice: &SegmentSlice) -> (MovingTree, Vec<u32>, Vec<u32>) {
        let leaf_size = Some(Fast::of(references, slice, slice.middle_phase()).leaf_size);
        let progress = Progress::new(None);
        let built = MovingTree::build_without_fast(references, *slice, leaf_size, &mut Vec::new(), &progress);
        let WithoutFast { tree, mut fast, .. } = built;
        let mut left: Vec<u32> = all_ids(&tree).collect();
        left.sort_unstable();
        fast.sort_unstable();
        (tree, fast, left)
    }

    #[test]
    fn trees_leave_out_what_is_fast_and_nothing_else() {
        let slice = SegmentSlice { keys: 2, segment: 0, interval: TimeInterval::FULL, phases: [0.0, 1.0] };
        let mut random = Random(9);
        for every in [20, 300, usize::MAX] {
            let reference = |i: usize| {
                let (at, by) = (random.vec(), random.vec() * if i % every == 1 { 5.0 } else { 1e-4 });
                let [open, close] = [at - 0.5 * by, at + 0.5 * by].map(|at| at.to_array());
                let active = TimeInterval::FULL;
                MovingReference { open, close, interval: active, active, id: i as u32, fast: false }
            };
            let references: Vec<MovingReference> = (0..5000).map(reference).collect();
            let (tree, fast, left) = split(&references, &slice);
            assert_eq!(tree.references, left.len());
            let mut all = [&fast[..], &left[..]].concat();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..5000), "one in {every}");
            let slow = fast.iter().filter(|&&i| i as usize % every != 1).count();
            assert_eq!(slow, 0, "of those that are one in {every}");
            let expected = (0..5000).filter(|i| i % every == 1).count();
            // Some move little by chance.
            assert!(fast.len() * 10 >= expected * 9, "{} of {expected}", fast.len());
            let mut compared = Fast::of(&references[..], &slice, slice.middle_phase()).numbers;
            compared.sort_unstable();
            assert_eq!(fast, compared);
        }
    }

    #[test]
    fn bottom_nodes_of_fast_references_only_keep_them() {
        let slice = SegmentSlice { keys: 2, segment: 0, interval: TimeInterval::FULL, phases: [0.0, 1.0] };
        let mut random = Random(4);
        // Behind 8000 slow ones, 2000 that fly apart from a small place.
        let reference = |i: u32| {
            let (at, by) = match i {
                ..8000 => (random.vec(), random.vec() * 1e-4),
                _ => (random.vec() * 0.1 + 9.0, random.vec().normalize() * 5.0),
            };
            let [open, close] = [at - 0.5 * by, at + 0.5 * by].map(|at| at.to_array());
            MovingReference {
                open,
                close,
                interval: TimeInterval::FULL,
                active: TimeInterval::FULL,
                id: i,
                fast: false,
            }
        };
        let references: Vec<MovingReference> = (0..10_000).map(reference).collect();
        let (tree, fast, left) = split(&references, &slice);
        let mut all = [&fast[..], &left[..]].concat();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..10_000));
        assert_eq!(tree.references, left.len());
        assert!(fast.iter().all(|&i| i >= 8000));
        // Nodes that hold slow ones as well lose their fast ones.
        assert!(!fast.is_empty(), "no node is mixed");
        assert!(left.len() >= 8000 + LANES * LANES, "{} are left", left.len());
    }

    #[test]
    fn the_middle_is_that_of_the_sorted_numbers() {
        struct Middle<'a>(&'a Lanes<f32>, usize);
        impl Kernel for Middle<'_> {
            type Output = f32;
            #[inline(always)]
            fn run<S: Simd>(self, s: S) -> f32 {
                middle(s, self.0, self.1)
            }
        }
        let mut random = Random(3);
        for round in 0..200 {
            let count = 1 + round % LANES;
            let mut row = [f32::INFINITY; LANES];
            // Some of them equal.
            row[..count].iter_mut().for_each(|x| *x = (random.signed() * 8.0).floor());
            let mut sorted = row;
            sorted.sort_by(f32::total_cmp);
            for level in SimdLevel::available() {
                assert_eq!(dispatch(level, Middle(&row, count / 2)), sorted[count / 2]);
            }
        }
    }
}
