//! Bringing points into the order of a complete tree.
//!
//! The tree needs no pointers because all its subtrees are full except the last on each level. So
//! ordering is all there is to building: divide the range across its widest axis, the left half as large
//! as whole subtrees allow, and continue in both halves. A selection finds the border, nothing is sorted. `divide` does that for
//! thousands of points, `bottom` for the last few hundred.
//! The source of the layout is the implicit, left-balanced k-d tree; ours is sixteen wide.

use super::bottom_order::Bottom;
use super::complete_tree::{left_part, subtree, subtrees_of};
use super::divide::divide;
use super::point_rows::PointRows;
use crate::parallel;
use crate::progress::Progress;
pub(super) use crate::simd::Item;
use crate::simd::{LANES, SimdLevel, dispatch};

/// Ranges shorter than this are not shared between threads.
const SHARE: usize = 1 << 14;

/// The fraction of building a tree that ordering takes, about.
pub(super) const ORDERING: f64 = 0.7;

/// Orders `items` so that leaf i holds the i-th run of `leaf` of them, one or two vectors.
///
/// O(n log n), O(log n) stack, and memory for twice the items; the order is the same for any number of threads. Once `progress` is
/// cancelled, large ranges stay as they are.
pub(super) fn order(items: &mut [Item], leaf: usize, progress: &Progress) {
    let (mut memory, mut more) = (PointRows::memory(items.len()), PointRows::memory(items.len()));
    let mut from = PointRows::in_blocks(&mut memory, items.len());
    from.take(items.iter().copied());
    let mut to = PointRows::in_blocks(&mut more, items.len());
    order_rows(from, &mut to, leaf, progress);
    finish(items, &mut to, leaf);
}

/// Takes the points of bottom nodes, and puts them in order.
fn finish(items: &mut [Item], from: &mut PointRows, leaf: usize) {
    if items.len() > SHARE {
        let half = (items.len() / 2).next_multiple_of(LANES * leaf);
        let (items, more_items) = items.split_at_mut(half);
        let (mut from, mut more) = from.borrow().split_at(half);
        parallel::both(|| finish(items, &mut from, leaf), || finish(more_items, &mut more, leaf));
        return;
    }
    for (i, item) in items.iter_mut().enumerate() {
        *item = from.get(i);
    }
    for items in items.chunks_mut(LANES * leaf) {
        // The order does not depend on the instruction set.
        dispatch(SimdLevel::best(), Bottom { items, leaf });
    }
}

/// Writes the points of `from` to `to`, which is as long, so that bottom node i holds the i-th run of sixteen leaves. What is in
/// `from` then is of no use.
pub(super) fn order_rows(from: PointRows, to: &mut PointRows, leaf: usize, progress: &Progress) {
    let progress = progress.subtask(1.0 / from.len() as f64);
    let block = subtree(from.len(), leaf);
    order_blocks((from, to.borrow()), block, leaf, true, &progress);
}

/// Orders the first of two rows, whose subtrees have `block` points each, by writing them to one and the other in turn. They end in
/// the second if it `lands` there, otherwise in the first. A point counts 1 for `progress`.
fn order_blocks(
    (mut from, mut to): (PointRows, PointRows),
    block: usize,
    leaf: usize,
    lands: bool,
    progress: &Progress,
) {
    let (count, cancelled) = (from.len(), progress.cancelled());
    let block = subtrees_of(count, block, leaf).filter(|&block| block > leaf && !cancelled);
    let Some(block) = block else {
        if lands {
            to.copy(&from);
        }
        if !cancelled {
            progress.finished(count as f64);
        }
        return;
    };
    // Across the widest axis.
    let left = left_part(count, block);
    divide(&from, left, &mut to);
    let (low, high) = to.borrow().split_at(left);
    let (low_from, high_from) = from.borrow().split_at(left);
    let order_low = || order_blocks((low, low_from), block, leaf, !lands, progress);
    let order_high = || order_blocks((high, high_from), block, leaf, !lands, progress);
    if left < SHARE {
        order_low();
        order_high();
    } else {
        parallel::both(order_low, order_high);
    }
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
