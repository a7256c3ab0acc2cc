//! Counts what a finished tree holds.

use super::build::WideTree;
use super::layout::{ChildRef, Kind, NODE_ROWS, STILL_NODE_ROWS};
use crate::motion::PrimitiveSet;
use crate::simd::LANES;
use crate::tree::Statistics;

impl WideTree {
    /// The children of a block: of a node its sixteen, of a time node its parts, of a leaf none.
    pub fn children(&self, of: ChildRef) -> &[u32] {
        let words = self.arena.ints();
        let row = |rows: usize| &words[of.at() + (rows - 1) * LANES..][..LANES];
        match of.kind() {
            Kind::Node => row(NODE_ROWS),
            Kind::StillNode => row(STILL_NODE_ROWS),
            Kind::Time => &words[of.at() + 1..][..words[of.at()] as usize],
            Kind::Leaf | Kind::StillLeaf | Kind::ListLeaf | Kind::KeyedLeaf | Kind::Nothing => &[],
        }
    }

    /// Walks the whole tree once.
    pub fn statistics(&self, set: &impl PrimitiveSet) -> Statistics {
        let (mut nodes, mut depth) = (0, 0);
        let mut leaves = Vec::new();
        let mut stack = vec![(self.root, 0)];
        while let Some((at, level)) = stack.pop() {
            depth = depth.max(level);
            match at.kind() {
                Kind::Nothing => {}
                Kind::Node | Kind::StillNode | Kind::Time => {
                    nodes += 1;
                    stack.extend(self.children(at).iter().map(|&c| (ChildRef(c), level + 1)));
                }
                Kind::Leaf | Kind::StillLeaf | Kind::ListLeaf | Kind::KeyedLeaf => leaves.push(at.0),
            }
        }
        // Time parts share leaf blocks.
        leaves.sort_unstable();
        leaves.dedup();
        let references: usize = leaves.iter().map(|&leaf| ChildRef(leaf).len()).sum();
        let duplicates = references - set.len().min(references);
        Statistics {
            primitives: set.len(),
            nodes,
            leaves: leaves.len(),
            empty_leaves: 0,
            depth,
            references,
            duplicates: duplicates as f64 / references.max(1) as f64,
            timed: 0.0,
            duplication_time: 0.0,
            propagation_time: 0.0,
            bytes: self.arena.bytes(),
            primitive_bytes: set.bytes(),
        }
    }
}
