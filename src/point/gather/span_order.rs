//! Ordering items with a position, a time and perhaps a radius for a complete tree.
//!
//! The picture to have in mind: boxes in space and time, expanded by the radius and the window of a query. The larger the
//! expanded boxes of two halves are, the more queries enter both. So a range is divided along the axis (x, y, z, time, or
//! the radius itself) for which the expanded boxes of the halves are smallest: a surface area heuristic for balls. If the
//! radius of queries is unknown because they have a number of neighbours, it is the radius that should hold these.
//!
//! The tree is that of [`Shape`](crate::point::layout::shape::Shape): all subtrees full but the last of each level.

use crate::parallel;
use crate::point::leaf_order::complete_tree::{left_part, subtree, subtrees_of};
use crate::progress::Progress;
use crate::simd::LANES;

/// Channels of an item: x, y, z, time, radius.
pub(super) const CHANNELS: usize = 5;

/// The channel of the time.
pub(super) const TIME: usize = 3;

/// The channel of the radius.
pub(super) const RADIUS: usize = 4;

/// An item to be ordered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub(super) at: [f32; CHANNELS],
    pub(super) index: u32,
}

/// The extent of queries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Queries {
    /// Half width of their window.
    pub(super) window: f32,
    /// Their number of neighbours; `None` if the items have radii of their own.
    pub(super) neighbors: Option<f32>,
}

/// Ranges shorter than this are not divided among threads.
const SHARE: usize = 1 << 14;

/// Ranges shorter than this report their progress as a whole, at their begin. Not fitted: they take less than a millisecond.
const REPORTED: usize = 1 << 12;

/// The largest number of items that are sampled to choose an axis.
const SAMPLE: usize = 128;

/// Orders items so that leaf i holds the i-th run of sixteen.
///
/// O(n log n) time and O(log n) stack; the order is the same for any number of threads. Once `progress` is cancelled, large ranges
/// stay as they are.
pub(super) fn order(items: &mut [Item], queries: &Queries, progress: &Progress) {
    let progress = progress.in_units(items.len());
    divide(items, subtree(items.len(), LANES), queries, Some(&progress));
}

/// `progress` counts items; there is none if they are counted already.
fn divide(items: &mut [Item], block: usize, queries: &Queries, mut progress: Option<&Progress>) {
    if progress.is_some_and(Progress::cancelled) {
        return;
    }
    if let Some(counted) = progress.take_if(|_| items.len() < REPORTED) {
        counted.finished(items.len() as f64);
    }
    let Some(block) = subtrees_of(items.len(), block, LANES) else { return };
    let left = left_part(items.len(), block);
    let channel = best_channel(items, queries);
    items.select_nth_unstable_by(left, |a, b| a.at[channel].total_cmp(&b.at[channel]));
    let (low, high) = items.split_at_mut(left);
    if low.len() < SHARE {
        divide(low, block, queries, progress);
        divide(high, block, queries, progress);
    } else {
        parallel::both(|| divide(low, block, queries, progress), || divide(high, block, queries, progress));
    }
}

/// The channel along which the halves overlap least.
fn best_channel(items: &[Item], queries: &Queries) -> usize {
    let step = (items.len() / SAMPLE).max(1);
    let (mut lo, mut hi) = ([f32::INFINITY; CHANNELS], [f32::NEG_INFINITY; CHANNELS]);
    let mut radii = [0.0; 2 * SAMPLE];
    let mut count = 0;
    for item in items.iter().step_by(step) {
        for channel in 0..CHANNELS {
            lo[channel] = lo[channel].min(item.at[channel]);
            hi[channel] = hi[channel].max(item.at[channel]);
        }
        radii[count] = item.at[RADIUS];
        count += 1;
    }
    let extent: [f64; CHANNELS] = core::array::from_fn(|c| f64::from(hi[c]) - f64::from(lo[c]));
    let window = 2.0 * f64::from(queries.window);
    let reach = match queries.neighbors {
        Some(k) => {
            let share = (window / extent[TIME].max(f64::MIN_POSITIVE)).min(1.0);
            let mut sides = [extent[0], extent[1], extent[2]];
            sides.sort_unstable_by(f64::total_cmp);
            let area = sides[2] * sides[1].max(1e-3 * sides[2]);
            (f64::from(k) * area / (core::f64::consts::PI * items.len() as f64 * share)).sqrt()
        }
        None => f64::from(hi[RADIUS]),
    };
    let grown = |extent: &[f64; CHANNELS], reach: f64| -> f64 {
        extent[..TIME].iter().map(|side| side + 2.0 * reach).product::<f64>() * (extent[TIME] + window)
    };
    let halved = |channel: usize| {
        let mut half = extent;
        half[channel] *= 0.5;
        2.0 * grown(&half, reach)
    };
    let mut best = (halved(0), 0);
    for channel in 1..RADIUS {
        let cost = halved(channel);
        if cost < best.0 {
            best = (cost, channel);
        }
    }
    if queries.neighbors.is_none() && lo[RADIUS] < hi[RADIUS] {
        let (_, median, _) = radii[..count].select_nth_unstable_by(count / 2, f32::total_cmp);
        if grown(&extent, f64::from(*median)) + grown(&extent, reach) < best.0 {
            return RADIUS;
        }
    }
    best.1
}
