//! Ordering a range of f64 points by coordinates in f32 relative to its middle.
//!
//! It fails where what it separates is so small, relative to the range, that rounding matters, except for points in one place.

use super::fill_leaves::AHEAD;
use crate::point::leaf_order::bottom_order::{MOST, Rows, SPARE};
use crate::point::leaf_order::divide::extremes;
use crate::point::leaf_order::order::order_rows;
use crate::point::leaf_order::point_rows::{NO_POINT, PointRows};
use crate::progress::Progress;
use crate::simd::{Item, Kernel, LANES, Simd, SimdLevel, dispatch, fill};
use glam::DVec3;

/// A vector for each point, by its number in the set.
pub(super) type OfPoint<'a> = &'a (dyn Fn(u32) -> DVec3 + Sync);

/// Points to be ordered.
#[derive(Clone, Copy)]
pub(super) struct Points<'a> {
    /// Where they are.
    pub(super) at: OfPoint<'a>,
    /// Prefetches where a point is; a hint.
    pub(super) prefetch: &'a (dyn Fn(u32) + Sync),
    /// Their displacements during a time slice, if they are to be divided by motion as well.
    pub(super) displacement: Option<OfPoint<'a>>,
}

/// Groups of points smaller than this, relative to the range, are not separated well: f32 has 256 steps in them.
const LEAST: f64 = 1.0 / 65536.0;

/// Orders a range so that each run of `part` points is one of its subtrees. Whether that succeeded; if not, the points stay where
/// they are.
pub(super) fn order_parts_in_f32(numbers: &mut [u32], part: usize, points: Points<'_>, progress: &Progress) -> bool {
    by_rounded(numbers, part, points, |from, to, _| {
        order_rows(from, to, part / LANES, None, progress);
    })
}

/// Orders a range of at most `leaf` · 256 points so that each run of `leaf` of them is a leaf. Whether that succeeded; if not, the
/// points stay where they are.
pub(super) fn order_in_f32(numbers: &mut [u32], leaf: usize, points: Points<'_>) -> bool {
    by_rounded(numbers, leaf, points, |from, to, numbers| {
        let displacements = points.displacement.map(|displacement| {
            move |rows: &[u32], to: &mut [[f32; 3]]| {
                for (&row, to) in rows.iter().zip(to).filter(|(row, _)| **row != NO_POINT.index) {
                    *to = displacement(numbers[row as usize]).as_vec3().to_array();
                }
            }
        });
        let motion = displacements.as_ref().map(|displacements| displacements as _);
        order_rows(from, to, leaf, motion, &Progress::new(None));
        dispatch(SimdLevel::best(), Bottoms { rows: to, count: numbers.len(), leaf });
    })
}

/// Orders numbers of points by an order of their rounded coordinates, unless a run of so many is too small for that.
fn by_rounded(
    numbers: &mut [u32],
    run: usize,
    points: Points<'_>,
    order: impl FnOnce(PointRows<'_>, &mut PointRows<'_>, &[u32]),
) -> bool {
    let count = numbers.len();
    let mut positions = Vec::with_capacity(count);
    fill(&mut positions, count, |i| {
        numbers.get(i + AHEAD).into_iter().for_each(|&later| (points.prefetch)(later));
        (points.at)(numbers[i])
    });
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (lo, hi) = positions.iter().fold(none, |(lo, hi), &at| (lo.min(at), hi.max(at)));
    let middle = lo * 0.5 + hi * 0.5;
    let mut memory = [PointRows::memory(count), PointRows::memory(count)];
    let [from, to] = &mut memory;
    let (mut from, mut to) = (PointRows::in_blocks(from, count), PointRows::in_blocks(to, count));
    let item = |(row, &at): (u32, &DVec3)| Item { at: (at - middle).as_vec3().to_array(), index: row };
    from.take((0..).zip(&positions).map(item));
    order(from, &mut to, numbers);
    let rows = &to.index[..count];
    let least = ((hi - lo).max_element() * LEAST) as f32;
    let small = dispatch(SimdLevel::best(), Small { rows: &to, run, least });
    let one_place = |run: &[u32]| run.iter().all(|&row| positions[row as usize] == positions[run[0] as usize]);
    let well_separated = rows.chunks(run).zip(small).all(|(run, small)| !small || one_place(run));
    if well_separated {
        let ordered: Vec<u32> = rows.iter().map(|&row| numbers[row as usize]).collect();
        numbers.copy_from_slice(&ordered);
    }
    well_separated
}

/// Orders the points below each bottom node.
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

/// Finds out which runs of points are no larger than `least` along all axes.
struct Small<'a, 'b> {
    rows: &'a PointRows<'b>,
    run: usize,
    least: f32,
}

impl Kernel for Small<'_, '_> {
    type Output = Vec<bool>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<bool> {
        let Small { rows, run, least } = self;
        let mut all = Vec::with_capacity(rows.len().div_ceil(run));
        for first in (0..rows.len()).step_by(run) {
            let mut small = true;
            for row in &rows.at {
                let (lo, hi) = extremes(s, row[first..rows.len().min(first + run)].as_chunks().0);
                small &= hi - lo <= least;
            }
            all.push(small);
        }
        all
    }
}
