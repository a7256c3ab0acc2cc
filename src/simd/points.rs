//! Sixteen points in 256 bytes: as items while they are sorted, then in rows.

use super::lanes::{LANES, Lanes};

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

const _: () = assert!(size_of::<PointBlock>() == LANES * size_of::<Item>());

impl PointBlock {
    /// A block without points.
    pub(crate) const EMPTY: PointBlock = PointBlock { at: [[f32::INFINITY; LANES]; 3], id: [u32::MAX; LANES] };

    /// The memory of blocks as items, sixteen in each. After items are written, rows are garbage until they are written
    /// again.
    pub(crate) fn items(blocks: &mut [PointBlock]) -> &mut [Item] {
        let count = blocks.len() * LANES;
        // SAFETY: a block is as large as sixteen items and more strictly aligned; both are `repr(C)`, consist of f32
        // and u32 without padding, of which every bit pattern is valid; the borrow of the blocks is exclusive.
        unsafe { core::slice::from_raw_parts_mut(blocks.as_mut_ptr().cast(), count) }
    }

    /// The first `count` items in this memory, at most sixteen; the rest is padding.
    pub(crate) fn take_items(&mut self, count: usize) -> ([Item; LANES], usize) {
        let items = PointBlock::items(core::slice::from_mut(self));
        (core::array::from_fn(|i| items[i]), count.min(LANES))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_lie_in_the_memory_of_blocks() {
        let mut blocks = [PointBlock::EMPTY; 3];
        let items = PointBlock::items(&mut blocks);
        assert_eq!(items.len(), 3 * LANES);
        for (index, item) in (0..).zip(items) {
            *item = Item { at: [index as f32, 0.5, -1.0], index };
        }
        let (items, count) = blocks[1].take_items(5);
        assert_eq!((items[4].at, items[4].index, count), ([20.0, 0.5, -1.0], 20, 5));
    }
}
