//! The transpose of sixteen vectors.

use super::instructions::Simd;
use super::lanes::{LANES, Mask};

/// Lane `j` of vector `i` becomes lane `i` of vector `j`.
#[inline(always)]
pub(crate) fn transpose<S: Simd>(s: S, mut all: [S::F; LANES]) -> [S::F; LANES] {
    exchange::<S, 8>(s, &mut all, 0x00ff);
    exchange::<S, 4>(s, &mut all, 0x0f0f);
    exchange::<S, 2>(s, &mut all, 0x3333);
    exchange::<S, 1>(s, &mut all, 0x5555);
    all
}

/// Transposes the blocks of `D` by `D` lanes in each block of `2 D` by `2 D`; `first` are the lanes without the bit `D`.
#[inline(always)]
fn exchange<S: Simd, const D: usize>(s: S, all: &mut [S::F; LANES], first: Mask) {
    for pair in 0..LANES / 2 {
        // The bits of the pair around the bit `D`.
        let i = pair / D * 2 * D + pair % D;
        let (a, b) = (all[i], all[i + D]);
        all[i] = s.select(first, a, s.swap_lanes::<D>(b));
        all[i + D] = s.select(first, s.swap_lanes::<D>(a), b);
    }
}
