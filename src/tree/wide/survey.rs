//! Walks a finished tree once: how deep it is, what it holds, and in which leaf block each triangle is.

use super::build::WideTree;
use super::layout::{ChildRef, Ids, Kind, NODE_ROWS, STILL_NODE_ROWS};
use super::leaf::WideSource;
use crate::parallel;
use crate::simd::LANES;
use crate::tree::Statistics;
use core::sync::atomic::{AtomicU32, Ordering};

/// What was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Survey {
    /// Depth of the deepest leaf; the root has depth 0.
    depth: u32,
    nodes: usize,
    leaves: usize,
    references: usize,
}

/// A block to be visited.
#[derive(Clone, Copy)]
struct Visit {
    at: ChildRef,
    depth: u32,
    /// The part of the time node next above.
    part: usize,
}

/// What is found in a subtree.
#[derive(Default)]
struct Found {
    depth: u32,
    nodes: usize,
    /// Leaf blocks and how many primitives they have; below time nodes perhaps some of them several times.
    leaves: Vec<(u32, u32)>,
    time_nodes: usize,
}

/// Subtrees that are walked in parallel, at least, where there are so many.
const SUBTREES: usize = 128;

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

    /// How many blocks can wait on a query's stack, and room for one more node's children to be written at once.
    #[inline(always)]
    pub fn waiting(&self) -> usize {
        (LANES - 1) * self.survey.depth as usize + LANES
    }

    /// Counts, and says for each piece of a primitive's motion in which leaf block it is: of several in the first, so
    /// that it does not matter who walks where.
    pub(super) fn surveyed<S: WideSource>(&self, set: &S) -> (Survey, Vec<u32>) {
        let mut blocks = Vec::new();
        parallel::fill(&mut blocks, set.pieces(), |_| AtomicU32::new(ChildRef::NOTHING.0));
        let mut top = Found::default();
        let mut visits = vec![Visit { at: self.root, depth: 0, part: 0 }];
        visits.retain(|visit| visit.at != ChildRef::NOTHING);
        // Level by level, until there are enough of them.
        while visits.len() < SUBTREES && visits.iter().any(|visit| !visit.at.kind().is_leaf()) {
            let mut below = Vec::new();
            visits.into_iter().for_each(|visit| self.visit(set, visit, &blocks, &mut top, &mut below));
            visits = below;
        }
        let mut found = parallel::map(visits.len(), |i| {
            let (mut found, mut stack) = (Found::default(), vec![visits[i]]);
            while let Some(visit) = stack.pop() {
                self.visit(set, visit, &blocks, &mut found, &mut stack);
            }
            found
        });
        found.push(top);
        let depth = found.iter().map(|f| f.depth).max().unwrap_or(0);
        let nodes = found.iter().map(|f| f.nodes).sum();
        let time_nodes: usize = found.iter().map(|f| f.time_nodes).sum();
        let mut leaves = found.into_iter().map(|f| f.leaves).collect::<Vec<_>>().concat();
        if time_nodes > 0 {
            leaves.sort_unstable();
            leaves.dedup();
        }
        let references = leaves.iter().map(|&(_, count)| count as usize).sum();
        let survey = Survey { depth, nodes, leaves: leaves.len(), references };
        (survey, blocks.into_iter().map(AtomicU32::into_inner).collect())
    }

    fn visit<S: WideSource>(
        &self,
        set: &S,
        Visit { at, depth, part }: Visit,
        blocks: &[AtomicU32],
        found: &mut Found,
        below: &mut Vec<Visit>,
    ) {
        let kind = at.kind();
        if !kind.is_leaf() {
            found.nodes += 1;
            found.time_nodes += usize::from(kind == Kind::Time);
            let children = self.children(at).iter().enumerate().filter(|&(_, &child)| child != ChildRef::NOTHING.0);
            below.extend(children.map(|(i, &child)| {
                let part = if kind == Kind::Time { i } else { part };
                Visit { at: ChildRef(child), depth: depth + 1, part }
            }));
            return;
        }
        let ids = self.ids::<S>(at).unwrap_or(&[]);
        found.depth = found.depth.max(depth);
        found.leaves.push((at.0, ids.len() as u32));
        if blocks.is_empty() {
            return;
        }
        // Only motion of several pieces is in blocks of its own for each of them.
        let segment = if kind == Kind::OwnLeaf { part } else { 0 };
        for &id in ids {
            blocks[set.piece(id, segment)].fetch_min(at.0, Ordering::Relaxed);
        }
    }

    /// The figures of the tree.
    pub fn statistics<S: WideSource>(&self, set: &S) -> Statistics {
        let Survey { depth, nodes, leaves, references } = self.survey;
        let duplicates = references - set.len().min(references);
        Statistics {
            primitives: set.len(),
            nodes,
            leaves,
            empty_leaves: 0,
            depth,
            references,
            duplicates: duplicates as f64 / references.max(1) as f64,
            timed: 0.0,
            duplication_time: 0.0,
            propagation_time: 0.0,
            bytes: self.arena.bytes(),
            primitive_bytes: set.bytes() + self.blocks.capacity() * size_of::<u32>(),
        }
    }
}
