//! Leaves that a search has found near enough and not visited yet.
//!
//! Visiting each leaf as soon as it is found means a loop of unpredictable length in every bottom node, and each
//! misprediction of its end discards the loads in flight. A queue is filled without a branch and processed in one loop,
//! so that the leaves are loaded from memory concurrently. This gains more than the few leaves that a bound lowered in
//! between would have culled. Leaves of large trees are prefetched when they are queued.

use crate::point::layout::view::LeafView;
use crate::simd::{LANES, Mask, Simd, lanes_at_mut};
use crate::tuning::points::FAR;

/// The capacity of a queue.
const CAPACITY: usize = 4 * LANES;

/// The number of leaves that are visited together.
const BATCH: usize = LANES;

/// A queue of leaves, each as the index of its first block.
pub(in crate::point) struct LeafQueue {
    leaves: [u32; CAPACITY],
    count: usize,
}

/// Offsets of the lanes of a bottom node, in blocks, for leaves of one block and of two.
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
    /// An empty queue.
    #[inline(always)]
    pub(in crate::point) fn new() -> LeafQueue {
        LeafQueue { leaves: [0; CAPACITY], count: 0 }
    }

    /// Adds lanes of the bottom node whose first block is `first`. There must be room, as there is while the queue is
    /// not [ready](LeafQueue::is_ready).
    #[inline(always)]
    pub(in crate::point) fn push_lanes<S: Simd, V: LeafView>(&mut self, s: S, view: &V, first: usize, lanes: Mask) {
        let blocks = s.add_u(s.splat_u(first as u32), s.load_u(&OFFSETS[view.leaf_blocks() - 1]));
        s.store_compressed_u(blocks, lanes, lanes_at_mut(&mut self.leaves, self.count));
        let begin = self.count;
        self.count += lanes.count_ones() as usize;
        if view.leaf_bytes() > FAR {
            for &leaf in &self.leaves[begin..self.count] {
                view.prefetch_leaf(leaf as usize);
            }
        }
    }

    /// Adds a leaf; there must be room as well.
    #[inline(always)]
    pub(in crate::point) fn push(&mut self, block: usize) {
        self.leaves[self.count] = block as u32;
        self.count += 1;
    }

    /// Whether the leaves should be visited now.
    #[inline(always)]
    pub(in crate::point) fn is_ready(&self) -> bool {
        self.count > BATCH
    }

    /// Whether the queue is empty.
    #[inline(always)]
    pub(in crate::point) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Returns all leaves and empties the queue.
    #[inline(always)]
    pub(in crate::point) fn drain(&mut self) -> &[u32] {
        &self.leaves[..core::mem::take(&mut self.count)]
    }
}
