//! Indexing a finished tree in one pass: its depth and counts, and the leaf block that holds each triangle.

use super::keyed_leaf::KeyedLeaf;
use super::needed_segments::needed_segments;
use super::statistics::Statistics;
use super::wide_node::{ChildRef, Kind, node_rows};
use super::wide_source::WideSource;
use super::wide_tree::{Counts, WideTree};
use crate::parallel;
use crate::primitive::{PrimitiveSet, Triangles};
use crate::simd::{LANES, fill, huge_vec};
use crate::time::TimeSlice;
use core::convert::Infallible;
use core::ops::Range;
use core::sync::atomic::{AtomicU32, Ordering};

/// A block to be visited.
#[derive(Clone, Copy)]
struct Visit {
    at: ChildRef,
    depth: u32,
}

/// The counts and leaves of a subtree.
#[derive(Default)]
pub(super) struct Found {
    pub depth: u32,
    pub nodes: usize,
    pub moving_nodes: usize,
    /// Leaf blocks; below time nodes some may occur several times.
    pub leaves: Vec<u32>,
    pub time_nodes: usize,
}

impl Found {
    /// Counts a node.
    pub fn add_node(&mut self, kind: Kind) {
        self.nodes += 1;
        self.moving_nodes += usize::from(kind == Kind::Node);
        self.time_nodes += usize::from(kind == Kind::Time);
    }

    /// Records a leaf block.
    pub fn add_leaf(&mut self, leaf: ChildRef, depth: u32) {
        self.depth = self.depth.max(depth);
        self.leaves.push(leaf.0);
    }

    /// Removes duplicate leaf blocks, which occur only below time nodes.
    pub fn each_leaf_once(&mut self) {
        if self.time_nodes > 0 {
            self.leaves.sort_unstable();
            self.leaves.dedup();
        }
    }
}

/// The number of subtrees that are traversed in parallel, at least, if there are that many.
const SUBTREES: usize = 128;

/// How many leaf blocks ahead ids are prefetched.
const SOON: usize = 8;

/// Leaf blocks of a build are what they should be.
fn unchecked(_: ChildRef) -> Result<(), Infallible> {
    Ok(())
}

impl WideTree {
    /// Counts, and returns for each triangle the leaf block that holds it.
    pub(crate) fn index_leaves<S: WideSource>(&self, set: &S) -> (Counts, Vec<u32>) {
        let (found, blocks) = parallel::both(|| self.traversed(), || self.empty_index(set));
        let Ok(counts) = self.count(set, &found, &blocks, unchecked);
        (counts, blocks.into_iter().map(AtomicU32::into_inner).collect())
    }

    /// The same for a tree that has been traversed; `check` validates each leaf block right before it is read, so that the block is
    /// fetched from memory once.
    pub(super) fn index_checked_leaves<S: WideSource, E: Send>(
        &self,
        set: &S,
        found: &Found,
        check: impl Fn(ChildRef) -> Result<(), E> + Sync,
    ) -> Result<(Counts, Vec<u32>), E> {
        let blocks = self.empty_index(set);
        let counts = self.count(set, found, &blocks, check)?;
        Ok((counts, blocks.into_iter().map(AtomicU32::into_inner).collect()))
    }

    /// The table of leaf blocks by triangle and slice, without entries.
    fn empty_index<S: WideSource>(&self, set: &S) -> Vec<AtomicU32> {
        let entries = set.triangles().map_or(0, |triangles| triangles.entries(self.slices));
        let mut blocks = huge_vec(entries);
        fill(&mut blocks, entries, |_| AtomicU32::new(ChildRef::NOTHING.0));
        blocks
    }

    /// Counts without reading leaves.
    pub(super) fn counted_nodes(&self) -> Counts {
        let Found { depth, nodes, moving_nodes, leaves, .. } = self.traversed();
        Counts { depth, nodes, moving_nodes, leaves: leaves.len(), ..Counts::default() }
    }

    /// Counts only.
    pub(crate) fn counted<S: WideSource>(&self, set: &S) -> Counts {
        let Ok(counts) = self.count(set, &self.traversed(), &[], unchecked);
        counts
    }

    /// Counts, and records the block of each triangle unless `blocks` is empty. `check` validates each leaf block first.
    fn count<S: WideSource, E: Send>(
        &self,
        set: &S,
        found: &Found,
        blocks: &[AtomicU32],
        check: impl Fn(ChildRef) -> Result<(), E> + Sync,
    ) -> Result<Counts, E> {
        let (references, static_references) = self.find_blocks(set, found, blocks, check)?;
        let &Found { depth, nodes, moving_nodes, time_nodes, .. } = found;
        let leaves = found.leaves.len();
        Ok(Counts { depth, nodes, moving_nodes, time_nodes, leaves, references, static_references })
    }

    /// The counts of all nodes, and all leaf blocks.
    fn traversed(&self) -> Found {
        let mut all = Found::default();
        let mut visits = Vec::new();
        if self.root != ChildRef::NOTHING {
            self.reach(Visit { at: self.root, depth: 0 }, &mut all, &mut visits);
        }
        // Breadth first, until there are enough subtrees.
        while visits.len() < SUBTREES && !visits.is_empty() {
            let mut below = Vec::new();
            visits.into_iter().for_each(|visit| self.visit(visit, &mut all, &mut below));
            visits = below;
        }
        let found = parallel::map(visits.len(), |i| {
            let (mut found, mut stack) = (Found::default(), vec![visits[i]]);
            while let Some(visit) = stack.pop() {
                self.visit(visit, &mut found, &mut stack);
            }
            found
        });
        for found in found {
            all.depth = all.depth.max(found.depth);
            all.nodes += found.nodes;
            all.moving_nodes += found.moving_nodes;
            all.time_nodes += found.time_nodes;
            all.leaves.extend(found.leaves);
        }
        all.each_leaf_once();
        all
    }

