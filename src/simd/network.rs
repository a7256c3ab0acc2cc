//! Sorting lanes by a sorting network.
//!
//! Source: K. Batcher, "Sorting networks and their applications", 1968, in the form in which all comparisons point the
//! same way.

use super::instructions::Simd;
use super::lanes::Mask;

/// Compares lanes with their partners `i ^ D`; those in the mask receive the lesser value.
#[inline(always)]
fn compare<S: Simd, const D: usize>(s: S, x: S::U, lesser: Mask) -> S::U {
    let partner = s.swap_lanes_u::<D>(x);
    s.select_u(lesser, s.min_u(x, partner), s.max_u(x, partner))
}

/// Sorts the lanes of a vector.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[inline(always)]
pub(super) fn sort_network<S: Simd>(s: S, x: S::U) -> S::U {
    let x = compare::<S, 1>(s, x, 0x5555);
    let x = compare::<S, 1>(s, compare::<S, 3>(s, x, 0x3333), 0x5555);
    let x = compare::<S, 1>(s, compare::<S, 2>(s, compare::<S, 7>(s, x, 0x0f0f), 0x3333), 0x5555);
    let x = compare::<S, 4>(s, compare::<S, 15>(s, x, 0x00ff), 0x0f0f);
    compare::<S, 1>(s, compare::<S, 2>(s, x, 0x3333), 0x5555)
}

/// Sorts the lanes of a bitonic vector: one that ascends to some lane and descends from there, or the other way round.
#[inline(always)]
pub(crate) fn merge_lanes<S: Simd>(s: S, x: S::U) -> S::U {
    let x = compare::<S, 4>(s, compare::<S, 8>(s, x, 0x00ff), 0x0f0f);
    compare::<S, 1>(s, compare::<S, 2>(s, x, 0x3333), 0x5555)
}
