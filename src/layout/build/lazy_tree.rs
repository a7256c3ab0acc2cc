//! A wide tree whose subtrees are built when queries first reach them.
//!
//! The coarse top is an ordinary wide tree whose leaves list one *subtree* each. A subtree has up to some thousand primitives,
//! which object splits of coarse cells put together. It becomes an ordinary wide tree over its primitives, in the same tree space,
//! built by the first query that enters it.
//!
//! Whether subtrees divide the shutter and pre-split is decided for a *group* of neighbouring ones, by a sample, when the first of
//! them is built: deciding for each would often take as long as building it. The sample consists of small neighbourhoods in the
//! group's space, so it does not depend on the order of the primitives.
//!
//! The boxes of the coarse tree hold their contents over the whole shutter. So the coarse tree has no time nodes, its build decides
//! nothing by samples, and no primitive is split.
//!
//! **Why no two threads wait for each other.** The thread that builds a subtree does so alone ([`crate::parallel::alone`]) and does
//! not query the tree. All other threads that need the same subtree wait for this one build, and hold no subtree of their own
//! meanwhile. The same holds for the decision on a group, which a thread makes or waits for before it builds. (Functions of custom
//! primitives, which both call, must not wait for others either: see [`Primitive`](crate::Primitive).)

use super::budget::most_in_subtree;
use super::left_out::InSlices;
use super::write::Nodes;
use crate::bvh::{BinaryNode, Collapse, SurfaceDensity, coarse_tree, leaf_cost};
use crate::error::BuildError;
use crate::geometry::{Frame, LaneBounds, TimeInterval};
use crate::layout::leaf::source::WideSource;
use crate::layout::statistics::Statistics;
use crate::layout::tree_box::TreeBox;
use crate::layout::wide_node::{ChildRef, Kind};
use crate::layout::wide_tree::{BlockIntervals, BlockMasks, WideTree};
use crate::params::{LazyParams, WideParams};
use crate::progress::Progress;
use crate::simd::{Arena, LANES};
use crate::time::DraftParams;
use crate::tuning::lazy::{GROUP, NEIGHBOURS, PLACES};
use core::ops::Range;
use std::sync::OnceLock;

/// The coarse tree, and the subtrees below it.
#[derive(Clone)]
pub(crate) struct LazyTree {
    /// The tree above the subtrees: each leaf lists the number of one subtree.
    pub top: WideTree,
    /// The primitives of all subtrees, one subtree after the other.
    ids: Vec<u32>,
    subtrees: Vec<Subtree>,
    groups: Vec<Group>,
    params: WideParams,
}

/// Neighbouring subtrees, which are built alike.
#[derive(Clone)]
struct Group {
    /// The position of its first id.
    first: u32,
    /// How its subtrees are built, once one has been needed.
    decided: OnceLock<DraftParams>,
}

/// Some primitives, and the tree over them once a query has needed it.
#[derive(Clone)]
struct Subtree {
    /// The position of its first id.
    first: u32,
    tree: OnceLock<WideTree>,
}

/// The share of dividing primitives into subtrees in the build, about.
const DIVIDING: f64 = 0.98;

impl LazyTree {
    /// Divides the primitives of a set into subtrees, and builds the tree above them.
    pub fn build<S: WideSource>(set: &S, params: &LazyParams, progress: &Progress) -> Result<LazyTree, BuildError> {
        let most = params.subtree.min(most_in_subtree(set)?);
        let bounds = |ids: &[u32], out: &mut [LaneBounds]| set.lane_bounds(ids, TimeInterval::FULL, out);
        let (binary, ids) = coarse_tree(set.len(), &bounds, most, &progress.subtask(DIVIDING));
        progress.check()?;
        // In preorder, the leaves are in the order of their primitives.
        let leaves = binary.iter().filter(|node| node.right == 0);
        let subtrees: Vec<Subtree> = leaves.map(|leaf| Subtree { first: leaf.first, tree: OnceLock::new() }).collect();
        let top = top(&binary, &subtrees)?;
        let groups = groups(&binary, GROUP * most);
        let mut tree = LazyTree { top, ids, subtrees, groups, params: params.wide };
        tree.top.masks = BlockMasks::of(&tree.top, set, |leaf| Some(tree.primitives(tree.below(leaf))));
        tree.top.intervals = BlockIntervals::of(&tree.top, set, |leaf| Some(tree.primitives(tree.below(leaf))));
        Ok(tree)
    }

    /// The number of subtrees.
    pub(in crate::layout) fn len(&self) -> usize {
        self.subtrees.len()
    }

    /// The number of the subtree that a leaf of the coarse tree lists.
    pub fn below(&self, leaf: ChildRef) -> u32 {
        self.top.arena.ints()[leaf.at()]
    }

    /// A subtree, which is built now if it has not been built yet. `set` is the one of the build.
    pub fn subtree<S: WideSource>(&self, set: &S, subtree: u32) -> &WideTree {
        self.subtrees[subtree as usize].tree.get_or_init(|| {
            WideTree::subtree(set, self.primitives(subtree), self.decided(set, subtree))
                .expect("the build made no subtree too large for a tree")
        })
    }

    /// How a subtree is built.
    fn decided<S: WideSource>(&self, set: &S, subtree: u32) -> &DraftParams {
        let first = self.subtrees[subtree as usize].first;
        let after = self.groups.partition_point(|group| group.first <= first);
        let end = self.groups.get(after).map_or(self.ids.len(), |group| group.first as usize);
        let group = &self.groups[after - 1];
        let ids = group.first as usize..end;
        group.decided.get_or_init(|| WideTree::decided(set, &self.sample(set, ids), &self.params))
    }

