//! The random generator of scenes, tests and measurements.

/// The SplitMix64 generator (Steele, Lea and Flood, 2014): one 64-bit state, integer arithmetic only, so the same numbers on every
/// machine. Returns 64 random bits.
pub fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
