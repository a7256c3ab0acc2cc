//! The subtrees of a complete tree: all are full except the last on each level.

use crate::simd::LANES;

/// Points below a child of the root: the largest full subtree that does not hold all.
pub(in crate::point) fn subtree(count: usize, leaf: usize) -> usize {
    let mut block = leaf;
    while block * LANES < count {
        block *= LANES;
    }
    block
}

/// Points of each of the subtrees that a range of `count` points consists of, at most `block`; none where it is one leaf.
pub(in crate::point) fn subtrees_of(count: usize, mut block: usize, leaf: usize) -> Option<usize> {
    while count <= block {
        if block == leaf {
            return None;
        }
        block /= LANES;
    }
    Some(block)
}

/// Points in the left half of a range that consists of subtrees of `block` points.
pub(in crate::point) fn left_part(count: usize, block: usize) -> usize {
    count.div_ceil(block).div_ceil(2) * block
}
