//! Points: one on its way into a leaf, and the sixteen of a block in rows.

use super::huge_pages::huge_vec;
use super::lanes::{LANES, Lanes};
use crate::parallel::{self, CHUNK};
use core::mem::MaybeUninit;

/// A point during the build, before it is in a leaf: its position (at mid-shutter) and its index.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(crate) struct Item {
    pub(crate) at: [f32; 3],
    pub(crate) index: u32,
}

/// Sixteen points in rows; unused lanes have infinite coordinates.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct PointBlock {
    pub(crate) at: [Lanes<f32>; 3],
    pub(crate) id: Lanes<u32>,
}

/// Sixteen moving points in rows; absent ones have coordinates for which every squared distance is infinite.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct MovingPointBlock {
    pub(crate) open: [Lanes<f32>; 3],
    pub(crate) close: [Lanes<f32>; 3],
    pub(crate) id: Lanes<u32>,
}

impl PointBlock {
    /// A block without points.
    pub(crate) const EMPTY: PointBlock = PointBlock { at: [[f32::INFINITY; LANES]; 3], id: [u32::MAX; LANES] };
}

impl MovingPointBlock {
    /// A block without points.
    pub(crate) const EMPTY: MovingPointBlock =
        MovingPointBlock { open: [[f32::MAX; LANES]; 3], close: [[f32::MAX; LANES]; 3], id: [u32::MAX; LANES] };
}

/// Blocks of sixteen points, in whose memory points lie during the build.
///
/// # Safety
///
/// A block is `repr(C)`, aligned to 64 bytes, and consists of at least 64 words, f32 and u32, without padding.
pub(crate) unsafe trait WordBlock: Copy + Send {
    /// So many blocks that hold zeros. They are written by all threads, so that the system maps their pages for all of them.
    fn zeroed(count: usize) -> Vec<Self> {
        let mut blocks: Vec<Self> = huge_vec(count);
        let mut chunks: Vec<_> = blocks.spare_capacity_mut()[..count].chunks_mut(CHUNK).collect();
        parallel::each(&mut chunks, |chunk| chunk.fill(MaybeUninit::zeroed()));
        // SAFETY: so many blocks were filled with zeros, which are values of all their words.
        unsafe { blocks.set_len(count) };
        blocks
    }

    /// The memory of blocks as four rows, each with a place for every point: three of coordinates, one of indices. What is
    /// written there reads as garbage in blocks until it is written again.
    fn rows(blocks: &mut [Self]) -> ([&mut [f32]; 3], &mut [u32]) {
        // Whole vectors, so that the rows are aligned like the blocks.
        let count = size_of_val(blocks) / size_of::<f32>() / 4 / LANES * LANES;
        let begin = blocks.as_mut_ptr().cast::<f32>();
        // SAFETY: the four rows together are not larger than the blocks, which are more strictly aligned; every bit pattern is
        // valid as both kinds of words; the borrow of the blocks is exclusive, and the four parts of their memory do not overlap.
        unsafe {
            let row = |i: usize| core::slice::from_raw_parts_mut(begin.add(i * count), count);
            ([row(0), row(1), row(2)], core::slice::from_raw_parts_mut(begin.add(3 * count).cast(), count))
        }
    }
}

const _: () = assert!(size_of::<PointBlock>() == 64 * size_of::<f32>());
const _: () = assert!(size_of::<MovingPointBlock>() == 112 * size_of::<f32>());

// SAFETY: four rows of sixteen words.
unsafe impl WordBlock for PointBlock {}

// SAFETY: seven rows of sixteen words.
unsafe impl WordBlock for MovingPointBlock {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_lie_in_the_memory_of_blocks() {
        let mut blocks = [PointBlock::EMPTY; 3];
        let ([x, y, z], index) = PointBlock::rows(&mut blocks);
        assert!([x.len(), y.len(), z.len(), index.len()] == [3 * LANES; 4]);
        x.fill(1.0);
        y.fill(2.0);
        z.fill(3.0);
        index.fill(4);
        assert_eq!(
            [blocks[0].at[0][0], blocks[1].at[1][3], f32::from_bits(blocks[2].id[15])],
            [1.0, 2.0, f32::from_bits(4)]
        );
        let (_, index) = PointBlock::rows(&mut blocks);
        assert!(index.iter().all(|&index| index == 4));
        let mut blocks = [MovingPointBlock::EMPTY; 3];
        let ([x, y, z], index) = MovingPointBlock::rows(&mut blocks);
        assert!([x.len(), y.len(), z.len(), index.len()] == [5 * LANES; 4]);
        index.fill(4);
        assert_eq!(blocks[2].close[0].map(f32::to_bits), [4; LANES]);
        assert_eq!(blocks[0].open[0], [f32::MAX; LANES]);
    }
}