    /// Counts a node and adds its children.
    fn visit(&self, Visit { at, depth }: Visit, found: &mut Found, below: &mut Vec<Visit>) {
        found.add_node(at.kind());
        for child in self.children(at) {
            self.reach(Visit { at: child, depth: depth + 1 }, found, below);
        }
    }

    /// Records a leaf block, without reading it, or adds a node to be visited.
    fn reach(&self, visit: Visit, found: &mut Found, below: &mut Vec<Visit>) {
        let Visit { at, depth } = visit;
        if at.kind().is_leaf() {
            return found.add_leaf(at, depth);
        }
        let rows = node_rows(at.kind());
        self.arena.prefetch(at.at() + (rows - 1) * LANES, 1);
        below.push(visit);
    }

    /// Prefetches the ids of a leaf block, or the header that locates them: in large trees they come from memory.
    fn prefetch_ids(&self, block: u32) {
        let block = ChildRef(block);
        self.arena.prefetch(block.at() + block.kind().leaf_rows() * block.len(), 2);
    }

    /// Records a leaf block for each triangle, and returns the number of references in all blocks together, and in
    /// those of static triangles. If several blocks hold a triangle the first is recorded, so that the result does not
    /// depend on the threads. `check` validates each block before it is read.
    fn find_blocks<S: WideSource, E: Send>(
        &self,
        set: &S,
        found: &Found,
        blocks: &[AtomicU32],
        check: impl Fn(ChildRef) -> Result<(), E> + Sync,
    ) -> Result<(usize, usize), E> {
        let several = self.presplit || found.time_nodes > 0;
        let references = parallel::chunks(found.leaves.len(), |range| {
            let leaves = &found.leaves[range];
            let (mut references, mut of_static) = (0, 0);
            for (i, &leaf) in leaves.iter().enumerate() {
                if let Some(&soon) = leaves.get(i + SOON) {
                    self.prefetch_ids(soon);
                }
                let leaf = ChildRef(leaf);
                check(leaf)?;
                let ids = self.ids(leaf).unwrap_or(&[]);
                references += ids.len();
                if matches!(leaf.kind(), Kind::StaticLeaf | Kind::SharedStaticLeaf) {
                    of_static += ids.len();
                }
                let located = !blocks.is_empty() && !self.is_list(leaf);
                let Some(triangles) = set.triangles().filter(|_| located) else { continue };
                let mut slices = self.slices_of(leaf);
                let each = leaf.kind() == Kind::OtherLeaf && !triangles.always_active();
                let mut before = None;
                for &id in ids {
                    // Neighbours are mostly of one mesh.
                    if each && before.replace(triangles.active(id)) != Some(triangles.active(id)) {
                        slices = self.slices_of_one(triangles, id, leaf);
                    }
                    for slice in slices.clone() {
                        let block = &blocks[triangles.entries_of(id, self.slices).0 + slice];
                        if several {
                            block.fetch_min(leaf.0, Ordering::Relaxed);
                        } else {
                            block.store(leaf.0, Ordering::Relaxed);
                        }
                    }
                }
            }
            Ok((references, of_static))
        });
        references.into_iter().try_fold((0, 0), |a, b| b.map(|b: (usize, usize)| (a.0 + b.0, a.1 + b.1)))
    }

    /// The time slices for which a leaf block has all keys that a triangle of more than two keys needs while it exists.
    fn slices_of_one(&self, triangles: &Triangles, id: u32, leaf: ChildRef) -> Range<usize> {
        let keyed = KeyedLeaf::read(self.arena.ints(), leaf);
        let active = triangles.active(id);
        let held = |&index: &usize| {
            let slice = TimeSlice { index, of: self.slices };
            active.intersect(slice.query_times()).is_some()
                && keyed.holds(needed_segments(triangles, &[id], keyed.segments + 1, slice))
        };
        let first = (0..self.slices).find(held).unwrap_or(0);
        first..(first..self.slices).take_while(held).last().map_or(first, |last| last + 1)
    }

    /// The time slices for which a leaf block has all keys; `0..1` for blocks that have the keys of the whole shutter.
    fn slices_of(&self, leaf: ChildRef) -> Range<usize> {
        if leaf.kind() != Kind::OtherLeaf {
            return 0..1;
        }
        let keyed = KeyedLeaf::read(self.arena.ints(), leaf);
        let held = |&index: &usize| keyed.holds(TimeSlice { index, of: self.slices }.segments(keyed.segments + 1));
        let first = (0..self.slices).find(held).unwrap_or(0);
        first..(first..self.slices).take_while(held).last().map_or(first, |last| last + 1)
    }

    /// The statistics of the tree, but for what time slices leave out ([`WideTree::left_out`]).
    pub fn statistics<S: WideSource>(&self, set: &S) -> Statistics {
        let Counts { depth, nodes, leaves, references, time_nodes, static_references, .. } = self.counts;
        let primitives = set.len() - set.hidden().len();
        let duplicates = references - primitives.min(references);
        Statistics {
            primitives,
            nodes,
            leaves,
            depth,
            references,
            duplicates: duplicates as f64 / references.max(1) as f64,
            positions: set.positions()[0],
            kept_positions: set.positions()[1],
            static_references,
            time_nodes,
            cost: 1.0,
            bytes: self.arena.bytes(),
            primitive_bytes: set.bytes() + self.blocks.capacity() * size_of::<u32>() + self.masks.bytes(),
            ..Statistics::default()
        }
    }
}
