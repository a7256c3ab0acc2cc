//! Bringing points into the order of a complete tree.
//!
//! The tree needs no pointers because all its subtrees are full except the last on each level. So
//! ordering is all there is to building: divide the range across its widest axis or by motion, the left half as large
//! as whole subtrees allow, and continue in both halves. A selection finds the border, nothing is sorted. `divide` does that for
//! thousands of points, `bottom_order` for the last few hundred.
//! The source of the layout is the implicit, left-balanced k-d tree; ours is sixteen wide.

use super::complete_tree::{left_part, subtree, subtrees_of};
use super::divide::{divide, divide_by};
use super::motion_groups::{Displaced, MotionDivision, SAMPLE};
use super::point_rows::{NO_POINT, PointRows};
use super::spread::spread;
use crate::parallel;
use crate::progress::Progress;
use crate::simd::{Item, LANES};
use glam::DVec3;

/// Writes the displacements of points during a time slice, given their numbers; of no points, nothing.
pub(in crate::point) type Displacements<'a> = &'a (dyn Fn(&[u32], &mut [[f32; 3]]) + Sync);

/// Ranges shorter than this are not shared between threads.
const SHARE: usize = 1 << 14;

/// Ranges shorter than this report their progress as a whole, at their begin. Not fitted: they take a few hundred microseconds.
const REPORTED: usize = 1 << 12;

/// The fraction of building a tree that ordering takes, about.
pub(in crate::point) const ORDERING: f64 = 0.7;

/// Writes the points of `from` to `to`, which is as long, so that bottom node i holds the i-th run of sixteen leaves. What is in
/// `from` then is of no use. Given displacements, points are also divided by motion ([`super::motion_groups`]). Returns whether any
/// were.
///
/// O(n log n), O(log n) stack; the order is the same for any number of threads. Once `progress` is cancelled, large ranges stay as
/// they are.
pub(in crate::point) fn order_rows(
    from: PointRows,
    to: &mut PointRows,
    leaf: usize,
    motion: Option<Displacements<'_>>,
    progress: &Progress,
) -> bool {
    let progress = progress.in_units(from.len());
    let block = subtree(from.len(), leaf);
    order_blocks((from, to.borrow()), block, leaf, motion, true, Some(&progress))
}

/// Orders the first of two rows, whose subtrees have `block` points each, by writing them to one and the other in turn. They end in
/// the second if it `lands` there, otherwise in the first. `progress` counts points; there is none if they are counted already.
fn order_blocks(
    (mut from, mut to): (PointRows, PointRows),
    block: usize,
    leaf: usize,
    motion: Option<Displacements<'_>>,
    lands: bool,
    mut progress: Option<&Progress>,
) -> bool {
    let (count, cancelled) = (from.len(), progress.is_some_and(Progress::cancelled));
    if let Some(counted) = progress.take_if(|_| count < REPORTED && !cancelled) {
        counted.finished(count as f64);
    }
    let block = subtrees_of(count, block, leaf).filter(|&block| block > leaf && !cancelled);
    let Some(block) = block else {
        if lands {
            to.copy(&from);
        }
        return false;
    };
    // Flows are divided where all nodes below are bottom nodes, so that flows of that place count.
    let above_bottom = block == leaf * LANES;
    let by_motion = motion.filter(|_| above_bottom).and_then(|by| divided_by_motion(&from, block, by));
    let divided = by_motion.is_some();
    let (left, motion) = match by_motion {
        Some((keys, left)) => {
            divide_by(&from, &keys, left, &mut to);
            (left, motion)
        }
        None => {
            let left = left_part(count, block);
            divide(&from, left, &mut to);
            // Parts of a place without flows have none.
            (left, motion.filter(|_| !above_bottom))
        }
    };
    let (low, high) = to.borrow().split_at(left);
    let (low_from, high_from) = from.borrow().split_at(left);
    let order_low = || order_blocks((low, low_from), block, leaf, motion, !lands, progress);
    let order_high = || order_blocks((high, high_from), block, leaf, motion, !lands, progress);
    let (low, high) = if left < SHARE { (order_low(), order_high()) } else { parallel::both(order_low, order_high) };
    divided || low || high
}

/// The keys by which to divide points by motion, and how many go to the left; `None` if division by position is better.
fn divided_by_motion(rows: &PointRows, block: usize, displacements: Displacements<'_>) -> Option<(Vec<f32>, usize)> {
    let double = |x: [f32; 3]| DVec3::from_array(x.map(f64::from));
    let items = (0..SAMPLE).map(|i| rows.get(spread(i, rows.len())));
    let items: Vec<Item> = items.filter(|item| item.index != NO_POINT.index).collect();
    let numbers: Vec<u32> = items.iter().map(|item| item.index).collect();
    let mut by = vec![[0.0; 3]; items.len()];
    displacements(&numbers, &mut by);
    let sample = items.iter().zip(&by).map(|(item, &by)| Displaced { at: double(item.at), by: double(by) });
    let division = MotionDivision::of(&sample.collect::<Vec<_>>(), rows.len(), block)?;
    by.resize(rows.len(), [0.0; 3]);
    displacements(rows.index, &mut by);
    let key = |(i, &by): (usize, &[f32; 3])| {
        let item = rows.get(i);
        if item.index == NO_POINT.index {
            return f32::INFINITY;
        }
        division.key(&Displaced { at: double(item.at), by: double(by) }) as f32
    };
    Some((by.iter().enumerate().map(key).collect(), division.left))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn every_item_stays_and_halves_are_separated() {
        let mut random = Random(1);
        let mut next = || random.unit();
        for count in [0, 1, 15, 16, 17, 300, 5000] {
            let mut memory = [PointRows::memory(count), PointRows::memory(count)];
            let [from, to] = &mut memory;
            let (mut from, mut to) = (PointRows::in_blocks(from, count), PointRows::in_blocks(to, count));
            from.take((0..count as u32).map(|index| Item { at: [next(), 0.001 * next(), 0.001 * next()], index }));
            order_rows(from, &mut to, LANES, None, &Progress::new(None));
            let items: Vec<Item> = (0..count).map(|i| to.get(i)).collect();
            let mut seen: Vec<u32> = items.iter().map(|i| i.index).collect();
            seen.sort_unstable();
            assert!(seen.iter().copied().eq(0..count as u32));
            if count > LANES * LANES {
                let left = left_part(items.len(), subtree(items.len(), LANES));
                let (low, high) = items.split_at(left);
                let most = low.iter().map(|i| i.at[0]).fold(f32::MIN, f32::max);
                let least = high.iter().map(|i| i.at[0]).fold(f32::MAX, f32::min);
                assert!(most <= least, "{count}: {most} on the left, {least} on the right");
            }
        }
    }
}
