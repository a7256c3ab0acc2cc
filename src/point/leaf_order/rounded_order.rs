//! Ordering a range of f64 points by coordinates in f32 relative to its middle.
//!
//! Parts of a few thousand points are found first. Each is then ordered into leaves by the same coordinates, while it is in the
//! cache, unless its leaves are so small, relative to the range, that rounding matters (except for points in one place). Then it is
//! left to the caller, to be ordered by coordinates relative to its own middle.

use crate::parallel::{self, CHUNK};
use crate::point::leaf_order::bottom_order::{extents, order_bottoms};
use crate::point::leaf_order::order::{Displacements, order_rows};
use crate::point::leaf_order::point_rows::{NO_POINT, PointRows};
use crate::point::leaf_order::widest_axis::include;
use crate::progress::Progress;
use crate::simd::{Item, LANES};
use glam::DVec3;

/// Points to be ordered, by their numbers in the set.
pub(in crate::point) trait PointsToOrder: Sync {
    /// Where a point is.
    fn at(&self, number: u32) -> DVec3;
    /// The displacement of a point during the time slice.
    fn displacement(&self, number: u32) -> DVec3;
}

/// Groups of points smaller than this, relative to the range, are not separated well: f32 has 256 steps in them.
const LEAST: f64 = 1.0 / 65536.0;

/// Leaves are at least this much smaller than a part of 256 of them, unless it is nearly flat: evenly spread ones are by 6.3.
const LEAVES: f32 = 6.0;

/// A part of a range.
struct Part<'a, 'b> {
    numbers: &'a mut [u32],
    rows: PointRows<'b>,
    more: PointRows<'b>,
    /// Its largest extent.
    size: f32,
}

/// Orders a range into runs of `leaf` points, by motion as well if that is said. Whether f32 was fine enough; if not, all numbers
/// are there in some order. `again` orders parts that this range is too large for. A point counts 1 for `progress` when it is in
/// its part, and 1 when that is ordered here.
pub(in crate::point) fn order_in_f32<P: PointsToOrder>(
    numbers: &mut [u32],
    leaf: usize,
    (points, by_motion): (&P, bool),
    progress: &Progress,
    again: impl Fn(&mut [u32]) + Sync,
) -> bool {
    let (count, part) = (numbers.len(), leaf * LANES * LANES);
    let mut memory = [PointRows::memory(count), PointRows::memory(count)];
    let [from, to] = &mut memory;
    let (mut from, mut to) = (PointRows::in_blocks(from, count), PointRows::in_blocks(to, count));
    let least = (round(numbers, points, &mut from) * LEAST) as f32;
    if count <= part {
        let size = f32::INFINITY;
        let done = Part { numbers, rows: from, more: to, size }.order(leaf, least, (points, by_motion));
        if done {
            progress.finished(count as f64);
        }
        return done;
    }
    order_rows(from.borrow(), &mut to, part / LANES, None, &progress.subtask(count as f64));
    let sizes = extents(&to, part);
    if !well_separated(&to.index[..count], part, (&sizes, least), points) {
        return false;
    }
    let rows = to.chunks(part).into_iter().zip(from.chunks(part));
    let parts = numbers.chunks_mut(part).zip(rows).zip(sizes);
    let mut parts: Vec<Part> =
        parts.map(|((numbers, ((_, rows), (_, more))), size)| Part { numbers, rows, more, size }).collect();
    parallel::each(&mut parts, |part| {
        if part.order(leaf, least, (points, by_motion)) {
            progress.finished(part.numbers.len() as f64);
        } else {
            again(part.numbers);
        }
    });
    true
}

/// Writes points to rows, relative to the middle of their box, and returns its largest extent.
fn round<P: PointsToOrder>(numbers: &[u32], points: &P, rows: &mut PointRows) -> f64 {
    let bounds = parallel::parts(numbers.len(), |range| {
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &number in &numbers[range] {
            include(&mut lo, &mut hi, points.at(number).to_array());
        }
        (DVec3::from_array(lo), DVec3::from_array(hi))
    });
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (lo, hi) = bounds.fold(none, |(lo, hi), (low, high)| (lo.min(low), hi.max(high)));
    let middle = lo * 0.5 + hi * 0.5;
    let item = |&number: &u32| Item { at: (points.at(number) - middle).as_vec3().to_array(), index: number };
    parallel::each(&mut rows.borrow().chunks(CHUNK), |(first, rows)| {
        rows.take(numbers[*first..].iter().map(item));
    });
    (hi - lo).max_element()
}

/// Whether runs of points, of these sizes, are larger than `least` or in one place.
fn well_separated<P: PointsToOrder>(numbers: &[u32], run: usize, (sizes, least): (&[f32], f32), points: &P) -> bool {
    let one_place = |run: &[u32]| run.iter().all(|&number| points.at(number) == points.at(run[0]));
    numbers.chunks(run).zip(sizes).all(|(run, &size)| size > least || one_place(run))
}

impl Part<'_, '_> {
    /// Orders the points into runs of `leaf`. Whether no leaf is too small for that; if one is, all numbers are there in some
    /// order.
    fn order<P: PointsToOrder>(&mut self, leaf: usize, least: f32, (points, by_motion): (&P, bool)) -> bool {
        let Part { numbers, rows, more, size } = self;
        let count = numbers.len();
        if *size < LEAVES * least {
            numbers.copy_from_slice(&rows.index[..count]);
            return false;
        }
        let displacements = |numbers: &[u32], to: &mut [[f32; 3]]| {
            for (&number, to) in numbers.iter().zip(to).filter(|(number, _)| **number != NO_POINT.index) {
                *to = points.displacement(number).as_vec3().to_array();
            }
        };
        let motion = by_motion.then_some(&displacements as Displacements<'_>);
        order_rows(rows.borrow(), more, leaf, motion, &Progress::new(None));
        order_bottoms(more, count, leaf);
        numbers.copy_from_slice(&more.index[..count]);
        let sizes = extents(more, leaf);
        well_separated(numbers, leaf, (&sizes, least), points)
    }
}
