//! Points that move far relative to their neighbours.

use super::moving_reference::{Mover, Part};
use super::order::{Item, order};
use crate::simd::LANES;

/// A mover is fast when it moves farther, relative to its neighbours, than this many times the size of
/// the leaf they would share.
const FAST: f64 = 2.0;

/// Marks the movers that move far relative to their neighbours, to be cut at planes.
pub(super) fn mark_fast(movers: &mut [Mover], part: &Part) {
    let mut items = places(movers, part);
    order(&mut items, LANES);
    for leaf in items.chunks(LANES) {
        let mut way = [[0.0; LANES]; 3];
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (lane, item) in leaf.iter().enumerate() {
            let m = &movers[item.index as usize];
            for axis in 0..3 {
                way[axis][lane] = f64::from(m.close[axis]) - f64::from(m.open[axis]);
                lo[axis] = lo[axis].min(item.at[axis].into());
                hi[axis] = hi[axis].max(item.at[axis].into());
            }
        }
        let size = (hi[0] - lo[0]).max(hi[1] - lo[1]).max(hi[2] - lo[2]);
        let usual = way.map(|mut row| {
            let row = &mut row[..leaf.len()];
            row.sort_unstable_by(f64::total_cmp);
            row[row.len() / 2]
        });
        for (lane, item) in leaf.iter().enumerate() {
            let m = &mut movers[item.index as usize];
            let far = (0..3).map(|a| (way[a][lane] - usual[a]).abs()).fold(0.0, f64::max) * m.span(part).duration();
            m.cut = far > FAST * size;
        }
    }
}

/// Where movers are at mid-part.
pub(super) fn places(movers: &[Mover], part: &Part) -> Vec<Item> {
    let phase = f64::from(part.phase(part.middle()));
    let place = |(index, m): (usize, &Mover)| Item {
        at: core::array::from_fn(|axis| m.at(axis, phase) as f32),
        index: index as u32,
    };
    movers.iter().enumerate().map(place).collect()
}
