//! Morton codes: the order of cells along a space-filling curve that preserves locality.

/// The position of a cell on the curve, from the low 21 bits of its coordinates.
#[inline]
pub(crate) fn morton_code([x, y, z]: [u32; 3]) -> u64 {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

/// The low 21 bits of `x`, two zero bits after each.
fn spread(x: u32) -> u64 {
    let mut x = u64::from(x.min((1 << 21) - 1));
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_the_coordinates_are_interleaved() {
        assert_eq!(morton_code([0b101, 0b010, 0b011]), 0b001_110_101);
        assert_eq!(morton_code([u32::MAX; 3]), (1 << 63) - 1);
    }
}
