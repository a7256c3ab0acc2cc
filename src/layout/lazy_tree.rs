//! A wide tree whose subtrees are built when queries first reach them.
//!
//! The coarse top is an ordinary wide tree whose leaves list one *subtree* each. A subtree has up to some thousand primitives, which
//! object splits of coarse cells put together. It becomes an ordinary wide tree over its primitives, in the same tree space, built by the
//! first query that enters it.
//!
//! The boxes of the coarse tree hold their contents over the whole shutter. So the coarse tree has no time nodes, its build decides
//! nothing by samples, and no primitive is split.
//!
//! **Why no two threads wait for each other.** The thread that builds a subtree does so alone ([`crate::parallel::alone`]) and does not query
//! the tree. All other threads that need the same subtree wait for this one build, and hold no subtree of their own meanwhile.

use super::leaf_block::{WideSource, write_list};
use super::statistics::Statistics;
use super::tree_box::TreeBox;
use super::wide_builder::{most_in_subtree, step};
use super::wide_node::ChildRef;
use super::wide_tree::{BlockMasks, WideTree};
use super::write::Nodes;
use crate::bvh::{BinaryNode, Collapse, coarse_tree};
use crate::error::BuildError;
use crate::geometry::{Frame, LaneBounds, TimeInterval};
use crate::params::{LazyParams, WideParams};
use crate::primitive::VertexTubes;
use crate::progress::Progress;
use crate::simd::{Arena, LANES};
use crate::time::COST_MODEL;
use std::sync::OnceLock;

/// The coarse tree, and the subtrees below it.
pub(crate) struct LazyTree {
    /// The tree above the subtrees: each leaf lists the number of one subtree.
    pub top: WideTree,
    /// The primitives of all subtrees, one subtree after the other.
    ids: Vec<u32>,
    subtrees: Vec<Subtree>,
    /// How subtrees are built.
    params: WideParams,
}

/// Some primitives, and the tree over them once a query has needed it.
struct Subtree {
    /// The position of its first id.
    first: u32,
    tree: OnceLock<WideTree>,
}

impl LazyTree {
    /// Divides the primitives of a set into subtrees, and builds the tree above them.
    pub fn build<S: WideSource>(set: &S, params: &LazyParams, progress: &Progress) -> Result<LazyTree, BuildError> {
        let over = TimeInterval::FULL;
        let most = params.subtree.min(most_in_subtree(set));
        let bounds = |ids: &[u32], out: &mut [LaneBounds]| set.lane_bounds(ids, over, &VertexTubes::default(), out);
        let (binary, ids) = coarse_tree(set.len(), &bounds, most);
        step(progress, 0.5)?;
        // In preorder, the leaves are in the order of their primitives.
        let leaves = binary.iter().filter(|node| node.right == 0);
        let subtrees: Vec<Subtree> = leaves.map(|leaf| Subtree { first: leaf.first, tree: OnceLock::new() }).collect();
        let top = top(&binary, &subtrees, over)?;
        step(progress, 0.5)?;
        let mut tree = LazyTree { top, ids, subtrees, params: params.wide };
        tree.top.masks = BlockMasks::of(&tree.top, set, |leaf| Some(tree.primitives(tree.below(leaf))));
        Ok(tree)
    }

    /// The number of subtrees.
    pub(super) fn len(&self) -> usize {
        self.subtrees.len()
    }

    /// The number of the subtree that a leaf of the coarse tree lists.
    pub fn below(&self, leaf: ChildRef) -> u32 {
        self.top.arena.ints()[leaf.at()]
    }

    /// A subtree, which is built now if it has not been built yet. `set` is the one of the build.
    pub fn subtree<S: WideSource>(&self, set: &S, subtree: u32) -> &WideTree {
        self.subtrees[subtree as usize].tree.get_or_init(|| {
            WideTree::subtree(set, self.primitives(subtree), &self.params)
                .expect("the build made no subtree too large for a tree")
        })
    }

    /// The primitives of a subtree.
    pub(super) fn primitives(&self, subtree: u32) -> &[u32] {
        let first = |i: usize| self.subtrees.get(i).map_or(self.ids.len(), |subtree| subtree.first as usize);
        &self.ids[first(subtree as usize)..first(subtree as usize + 1)]
    }

    /// A subtree, if it has been built.
    pub(super) fn built(&self, subtree: u32) -> Option<&WideTree> {
        self.subtrees[subtree as usize].tree.get()
    }

    /// Statistics of the subtrees that have been built.
    pub fn statistics<S: WideSource>(&self, set: &S) -> Statistics {
        let mut all = self.top.statistics(set);
        let above = all.depth;
        (all.leaves, all.references) = (0, 0);
        all.subtrees = self.len();
        all.bytes += self.ids.capacity() * size_of::<u32>() + self.subtrees.capacity() * size_of::<Subtree>();
        let mut primitives = 0;
        for (subtree, tree) in (0..).map(|subtree| (subtree, self.built(subtree))).take(self.len()) {
            let Some(tree) = tree else { continue };
            let of = tree.statistics(set);
            primitives += self.primitives(subtree).len();
            all.built_subtrees += 1;
            all.depth = all.depth.max(above + of.depth);
            all.nodes += of.nodes;
            all.leaves += of.leaves;
            all.references += of.references;
            all.static_references += of.static_references;
            all.time_nodes += of.time_nodes;
            all.bytes += of.bytes;
        }
        all.duplicates = (all.references - primitives) as f64 / all.references.max(1) as f64;
        all
    }

    /// The boxes of the subtrees that have been built, as [`WideTree::boxes`] gives them.
    pub fn boxes(&self, time: f32, frame: Frame, visitor: &mut impl FnMut(TreeBox)) {
        self.top.boxes(time, frame, 1, &mut |b, child| {
            let below = if b.leaf { self.built(self.below(child)) } else { None };
            visitor(TreeBox { leaf: b.leaf && below.is_none_or(|tree| tree.root.kind().is_leaf()), ..b });
            if let Some(tree) = below {
                tree.boxes(time, frame, b.level + 1, &mut |b, _| visitor(b));
            }
        });
    }
}

/// The tree above the subtrees, which are the leaves of a binary tree.
fn top(binary: &[BinaryNode], subtrees: &[Subtree], over: TimeInterval) -> Result<WideTree, BuildError> {
    let mut top = WideTree::empty(0);
    if binary.is_empty() {
        return Ok(top);
    }
    // Each subtree is a leaf, whatever its cost.
    let collapse = Collapse::new(binary, COST_MODEL, |node| (node.right == 0).then_some(COST_MODEL.leaf_of(LANES)));
    let leaves = |arena: &mut Arena, of: &[BinaryNode], lists: &mut [ChildRef]| {
        for (node, list) in of.iter().zip(lists) {
            let subtree = subtrees.partition_point(|subtree| subtree.first < node.first);
            *list = write_list(arena, &[subtree as u32]).ok_or(BuildError::TooLargeTree)?;
        }
        Ok(())
    };
    top.root = Nodes { binary, collapse: &collapse, over, leaves: &leaves, writes: true }.write(&mut top.arena)?;
    top.arena.align();
    top.arena.compact();
    top.counts = top.counted_nodes();
    Ok(top)
}
