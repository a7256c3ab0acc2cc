//! Bringing points into the order of a complete tree.
//!
//! The tree needs no pointers because all its subtrees are full except the last on each level. So
//! ordering is all there is to building: cut the range across its widest axis, the left part as large
//! as whole subtrees allow, and go on in both parts. A selection finds the cut, nothing is sorted. The last few hundred
//! points are left to `bottom`, which does the same with vectors.
//! The source of the layout is the implicit, left-balanced k-d tree; ours is sixteen wide.

use super::bottom::{self, Bottom};
use super::complete_tree::{left_part, subtree, subtrees_of};
use super::select::select;
use crate::progress::Progress;
pub(super) use crate::simd::Item;
use crate::simd::{LANES, SimdLevel, dispatch};

/// Ranges shorter than this are not shared between threads.
const SHARE: usize = 1 << 14;

/// The fraction of building a tree that ordering takes, about.
pub(super) const ORDERING: f64 = 0.7;

/// Most points that are looked at to find the widest axis.
pub(super) const SAMPLE: usize = 128;

/// Orders `items` so that leaf i holds the i-th run of `leaf` of them.
///
/// O(n log n) and O(log n) stack; the order is the same for any number of threads. Once `progress` is cancelled, large ranges
/// stay as they are.
pub(super) fn order(items: &mut [Item], leaf: usize, progress: &Progress) {
    let progress = progress.part(1.0 / items.len() as f64);
    order_blocks(items, subtree(items.len(), leaf), leaf, &progress);
}

/// Cuts a range that consists of subtrees of `block` points across its widest axis.
fn halves(items: &mut [Item], block: usize) -> (&mut [Item], &mut [Item]) {
    let left = left_part(items.len(), block);
    let axis = widest_axis(items);
    select(items, left, axis);
    items.split_at_mut(left)
}

/// Orders a range whose subtrees have `block` points each. An item counts 1 for `progress`.
fn order_blocks(items: &mut [Item], block: usize, leaf: usize, progress: &Progress) {
    let Some(block) = subtrees_of(items.len(), block, leaf) else {
        return progress.finished(items.len() as f64);
    };
    if block == leaf && items.len() <= bottom::MOST && items.len().is_multiple_of(LANES) {
        let count = items.len() as f64;
        // The order does not depend on the instruction set.
        dispatch(SimdLevel::best(), Bottom { items, leaf });
        return progress.finished(count);
    }
    let (low, high) = halves(items, block);
    if low.len() < SHARE {
        order_blocks(low, block, leaf, progress);
        order_blocks(high, block, leaf, progress);
    } else if !progress.cancelled() {
        join(|| order_blocks(low, block, leaf, progress), || order_blocks(high, block, leaf, progress));
    }
}

/// Grows a box to hold a point. Comparisons, because `min` and `max` take care of NaN, which is not here.
#[inline(always)]
pub(super) fn include(lo: &mut [f32; 3], hi: &mut [f32; 3], at: [f32; 3]) {
    for axis in 0..3 {
        lo[axis] = if at[axis] < lo[axis] { at[axis] } else { lo[axis] };
        hi[axis] = if at[axis] > hi[axis] { at[axis] } else { hi[axis] };
    }
}

/// The axis along which the points spread most, judged by a sample where there are many.
pub(super) fn widest_axis(items: &[Item]) -> usize {
    let step = (items.len() / SAMPLE).max(1);
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for item in items.iter().step_by(step) {
        include(&mut lo, &mut hi, item.at);
    }
    let size = [hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]];
    let yz = if size[1] >= size[2] { 1 } else { 2 };
    if size[0] >= size[yz] { 0 } else { yz }
}

/// Runs both, on two threads where there are.
#[cfg(feature = "rayon")]
pub(super) fn join(a: impl FnOnce() + Send, b: impl FnOnce() + Send) {
    rayon::join(a, b);
}

/// Runs both.
#[cfg(not(feature = "rayon"))]
pub(super) fn join(a: impl FnOnce() + Send, b: impl FnOnce() + Send) {
    a();
    b();
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
            let mut items: Vec<Item> =
                (0..count).map(|index| Item { at: [next(), 0.001 * next(), 0.001 * next()], index }).collect();
            order(&mut items, LANES, &Progress::new(None));
            let mut seen: Vec<u32> = items.iter().map(|i| i.index).collect();
            seen.sort_unstable();
            assert!(seen.iter().copied().eq(0..count));
            if count as usize > LANES {
                let left = left_part(items.len(), subtree(items.len(), LANES));
                let (low, high) = items.split_at(left);
                let most = low.iter().map(|i| i.at[0]).fold(f32::MIN, f32::max);
                let least = high.iter().map(|i| i.at[0]).fold(f32::MAX, f32::min);
                assert!(most <= least, "{count}: {most} on the left, {least} on the right");
            }
        }
    }
}
