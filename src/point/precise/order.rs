//! Ordering f64 points for a complete tree: [`crate::point::leaf_order::order`] in f64.

use crate::parallel;
use crate::point::leaf_order::complete_tree::{left_part, subtree, subtrees_of};
use crate::point::leaf_order::motion_groups::{self, Displaced, MotionDivision};
use crate::point::leaf_order::spread::spread;
use crate::point::leaf_order::widest_axis::SAMPLE;
use crate::progress::Progress;
use crate::simd::LANES;
use glam::DVec3;

/// A point to be ordered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub(super) at: DVec3,
    /// Its index in the set.
    pub(super) point: u32,
}

/// Ranges shorter than this are not divided among threads.
const SHARE: usize = 1 << 14;

/// The displacement of a point during a time slice, by its index in the set.
pub(super) type Displacement<'a> = &'a (dyn Fn(u32) -> DVec3 + Sync);

/// Orders points so that leaf i holds the i-th run of `leaf` of them. Once `progress` is cancelled, large ranges are left
/// unordered.
pub(super) fn order(items: &mut [Item], leaf: usize, motion: Option<Displacement<'_>>, progress: &Progress) {
    let progress = progress.subtask(1.0 / items.len() as f64);
    blocks(items, subtree(items.len(), leaf), leaf, motion, &progress);
}

/// Orders a range whose subtrees have `block` points each. A point counts 1 for `progress`.
fn blocks(items: &mut [Item], block: usize, leaf: usize, motion: Option<Displacement<'_>>, progress: &Progress) {
    let Some(block) = subtrees_of(items.len(), block, leaf) else {
        return progress.finished(items.len() as f64);
    };
    let above_bottom = block == leaf * LANES;
    let by_motion = motion.filter(|_| above_bottom).and_then(|by| divide_by_motion(items, block, by));
    let (left, motion) = match by_motion {
        Some(left) => (left, motion),
        None => {
            let (left, axis) = (left_part(items.len(), block), widest_axis(items));
            items.select_nth_unstable_by(left, |a, b| a.at[axis].total_cmp(&b.at[axis]).then(a.point.cmp(&b.point)));
            (left, motion.filter(|_| !above_bottom))
        }
    };
    let (low, high) = items.split_at_mut(left);
    if low.len() < SHARE {
        blocks(low, block, leaf, motion, progress);
        blocks(high, block, leaf, motion, progress);
    } else if !progress.cancelled() {
        parallel::both(|| blocks(low, block, leaf, motion, progress), || blocks(high, block, leaf, motion, progress));
    }
}

/// Divides points by motion and returns how many are on the left; `None` if division by position is better.
fn divide_by_motion(items: &mut [Item], block: usize, displacement: Displacement<'_>) -> Option<usize> {
    let displaced = |item: &Item| Displaced { at: item.at, by: displacement(item.point) };
    let sample = (0..motion_groups::SAMPLE).map(|i| displaced(&items[spread(i, items.len())]));
    let division = MotionDivision::of(&sample.collect::<Vec<_>>(), items.len(), block)?;
    let mut keys: Vec<(f64, Item)> = items.iter().map(|item| (division.key(&displaced(item)), *item)).collect();
    keys.select_nth_unstable_by(division.left, |a, b| a.0.total_cmp(&b.0).then(a.1.point.cmp(&b.1.point)));
    items.iter_mut().zip(keys).for_each(|(to, (_, item))| *to = item);
    Some(division.left)
}

/// The axis of the largest extent, estimated from a sample if there are many points.
fn widest_axis(items: &[Item]) -> usize {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let sample = items.iter().step_by((items.len() / SAMPLE).max(1));
    let (lo, hi) = sample.fold(none, |(lo, hi), item| (lo.min(item.at), hi.max(item.at)));
    (hi - lo).max_position()
}
