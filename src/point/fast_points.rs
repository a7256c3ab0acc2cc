//! Detecting points that move far relative to their neighbours.

use super::moving_reference::{MovingReference, TimeSlice, positions_at};
use super::order::{Item, order};
use super::widest_axis::include;
use crate::progress::Progress;
use crate::simd::LANES;
use crate::tuning::points::FAST;

/// Marks the references that move far during a time slice, relative to their neighbours at a phase of it.
pub(super) fn mark_fast(references: &mut [MovingReference], slice: &TimeSlice, phase: f64) {
    let mut items = positions_at(references, phase);
    order(&mut items, LANES, &Progress::new(None));
    let mut sizes: Vec<f32> = items.chunks(LANES).map(size).collect();
    let Some(half) = sizes.len().checked_sub(1).map(|last| last / 2) else { return };
    let own = sizes.clone();
    let (_, &mut median, _) = sizes.select_nth_unstable_by(half, f32::total_cmp);
    for (leaf, size) in items.chunks(LANES).zip(own) {
        let least = f64::from(size.min(median));
        let displacement = |m: &MovingReference, axis: usize| f64::from(m.close[axis]) - f64::from(m.open[axis]);
        let usual: [f64; 3] = core::array::from_fn(|axis| {
            let mut row = [0.0; LANES];
            let row = &mut row[..leaf.len()];
            row.iter_mut().zip(leaf).for_each(|(x, item)| *x = displacement(&references[item.index as usize], axis));
            row.sort_unstable_by(f64::total_cmp);
            row[row.len() / 2]
        });
        for item in leaf {
            let m = &mut references[item.index as usize];
            let far = (0..3).map(|a| (displacement(m, a) - usual[a]).abs()).fold(0.0, f64::max);
            let [begin, end] = m.range(slice);
            m.fast = far * (end - begin) > FAST * least;
        }
    }
}

/// The longest side of the box around some positions.
fn size(leaf: &[Item]) -> f32 {
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for item in leaf {
        include(&mut lo, &mut hi, item.at);
    }
    (hi[0] - lo[0]).max(hi[1] - lo[1]).max(hi[2] - lo[2])
}
