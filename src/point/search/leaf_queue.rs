//! Leaves that a search has found near enough and not looked at yet.
//!
//! Looking at each leaf as soon as it is found means a loop of unforeseeable length in every bottom node, and each
//! wrong guess of the processor where it ends throws away the loads that were under way. A list is filled without a
//! branch and gone through in one loop, so that the leaves come from memory all at once. This is worth more than
//! the few leaves that a bound lowered in between would have spared. Leaves of big trees are asked for as they are
//! listed.

use crate::point::snapshot::Leaves;
use crate::simd::{LANES, Mask, Simd};
use crate::tuning::points::FAR;

/// Most leaves on a list.
const CAPACITY: usize = 4 * LANES;

/// Leaves that are worth being gone through together.
const BATCH: usize = LANES;

/// A list of leaves, each as the number of its first block.
pub(in crate::point) struct LeafQueue {
    leaves: [u32; CAPACITY],
    count: usize,
}

/// How far lanes of a bottom node are apart, in blocks, for leaves of one block and of two.
static OFFSETS: [[u32; LANES]; 2] = {
    let mut offsets = [[0; LANES]; 2];
    let mut lane = 0;
    while lane < LANES {
        offsets[0][lane] = lane as u32;
        offsets[1][lane] = 2 * lane as u32;
        lane += 1;
    }
    offsets
};

impl LeafQueue {
    /// An empty list.
    #[inline(always)]
    pub(in crate::point) fn new() -> LeafQueue {
        LeafQueue { leaves: [0; CAPACITY], count: 0 }
    }

    /// Adds lanes of the bottom node whose first block is `first`. There must be room, as there is after `many` was
    /// false.
    #[inline(always)]
    pub(in crate::point) fn push_lanes<S: Simd, V: Leaves>(&mut self, s: S, view: &V, first: usize, lanes: Mask) {
        let to: &mut [u32; LANES] = (&mut self.leaves[self.count..self.count + LANES]).try_into().expect("sixteen");
        let blocks = s.add_u(s.splat_u(first as u32), s.load_u(&OFFSETS[view.leaf_blocks() - 1]));
        s.store_compressed_u(blocks, lanes, to);
        let begin = self.count;
        self.count += lanes.count_ones() as usize;
        if view.leaf_bytes() > FAR {
            for &leaf in &self.leaves[begin..self.count] {
                view.prefetch_leaf(leaf as usize);
            }
        }
    }

    /// Adds a leaf; there must be room likewise.
    #[inline(always)]
    pub(in crate::point) fn push(&mut self, block: usize) {
        self.leaves[self.count] = block as u32;
        self.count += 1;
    }

    /// Whether it is time to look at them.
    #[inline(always)]
    pub(in crate::point) fn is_ready(&self) -> bool {
        self.count > BATCH
    }

    /// Whether there are none.
    #[inline(always)]
    pub(in crate::point) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// All of them; the list is empty afterwards.
    #[inline(always)]
    pub(in crate::point) fn drain(&mut self) -> &[u32] {
        &self.leaves[..core::mem::take(&mut self.count)]
    }
}
