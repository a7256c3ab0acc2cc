//! Numbers that are spread evenly but not at equal distances, so that a sample meets all parts of a short pattern in the order of
//! points.

/// The step of a low-discrepancy sequence: the fractional part of the golden ratio, times 2^64.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The `i`-th number of a sequence below `count` that is spread evenly.
pub(in crate::point) fn spread(i: usize, count: usize) -> usize {
    let fraction = (i as u64).wrapping_mul(GOLDEN).wrapping_add(1 << 63);
    ((u128::from(fraction) * count as u128) >> 64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_spread_evenly_and_meet_all_parts_of_short_patterns() {
        for count in [128, 256, 4096, 5000] {
            let mut in_parts = [0; 8];
            for i in 0..128 {
                in_parts[spread(i, count) * 8 / count] += 1;
            }
            assert!(in_parts.iter().all(|part| (14..=18).contains(part)), "{in_parts:?} of {count}");
            for period in [2, 3, 4, 5, 8] {
                let first = (0..128).filter(|&i| spread(i, count).is_multiple_of(period)).count();
                assert!((64 / period..=256 / period).contains(&first), "{first} of 128 at period {period} of {count}");
            }
        }
    }
}
