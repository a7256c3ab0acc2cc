//! Selection: the points with the lowest coordinates to the front, in linear time.

use crate::simd::Item;

/// Reorders so that no coordinate of `items[..count]` along `axis` is above one of `items[count..]`.
pub(in crate::point) fn select(items: &mut [Item], count: usize, axis: usize) {
    if count == 0 || count >= items.len() {
        return;
    }
    match axis {
        0 => select_axis::<0>(items, count),
        1 => select_axis::<1>(items, count),
        _ => select_axis::<2>(items, count),
    }
}

fn select_axis<const AXIS: usize>(items: &mut [Item], count: usize) {
    items.select_nth_unstable_by(count, |a, b| {
        a.at[AXIS].partial_cmp(&b.at[AXIS]).unwrap_or(core::cmp::Ordering::Equal)
    });
}
