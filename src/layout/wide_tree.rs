//! A finished wide tree.

use super::wide_node::{ChildRef, Kind, node_rows};
use crate::geometry::{KeyTime, TimeInterval};
use crate::layout::leaf::ids::ids_of_leaf;
use crate::layout::leaf::keyed::KeyedRows;
use crate::simd::{Arena, LANES};

/// A built tree: the arena and the root.
#[derive(Clone)]
pub(crate) struct WideTree {
    pub arena: Arena,
    pub root: ChildRef,
    /// Leaf blocks of kind `OtherLeaf` at or after this word are lists of ids. 0 if the set has no triangles.
    pub lists: usize,
    /// Whether several leaf blocks may hold parts of one primitive.
    pub(crate) presplit: bool,
    /// Whether hierarchies of time slices lack primitives that do not exist in them, or have boxes without these.
    pub(crate) leaves_out: bool,
    /// The active interval of each mesh and, after these, of each shape when the tree was built, if the tree lacks them at other
    /// times. None in a tree from a file, which is not refitted.
    pub(crate) existing: Vec<TimeInterval>,
    /// The greatest number of time slices that have leaf blocks of their own.
    pub(crate) slices: usize,
    /// Where blocks of many keys mostly have the rows of a time.
    pub(crate) keyed_rows: KeyedRows,
    /// Rays that begin farther from the origin of tree space are traversed in pieces (`near.rs`); infinite if none are.
    pub(crate) near: f32,
    /// A leaf block for each triangle; for triangles with more than two keys one per time slice.
    pub(crate) blocks: Vec<u32>,
    /// Which visibility masks are in a block.
    pub(crate) masks: BlockMasks,
    /// When something in a block exists.
    pub(crate) intervals: BlockIntervals,
    pub(crate) counts: Counts,
}

/// The counts of a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Counts {
    /// Depth of the deepest leaf; the root has depth 0.
    pub depth: u32,
    pub nodes: usize,
    pub moving_nodes: usize,
    pub leaves: usize,
    /// Nodes that select a child by time.
    pub time_nodes: usize,
    pub references: usize,
    /// Those of them in leaf blocks of static triangles.
    pub static_references: usize,
}

/// For each block of a tree the union of the visibility masks of all primitives in it.
#[derive(Clone)]
pub(crate) struct BlockMasks {
    /// The union for the whole tree.
    pub(super) all: u32,
    /// The bits that all primitives have.
    pub(super) common: u32,
    /// The unions by the first cache line of a block; empty if all primitives have the same mask.
    pub(super) by_line: Vec<u32>,
}

impl BlockMasks {
    /// Nothing is hidden from any query.
    pub(super) const UNKNOWN: BlockMasks = BlockMasks { all: u32::MAX, common: 0, by_line: Vec::new() };

    /// The union of the masks in a block.
    #[inline(always)]
    pub(super) fn union(&self, block: ChildRef) -> u32 {
        self.by_line.get(block.at() / LANES).copied().unwrap_or(self.all)
    }

    /// Whether a query with this mask, or with none, sees nothing in a block.
    #[inline(always)]
    pub fn hide(&self, block: ChildRef, from: Option<u32>) -> bool {
        from.is_some_and(|wanted| wanted & self.union(block) == 0)
    }

    /// Whether a query with this mask is known to see everything.
    pub fn hide_nothing_from(&self, mask: u32) -> bool {
        mask & self.common != 0
    }

    pub fn bytes(&self) -> usize {
        self.by_line.capacity() * size_of::<u32>()
    }
}

/// For each block of a tree the least interval that holds the active intervals of all primitives in it.
#[derive(Clone, Debug, Default)]
pub(crate) struct BlockIntervals {
    /// By the first cache line of a block; empty if all primitives exist throughout the shutter.
    pub(super) by_line: Vec<TimeInterval>,
}

impl BlockIntervals {
    /// Whether nothing in a block exists at a time.
    #[inline(always)]
    pub fn exclude(&self, block: ChildRef, time: f32) -> bool {
        self.by_line.get(block.at() / LANES).is_some_and(|active| !active.contains(time))
    }

    pub fn bytes(&self) -> usize {
        self.by_line.capacity() * size_of::<TimeInterval>()
    }
}

