//! The greatest lanes of many vectors at once.

use super::instructions::Simd;
use super::lanes::LANES;

/// The greatest lane of each of sixteen vectors. No lane may be NaN.
#[inline(always)]
pub(crate) fn greatest_of_each<S: Simd>(s: S, mut all: [S::F; LANES]) -> S::F {
    // Each step halves the number of vectors, and the number of lanes that belong to one.
    for i in 0..8 {
        let (a, b) = (all[i], all[i + 8]);
        all[i] = s.max(s.select(0x00ff, a, b), s.swap_lanes::<8>(s.select(0x00ff, b, a)));
    }
    for i in 0..4 {
        let (a, b) = (all[i], all[i + 4]);
        all[i] = s.max(s.select(0x0f0f, a, b), s.swap_lanes::<4>(s.select(0x0f0f, b, a)));
    }
    for i in 0..2 {
        let (a, b) = (all[i], all[i + 2]);
        all[i] = s.max(s.select(0x3333, a, b), s.swap_lanes::<2>(s.select(0x3333, b, a)));
    }
    let [a, b, ..] = all;
    s.max(s.select(0x5555, a, b), s.swap_lanes::<1>(s.select(0x5555, b, a)))
}
