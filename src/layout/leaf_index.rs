//! Indexing a finished tree in one pass: its depth and counts, and the leaf block that holds each triangle.

use super::leaf::keyed::KeyedLeaf;
use super::leaf::needed_segments::needed_segments;
use super::leaf::source::WideSource;
use super::wide_node::{ChildRef, Kind, node_rows};
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

/// The nodes and leaves of a subtree.
#[derive(Default)]
pub(super) struct Found {
    /// The counts of nodes.
    counts: Counts,
    /// Leaf blocks; below time nodes some may occur several times.
    leaves: Vec<ChildRef>,
}

impl Found {
    /// Counts a node.
    pub fn add_node(&mut self, kind: Kind) {
        self.counts.nodes += 1;
        self.counts.moving_nodes += usize::from(kind == Kind::Node);
        self.counts.time_nodes += usize::from(kind == Kind::Time);
    }

    /// Records a leaf block.
    pub fn add_leaf(&mut self, leaf: ChildRef, depth: u32) {
        self.counts.depth = self.counts.depth.max(depth);
        self.leaves.push(leaf);
    }

    /// Adds what was found in another subtree.
    fn append(&mut self, other: Found) {
        self.counts.depth = self.counts.depth.max(other.counts.depth);
        self.counts.nodes += other.counts.nodes;
        self.counts.moving_nodes += other.counts.moving_nodes;
        self.counts.time_nodes += other.counts.time_nodes;
        self.leaves.extend(other.leaves);
    }

    /// Removes duplicate leaf blocks, which occur only below time nodes.
    pub fn each_leaf_once(&mut self) {
        if self.counts.time_nodes > 0 {
            self.leaves.sort_unstable_by_key(|leaf| leaf.0);
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
        let Found { counts, leaves } = self.traversed();
        Counts { leaves: leaves.len(), ..counts }
    }

    /// Counts only.
    pub(crate) fn counted<S: WideSource>(&self, set: &S) -> Counts {
        let Ok(counts) = self.count(set, &self.traversed(), &[], unchecked);
        counts
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
        found.into_iter().for_each(|found| all.append(found));
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
    fn prefetch_ids(&self, block: ChildRef) {
        self.arena.prefetch(block.at() + block.kind().leaf_rows() * block.len(), 2);
    }

    /// Counts, and records a leaf block for each triangle unless `blocks` is empty. If several blocks hold a triangle the first is
    /// recorded, so that the result does not depend on the threads. `check` validates each block before it is read.
    fn count<S: WideSource, E: Send>(
        &self,
        set: &S,
        found: &Found,
        blocks: &[AtomicU32],
        check: impl Fn(ChildRef) -> Result<(), E> + Sync,
    ) -> Result<Counts, E> {
        let several = self.presplit || found.counts.time_nodes > 0;
        let parts = parallel::chunks(found.leaves.len(), |range| {
            let leaves = &found.leaves[range];
            let (mut references, mut of_static) = (0, 0);
            for (i, &leaf) in leaves.iter().enumerate() {
                if let Some(&soon) = leaves.get(i + SOON) {
                    self.prefetch_ids(soon);
                }
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
        let mut counts = Counts { leaves: found.leaves.len(), ..found.counts };
        for part in parts {
            let (references, of_static) = part?;
            counts.references += references;
            counts.static_references += of_static;
        }
        Ok(counts)
    }

    /// The time slices for which a leaf block has all keys that a triangle of more than two keys needs while it exists.
    fn slices_of_one(&self, triangles: &Triangles, id: u32, leaf: ChildRef) -> Range<usize> {
        let keyed = KeyedLeaf::read(self.arena.ints(), leaf);
        let active = triangles.active(id);
        first_run(self.slices, |slice| {
            active.intersect(slice.query_times()).is_some()
                && keyed.holds(needed_segments(triangles, &[id], keyed.segments + 1, slice))
        })
    }

    /// The time slices for which a leaf block has all keys; `0..1` for blocks that have the keys of the whole shutter.
    fn slices_of(&self, leaf: ChildRef) -> Range<usize> {
        if leaf.kind() != Kind::OtherLeaf {
            return 0..1;
        }
        let keyed = KeyedLeaf::read(self.arena.ints(), leaf);
        first_run(self.slices, |slice| keyed.holds(slice.segments(keyed.segments + 1)))
    }
}

/// The first run of successive slices, of so many, for which something is true.
fn first_run(count: usize, is_true: impl Fn(TimeSlice) -> bool) -> Range<usize> {
    let is_true = |index: usize| is_true(TimeSlice { index, of: count });
    let first = (0..count).find(|&index| is_true(index)).unwrap_or(0);
    first..(first..count).find(|&index| !is_true(index)).unwrap_or(count)
}