impl WideTree {
    /// For each block, by its first cache line, the union of what all leaf blocks below it have. `nothing` is that of no blocks.
    pub(super) fn unions<T: Copy>(
        &self,
        nothing: T,
        of_leaf: impl Fn(ChildRef) -> T,
        unite: impl Fn(T, T) -> T,
    ) -> Vec<T> {
        let mut by_line = vec![nothing; self.arena.ints().len() / LANES];
        // Parents before children; leaf blocks at once, since several nodes may share them.
        let (mut nodes, mut stack) = (Vec::new(), vec![self.root]);
        stack.retain(|&root| root != ChildRef::NOTHING);
        while let Some(at) = stack.pop() {
            if at.kind().is_leaf() {
                by_line[at.at() / LANES] = of_leaf(at);
                continue;
            }
            nodes.push(at);
            stack.extend(self.children(at));
        }
        for &node in nodes.iter().rev() {
            let below = self.children(node).fold(nothing, |all, child| unite(all, by_line[child.at() / LANES]));
            by_line[node.at() / LANES] = below;
        }
        by_line
    }

    /// A tree without nodes, whose blocks are lists of ids from word `lists` on.
    pub(super) fn empty(lists: usize) -> WideTree {
        WideTree {
            arena: Arena::default(),
            root: ChildRef::NOTHING,
            lists,
            presplit: false,
            leaves_out: false,
            existing: Vec::new(),
            slices: 1,
            keyed_rows: KeyedRows::default(),
            near: f32::INFINITY,
            blocks: Vec::new(),
            masks: BlockMasks::UNKNOWN,
            intervals: BlockIntervals::default(),
            counts: Counts::default(),
        }
    }

    /// The first of the meshes and shapes with these active intervals that the tree lacks at some of their times.
    pub fn first_lacking(&self, active: impl Iterator<Item = TimeInterval>) -> Option<usize> {
        self.existing.iter().zip(active).position(|(&held, now)| held.hull(now) != held)
    }

    /// The number of time slices with a hierarchy of their own for all primitives; 1 without a temporal split at the
    /// root.
    pub fn time_slices(&self) -> usize {
        if self.root.kind() == Kind::Time { self.arena.ints()[self.root.at()] as usize } else { 1 }
    }

    /// The child of a time node at a time.
    pub fn child_at(&self, node: ChildRef, time: f32) -> ChildRef {
        let slices = self.slots(node);
        ChildRef(slices[KeyTime::new(time, slices.len() + 1).segment])
    }

    /// The references to the children of a block: sixteen in a node, not all of which need be there, one per slice in a time node,
    /// none in a leaf.
    pub fn slots(&self, of: ChildRef) -> &[u32] {
        let words = self.arena.ints();
        match of.kind() {
            Kind::Node | Kind::StaticNode => &words[of.at() + (node_rows(of.kind()) - 1) * LANES..][..LANES],
            Kind::Time => &words[of.at() + 1..][..words[of.at()] as usize],
            _ => &[],
        }
    }

    /// The children of a block.
    pub fn children(&self, of: ChildRef) -> impl Iterator<Item = ChildRef> {
        self.lanes(of).map(|(_, child)| child)
    }

    /// The lanes of a node that have a child, with the children.
    pub fn lanes(&self, node: ChildRef) -> impl Iterator<Item = (usize, ChildRef)> {
        let children = self.slots(node).iter().map(|&child| ChildRef(child)).enumerate();
        children.filter(|&(_, child)| child != ChildRef::NOTHING)
    }

    /// The leaf blocks below a block, or the block itself if it is one. Below a time node some may occur several times.
    pub fn leaves_below(&self, root: ChildRef) -> Vec<ChildRef> {
        let (mut leaves, mut stack) = (Vec::new(), vec![root]);
        while let Some(at) = stack.pop() {
            match at.kind().is_leaf() {
                true => leaves.push(at),
                false => stack.extend(self.children(at)),
            }
        }
        leaves
    }

    /// Whether a leaf block is a list of ids.
    #[inline(always)]
    pub fn is_list(&self, leaf: ChildRef) -> bool {
        leaf.kind() == Kind::OtherLeaf && leaf.at() >= self.lists
    }

    /// The primitives of a leaf block; `None` if it is incomplete.
    pub fn ids(&self, of: ChildRef) -> Option<&[u32]> {
        let block = self.arena.ints().get(of.at()..)?;
        Some(&block[ids_of_leaf(of, block, self.is_list(of))?])
    }

    /// The greatest number of blocks on a query's stack, plus room to write one more node's children at once.
    ///
    /// The entries are children of visited nodes, families for short. Depths never decrease from the stack's bottom to
    /// its top, and there are at most two families of each depth. For a step removes the two topmost entries, or one,
    /// and pushes their children. If both were of the topmost family, their children's depth is new. If one was the
    /// last of its family, the other is in the family below; the deeper of the two has its children on top, and if both
    /// were equally deep, nothing was deeper.
    #[inline(always)]
    pub fn max_stack(&self) -> usize {
        2 * LANES * self.counts.depth as usize + LANES
    }

    /// Whether most nodes have boxes that move.
    pub fn moves(&self) -> bool {
        2 * self.counts.moving_nodes > self.counts.nodes
    }
}
