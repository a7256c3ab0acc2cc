//! Ordering f64 points for a complete tree: [`crate::point::order`] in f64.

use crate::parallel;
use crate::point::complete_tree::{left_part, subtree, subtrees_of};
use crate::point::widest_axis::SAMPLE;
use crate::progress::Progress;
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

/// Orders points so that leaf i holds the i-th run of `leaf` of them. Once `progress` is cancelled, large ranges are left
/// unordered.
pub(super) fn order(items: &mut [Item], leaf: usize, progress: &Progress) {
    let progress = progress.subtask(1.0 / items.len() as f64);
    blocks(items, subtree(items.len(), leaf), leaf, &progress);
}

/// Orders a range whose subtrees have `block` points each. A point counts 1 for `progress`.
fn blocks(items: &mut [Item], block: usize, leaf: usize, progress: &Progress) {
    let Some(block) = subtrees_of(items.len(), block, leaf) else {
        return progress.finished(items.len() as f64);
    };
    let left = left_part(items.len(), block);
    let axis = widest_axis(items);
    items.select_nth_unstable_by(left, |a, b| a.at[axis].total_cmp(&b.at[axis]).then(a.point.cmp(&b.point)));
    let (low, high) = items.split_at_mut(left);
    if low.len() < SHARE {
        blocks(low, block, leaf, progress);
        blocks(high, block, leaf, progress);
    } else if !progress.cancelled() {
        parallel::both(|| blocks(low, block, leaf, progress), || blocks(high, block, leaf, progress));
    }
}

/// The axis of the largest extent, estimated from a sample if there are many points.
fn widest_axis(items: &[Item]) -> usize {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let sample = items.iter().step_by((items.len() / SAMPLE).max(1));
    let (lo, hi) = sample.fold(none, |(lo, hi), item| (lo.min(item.at), hi.max(item.at)));
    (hi - lo).max_position()
}