    /// Neighbours around evenly spaced primitives of a group, whose ids are at these positions; sorted.
    fn sample<S: WideSource>(&self, set: &S, group: Range<usize>) -> Vec<u32> {
        let mut sample = Vec::new();
        for i in 0..PLACES {
            let at = group.start + (2 * i + 1) * group.len() / (2 * PLACES);
            let subtree = self.subtrees.partition_point(|subtree| subtree.first as usize <= at) - 1;
            sample.extend(neighbours(set, self.primitives(subtree as u32), self.ids[at]));
        }
        sample.sort_unstable();
        sample.dedup();
        sample
    }

    /// The primitives of a subtree.
    pub(in crate::layout) fn primitives(&self, subtree: u32) -> &[u32] {
        let first = |i: usize| self.subtrees.get(i).map_or(self.ids.len(), |subtree| subtree.first as usize);
        &self.ids[first(subtree as usize)..first(subtree as usize + 1)]
    }

    /// A subtree, if it has been built.
    pub(in crate::layout) fn built(&self, subtree: u32) -> Option<&WideTree> {
        self.subtrees[subtree as usize].tree.get()
    }

    /// Statistics of the subtrees that have been built.
    pub fn statistics<S: WideSource>(&self, set: &S) -> Statistics {
        let mut all = self.top.statistics(set);
        let above = all.depth;
        (all.leaves, all.references) = (0, 0);
        all.subtrees = self.len();
        all.bytes += self.ids.capacity() * size_of::<u32>() + self.subtrees.capacity() * size_of::<Subtree>();
        all.bytes += self.groups.capacity() * size_of::<Group>();
        let (mut primitives, mut in_slices, mut seen) = (0, InSlices::default(), Vec::new());
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
            in_slices = in_slices.add(tree.in_slices(set, &mut seen));
        }
        all.left_out = in_slices.share();
        all.duplicates = (all.references - primitives) as f64 / all.references.max(1) as f64;
        all
    }

    /// The boxes of the subtrees that have been built, as [`WideTree::boxes`] gives them.
    pub fn boxes(&self, time: f32, frame: Frame, visitor: &mut impl FnMut(TreeBox)) {
        self.top.boxes(time, frame, 1, &mut |b, child| {
            let below = if b.leaf { self.built(self.below(child)) } else { None };
            visitor(TreeBox { leaf: b.leaf && below.is_none_or(|tree| tree.is_leaf_at(tree.root, time)), ..b });
            if let Some(tree) = below {
                tree.boxes(time, frame, b.level + 1, &mut |b, _| visitor(b));
            }
        });
    }
}

/// The groups of subtrees, which are the leaves of a binary tree: its largest subtrees of at most `most` primitives.
fn groups(binary: &[BinaryNode], most: usize) -> Vec<Group> {
    let (mut groups, mut end) = (Vec::new(), 0);
    for node in binary {
        if node.first >= end && (node.count as usize <= most || node.right == 0) {
            groups.push(Group { first: node.first, decided: OnceLock::new() });
            end = node.first + node.count;
        }
    }
    groups
}

/// Those primitives of a subtree whose centres are nearest to that of one of them.
fn neighbours<S: WideSource>(set: &S, subtree: &[u32], around: u32) -> Vec<u32> {
    let mut ids = subtree.to_vec();
    ids.sort();
    let mut bounds = vec![LaneBounds::EMPTY; ids.len()];
    set.lane_bounds(&ids, TimeInterval::FULL, &mut bounds);
    let centre = |at: usize| bounds[at].centre().truncate();
    let middle = centre(ids.binary_search(&around).expect("the primitive is in the subtree"));
    let mut near: Vec<(f32, u32)> =
        (0..).zip(&ids).map(|(at, &id)| (centre(at).distance_squared(middle), id)).collect();
    if near.len() > NEIGHBOURS {
        near.select_nth_unstable_by(NEIGHBOURS, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(NEIGHBOURS);
    }
    near.into_iter().map(|(_, id)| id).collect()
}

/// The tree above the subtrees, which are the leaves of a binary tree.
fn top(binary: &[BinaryNode], subtrees: &[Subtree]) -> Result<WideTree, BuildError> {
    let mut top = WideTree::empty(0);
    if binary.is_empty() {
        return Ok(top);
    }
    // There are few subtrees.
    let progress = Progress::new(None);
    // Each subtree is a leaf, whatever its cost.
    let cost = |node: &BinaryNode| (node.right == 0).then_some(leaf_cost(LANES));
    let collapse = Collapse::new(binary, SurfaceDensity::NONE, cost, &progress);
    let leaves = |arena: &mut Arena, of: &[BinaryNode], lists: &mut [ChildRef]| {
        for (node, list) in of.iter().zip(lists) {
            let subtree = subtrees.partition_point(|subtree| subtree.first < node.first);
            *list = write_listed(arena, subtree as u32).ok_or(BuildError::TooLargeTree)?;
        }
        Ok(())
    };
    top.root = Nodes {
        binary,
        collapse: &collapse,
        over: TimeInterval::FULL,
        leaves: &leaves,
        writes: true,
        progress: &progress,
    }
    .write(&mut top.arena)?;
    top.arena.align();
    top.arena.compact();
    top.counts = top.counted_nodes();
    Ok(top)
}

/// Writes a leaf of the coarse tree, which lists one subtree.
fn write_listed(arena: &mut Arena, subtree: u32) -> Option<ChildRef> {
    arena.align();
    let at = arena.grow(1);
    arena.ints_mut()[at] = subtree;
    ChildRef::new(Kind::OtherLeaf, at, 1)
}
