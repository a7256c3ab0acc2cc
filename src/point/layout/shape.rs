//! The shape of a complete tree: how many nodes its levels have, and where they begin.

use crate::limits::MAX_LEVELS;
use crate::simd::LANES;

/// Sizes of a complete tree.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct Shape {
    /// Blocks per leaf.
    pub(in crate::point) leaf_blocks: usize,
    /// Number of levels of nodes, at least one.
    pub(in crate::point) levels: usize,
    /// Number of the first node of each level; behind the last level, the number of nodes.
    pub(in crate::point) begin: [usize; MAX_LEVELS + 1],
}

impl Shape {
    /// The shape with leaves of two blocks where that saves a level, otherwise of one.
    pub(in crate::point) fn flattest(count: usize) -> Shape {
        let (one, two) = (Shape::with_leaf(count, 1), Shape::with_leaf(count, 2));
        if two.levels < one.levels { two } else { one }
    }

    /// The shape with a given number of blocks per leaf.
    pub(in crate::point) fn with_leaf(count: usize, leaf_blocks: usize) -> Shape {
        let mut shape = Shape { leaf_blocks, levels: 0, begin: [0; MAX_LEVELS + 1] };
        let mut wide = count.div_ceil(leaf_blocks * LANES).max(1);
        while shape.levels == 0 || wide > 1 {
            wide = wide.div_ceil(LANES);
            shape.begin[shape.levels + 1] = shape.begin[shape.levels] + wide;
            shape.levels += 1;
        }
        shape
    }

    /// Points per leaf.
    pub(in crate::point) fn leaf(&self) -> usize {
        self.leaf_blocks * LANES
    }

    /// All nodes with their levels, and how many of the lanes of each have a child, where there are so many leaves.
    pub(in crate::point) fn lanes(&self, leaves: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.levels).flat_map(move |level| {
            let begin = self.begin[level];
            let (first, end) = if level == 0 { (0, leaves) } else { (self.begin[level - 1], begin) };
            (begin..self.begin[level + 1])
                .map(move |node| (node, end.saturating_sub(first + (node - begin) * LANES).min(LANES)))
        })
    }

    /// Number of nodes.
    pub(in crate::point) fn nodes(&self) -> usize {
        self.begin[self.levels]
    }

    /// Level and number of the root.
    #[inline(always)]
    pub(in crate::point) fn root(&self) -> (usize, usize) {
        (self.levels - 1, self.nodes() - 1)
    }

    /// The node, or block on level 0, of lane 0 of a node, and the stride from lane to lane.
    pub(in crate::point) fn children(&self, level: usize, node: usize) -> (usize, usize) {
        match level {
            0 => (node * LANES * self.leaf_blocks, self.leaf_blocks),
            _ => (self.first_child(level, node), 1),
        }
    }

    /// The first child of a node above level 0.
    #[inline(always)]
    pub(in crate::point) fn first_child(&self, level: usize, node: usize) -> usize {
        self.begin[level - 1] + (node - self.begin[level]) * LANES
    }
}
