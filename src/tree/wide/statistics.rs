//! Counts what a finished tree holds.

use super::build::WideTree;
use super::layout::{ChildRef, Ids, Kind, NODE_ROWS, STILL_NODE_ROWS};
use super::leaf::WideSource;
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
            _ => &[],
        }
    }

    /// The primitives of a leaf block; nothing where it is not a whole one.
    pub fn ids<S: WideSource>(&self, of: ChildRef) -> Option<&[u32]> {
        let block = self.arena.ints().get(of.at()..)?;
        let ids = Ids::of(of, block, S::LISTS)?;
        Some(&block[ids.first..][..ids.count])
    }

    /// Depth of the deepest leaf.
    pub(super) fn deepest(&self) -> u32 {
        let mut deepest = 0;
        let mut stack = vec![(self.root, 0)];
        while let Some((at, depth)) = stack.pop() {
            deepest = deepest.max(depth);
            stack.extend(
                self.children(at).iter().map(|&c| (ChildRef(c), depth + 1)).filter(|c| c.0 != ChildRef::NOTHING),
            );
        }
        deepest
    }

    /// How many blocks can wait on a query's stack, and room for one more node's children to be written at once.
    ///
    /// What waits are children of visited nodes, families for short. Depths never fall from the stack's bottom to
    /// its top, and of each depth there are two families at most. For a step takes the two topmost entries away, or
    /// one, and puts their children there. Where both were of the topmost family, its children's depth is new. Where
    /// one was the last of its family, the other lies in the family below; the deeper pair of the two has children
    /// on top, and if both were equally deep, there was nothing deeper.
    #[inline(always)]
    pub fn waiting(&self) -> usize {
        2 * LANES * self.depth as usize + LANES
    }

    /// Walks the whole tree once.
    pub fn statistics<S: WideSource>(&self, set: &S) -> Statistics {
        let mut nodes = 0;
        let mut leaves = Vec::new();
        let mut stack = vec![self.root];
        stack.retain(|&at| at != ChildRef::NOTHING);
        while let Some(at) = stack.pop() {
            if at.kind().is_leaf() {
                leaves.push(at.0);
            } else {
                nodes += 1;
                let children = self.children(at).iter().map(|&c| ChildRef(c));
                stack.extend(children.filter(|&c| c != ChildRef::NOTHING));
            }
        }
        // Time parts share leaf blocks.
        leaves.sort_unstable();
        leaves.dedup();
        let count = |leaf: ChildRef| self.ids::<S>(leaf).map_or(0, <[u32]>::len);
        let references: usize = leaves.iter().map(|&leaf| count(ChildRef(leaf))).sum();
        let duplicates = references - set.len().min(references);
        Statistics {
            primitives: set.len(),
            nodes,
            leaves: leaves.len(),
            empty_leaves: 0,
            depth: self.depth,
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
