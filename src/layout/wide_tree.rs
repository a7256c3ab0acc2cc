//! A finished wide tree.

use super::keyed_leaf::KeyedRows;
use super::leaf_block::WideSource;
use super::leaf_ids::Ids;
use super::wide_node::{ChildRef, Kind, NODE_ROWS, STILL_NODE_ROWS};
use crate::simd::{Arena, LANES};

/// A built tree: the arena and where it begins.
pub(crate) struct WideTree {
    pub arena: Arena,
    pub root: ChildRef,
    /// Leaf blocks of the set's own that begin at this word or behind it are lists of ids.
    pub lists: usize,
    /// Whether parts of one primitive may be in several leaf blocks.
    pub(crate) presplit: bool,
    /// The most slices of the shutter that have leaf blocks of their own.
    pub(crate) slices: usize,
    /// Where blocks of many keys mostly have the rows of a time.
    pub(crate) keyed_rows: KeyedRows,
    /// A leaf block in which each triangle is; of those with more than two keys one for each of the slices.
    pub(crate) blocks: Vec<u32>,
    pub(crate) counts: Counts,
}

/// What was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Counts {
    /// Depth of the deepest leaf; the root has depth 0.
    pub depth: u32,
    pub nodes: usize,
    pub moving_nodes: usize,
    pub leaves: usize,
    /// Nodes that pick a child by time.
    pub time_nodes: usize,
    pub references: usize,
    /// Those of them in leaf blocks of triangles that stand still.
    pub still_references: usize,
}

impl WideTree {
    /// Parts of the shutter with a hierarchy of their own for all there is; 1 where it is not divided at the top.
    pub fn parts(&self) -> usize {
        if self.root.kind() == Kind::Time { self.arena.ints()[self.root.at()] as usize } else { 1 }
    }

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

    /// Whether a leaf block is a list of ids.
    #[inline(always)]
    pub fn is_list<S: WideSource>(&self, leaf: ChildRef) -> bool {
        !S::TRIANGLES || leaf.kind() == Kind::OwnLeaf && leaf.at() >= self.lists
    }

    /// The primitives of a leaf block; nothing where it is not a whole one.
    pub fn ids<S: WideSource>(&self, of: ChildRef) -> Option<&[u32]> {
        let block = self.arena.ints().get(of.at()..)?;
        let ids = Ids::of(of, block, self.is_list::<S>(of))?;
        Some(&block[ids.first..][..ids.count])
    }

    /// How many blocks can wait on a query's stack, and room for one more node's children to be written at once.
    ///
    /// What waits are children of visited nodes, families for short. Depths never fall from the stack's bottom to
    /// its top, and of each depth there are two families at most. For a step takes the two topmost entries away, or
    /// one, and puts their children there. Where both were of the topmost family, its children's depth is new. Where
    /// one was the last of its family, the other lies in the family below; the deeper of the two has its children
    /// on top, and if both were equally deep, there was nothing deeper.
    #[inline(always)]
    pub fn waiting(&self) -> usize {
        2 * LANES * self.counts.depth as usize + LANES
    }

    /// Whether most nodes have boxes that move.
    pub fn moves(&self) -> bool {
        2 * self.counts.moving_nodes > self.counts.nodes
    }
}
