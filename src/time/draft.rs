//! The draft of a tree before it is written: references, binary tree, and its collapse into wide nodes.
//!
//! The cost of a tree is the sum over its nodes and leaf blocks of cost times visits, which the collapse returns.

use super::existence::any_comes_or_goes;
use super::time_slice::TimeSlice;
use crate::bvh::{
    BinaryNode, BinaryTree, Collapse, Reference, ReplacedSubtree, SurfaceDensity, WideChild, join_leaves, leaf_cost,
    motion_factor, reinsert,
};
use crate::geometry::{LinearBox3, TimeInterval};
use crate::primitive::PrimitiveSet;
use crate::progress::Progress;
use crate::tuning::wide::NODE_COST;

/// The share of another collapse in the rest of a draft, about.
const COLLAPSE_AGAIN: f64 = 0.3;

/// How many leaf blocks ahead the numbers of vertices are prefetched; the vertices follow one block ahead.
const AHEAD: usize = 4;

/// Whether some primitives are pre-split.
#[derive(Clone, Copy, Default)]
pub(crate) struct PresplitDecision {
    /// Half the area of a box per area of the triangle in it.
    pub ratio: Option<f64>,
    pub pays: bool,
}

/// A drafted tree over the shutter or one of equal slices of it.
pub(crate) struct Draft {
    pub slice: TimeSlice,
    /// The interval of the slice.
    pub over: TimeInterval,
    pub references: Vec<Reference>,
    /// The number of primitives that they refer to.
    pub primitives: usize,
    /// Whether references may be sub-references, which bound a part of their primitive.
    pub presplit: bool,
    /// Whether its subtrees have been moved to better places.
    pub(super) reinserted: bool,
    /// Half the area of a box per area of the triangle in it.
    pub(super) ratio: Option<f64>,
    /// Predicts how often boxes are visited: what its costs are computed with.
    pub density: SurfaceDensity,
    pub binary: BinaryTree,
    pub collapse: Collapse,
}

impl Draft {
    /// What was decided on pre-splitting, for drafts of other slices.
    pub fn decided(&self) -> PresplitDecision {
        PresplitDecision { ratio: self.ratio, pays: self.presplit }
    }

    /// The expected cost of a subtree for rays during a slice of the shutter, with the boxes of the whole.
    pub fn cost_during(&self, of: u32, slice: TimeSlice) -> f32 {
        let [first, last] = slice.times();
        let (mut cost, mut nodes, mut children) =
            (0.0, vec![WideChild { node: of, leaf: self.collapse.is_leaf(of) }], Vec::new());
        while let Some(WideChild { node: x, leaf }) = nodes.pop() {
            let node = &self.binary[x as usize];
            let bounds = LinearBox3 { begin: node.bounds.at(first), end: node.bounds.at(last) };
            let step = if leaf { leaf_cost(node.count as usize) } else { NODE_COST };
            cost += step * motion_factor(node.moving) * self.density.visits(&bounds);
            if !leaf {
                self.collapse.children(&self.binary, x, &mut children);
                nodes.extend(&children);
            }
        }
        cost
    }

    /// The share of the first child in the cost of both children of a node.
    pub fn low_share(&self, x: u32) -> f32 {
        let [low, high] = [x + 1, x + self.binary[x as usize].right].map(|child| self.collapse.cost(child));
        if low + high > 0.0 { low / (low + high) } else { 0.5 }
    }

    /// Makes subtrees single children, which others have replaced, and moves subtrees to better places unless that has been done.
    /// Afterwards only the references of nodes that may be leaf blocks are side by side. Of no use once `progress` is cancelled.
    pub fn replace_subtrees<S: PrimitiveSet>(
        &mut self,
        set: &S,
        replaced: &mut [ReplacedSubtree],
        progress: &Progress,
    ) {
        if !self.reinserted {
            let better = reinsert(&self.binary, &mut self.references, replaced, self.density, progress);
            if let Some(better) = better {
                self.binary = better;
                self.collapse_again(set, progress);
            }
            if replaced.is_empty() {
                self.join_leaves(set, progress);
            }
        }
        if !progress.cancelled() {
            self.collapse.replace_subtrees(&self.binary, self.density, replaced);
        }
    }

    fn collapse_again<S: PrimitiveSet>(&mut self, set: &S, progress: &Progress) {
        let progress = progress.rest(COLLAPSE_AGAIN);
        self.collapse = collapse(set, &self.binary, &self.references, self.density, &progress);
    }

    /// Joins leaf blocks that are no neighbours, if that pays and all primitives are of one kind.
    pub(super) fn join_leaves<S: PrimitiveSet>(&mut self, set: &S, progress: &Progress) {
        if !progress.cancelled()
            && !set.kinds_differ()
            && let Some(better) =
                join_leaves(&self.binary, &self.collapse, &mut self.references, self.density, set.per_leaf())
        {
            self.binary = better;
            self.collapse_again(set, progress);
        }
    }

    /// Whether anything below a node changes during the shutter.
    pub fn changes<S: PrimitiveSet>(&self, set: &S, x: u32) -> bool {
        let node = &self.binary[x as usize];
        node.moving || any_comes_or_goes(set, self.references(node))
    }

    /// The references below a binary node.
    pub fn references(&self, node: &BinaryNode) -> &[Reference] {
        &self.references[node.first as usize..][..node.count as usize]
    }

    /// The primitives below a binary node, sorted, without duplicates.
    pub fn primitives_below(&self, of: u32) -> Vec<u32> {
        let mut ids: Vec<u32> = self.references(&self.binary[of as usize]).iter().map(Reference::id).collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    /// Prefetches the data of the leaf blocks that follow block `i` of some, as bounds over an interval need them.
    pub fn prefetch<S: PrimitiveSet>(&self, set: &S, of: &[BinaryNode], i: usize, over: TimeInterval) {
        let next = if i == 0 { 0..of.len().min(AHEAD + 1) } else { i + AHEAD..of.len().min(i + AHEAD + 1) };
        for node in of.get(next).unwrap_or_default() {
            self.references(node).iter().for_each(|r| set.prefetch(r.id()));
        }
        for node in of.iter().skip(i + 1).take(1) {
            self.references(node).iter().for_each(|r| set.prefetch_vertices(r.id(), over));
        }
    }
}

/// Collapses a binary tree over references into wide nodes and leaf blocks.
pub(super) fn collapse<S: PrimitiveSet>(
    set: &S,
    binary: &BinaryTree,
    references: &[Reference],
    density: SurfaceDensity,
    progress: &Progress,
) -> Collapse {
    let (kinds_differ, per_leaf) = (set.kinds_differ(), set.per_leaf());
    let cost = |node: &BinaryNode| {
        if node.count as usize > per_leaf {
            return None;
        }
        let block = &references[node.first as usize..][..node.count as usize];
        let fits = !kinds_differ || one_block(set, block, node.right == 0);
        fits.then_some(leaf_cost(node.count as usize))
    };
    Collapse::new(binary, density, cost, progress)
}

/// Whether references may form a leaf block: they are of one kind and, unless they cannot be split further, fit.
fn one_block<S: PrimitiveSet>(set: &S, references: &[Reference], last: bool) -> bool {
    let ids = &Reference::ids(references)[..references.len()];
    let kind = set.leaf_kind(ids[0]);
    ids.iter().all(|&id| set.leaf_kind(id) == kind) && (kind == 0 || last || set.fits_block(ids))
}
