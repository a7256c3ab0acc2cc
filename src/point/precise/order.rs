//! Ordering f64 points for a complete tree: [`crate::point::order`] in f64.

use crate::point::complete_tree::{left_part, subtree, subtrees_of};
use crate::point::order::join;
use crate::point::spread::SAMPLE;
use crate::progress::Progress;
use glam::DVec3;

/// A point to be ordered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) at: DVec3,
    /// Its index in the set.
    pub(super) point: u32,
}

/// Ranges shorter than this are not divided among threads.
const SHARE: usize = 1 << 14;

/// Orders places so that leaf i holds the i-th run of `leaf` of them. Once `progress` is cancelled, large ranges are left
/// unordered.
pub(super) fn order(places: &mut [Place], leaf: usize, progress: &Progress) {
    let progress = progress.part(1.0 / places.len() as f64);
    blocks(places, subtree(places.len(), leaf), leaf, &progress);
}

/// Orders a range whose subtrees have `block` points each. A place counts 1 for `progress`.
fn blocks(places: &mut [Place], block: usize, leaf: usize, progress: &Progress) {
    let Some(block) = subtrees_of(places.len(), block, leaf) else {
        return progress.finished(places.len() as f64);
    };
    let left = left_part(places.len(), block);
    let axis = widest_axis(places);
    places.select_nth_unstable_by(left, |a, b| a.at[axis].total_cmp(&b.at[axis]).then(a.point.cmp(&b.point)));
    let (low, high) = places.split_at_mut(left);
    if low.len() < SHARE {
        blocks(low, block, leaf, progress);
        blocks(high, block, leaf, progress);
    } else if !progress.cancelled() {
        join(|| blocks(low, block, leaf, progress), || blocks(high, block, leaf, progress));
    }
}

/// The axis of the largest extent, estimated from a sample if there are many points.
fn widest_axis(places: &[Place]) -> usize {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let sample = places.iter().step_by((places.len() / SAMPLE).max(1));
    let (lo, hi) = sample.fold(none, |(lo, hi), place| (lo.min(place.at), hi.max(place.at)));
    (hi - lo).max_position()
}
