//! A temporal split with shared leaves: one hierarchy per time slice over the same leaf blocks.

use super::draft::Draft;
use super::slice_bounds::include_slice_bounds;
use super::time_slice::TimeSlice;
use crate::bvh::{BinaryNode, BinaryTree, Collapse, Reference, SurfaceDensity, build_binary, leaf_cost};
use crate::geometry::{LinearBox3, TimeInterval};
use crate::parallel;
use crate::primitive::{Intervals, PrimitiveSet};
use crate::progress::Progress;
use crate::simd::{fill, huge_vec, huge_vec_of};

/// The hierarchies and their shared leaf blocks.
pub(crate) struct SharedLeaves {
    /// The binary nodes that are leaf blocks.
    pub leaves: Vec<BinaryNode>,
    pub trees: Vec<SliceTree>,
}

/// The hierarchy of one time slice.
pub(crate) struct SliceTree {
    pub over: TimeInterval,
    pub binary: BinaryTree,
    pub collapse: Collapse,
    /// The leaf at each index of the binary tree's order.
    pub order: Vec<u32>,
}

impl SharedLeaves {
    /// Rebuilds the nodes above the leaf blocks of a draft's subtree for some of `count` equal time slices of the shutter, in
    /// order. Of no use once `progress` is cancelled.
    pub fn build<S: PrimitiveSet>(
        set: &S,
        draft: &Draft,
        of: u32,
        count: usize,
        slices: &[usize],
        progress: &Progress,
    ) -> SharedLeaves {
        let leaves = draft.collapse.leaves(&draft.binary, of);
        let slices: Vec<TimeSlice> = slices.iter().map(|&index| TimeSlice { index, of: count }).collect();
        let in_slices = bounds_in(set, draft, &leaves, &slices, &progress.subtask(BOUNDS));
        if progress.cancelled() {
            return SharedLeaves { leaves, trees: Vec::new() };
        }
        let share = progress.rest(1.0);
        let trees = parallel::map(slices.len(), |nth| {
            let bounds = |i: usize| in_slices[i * slices.len() + nth];
            let share = share.subtask(1.0 / slices.len() as f64);
            SliceTree::build(&leaves, slices[nth].interval(), draft.density, bounds, &share)
        });
        SharedLeaves { leaves, trees }
    }

    /// Expected cost of a ray.
    pub fn cost(&self) -> f32 {
        self.trees.iter().map(|t| t.collapse.total()).sum::<f32>() / self.trees.len() as f32
    }
}

/// The share of the bounds of leaf blocks, about.
const BOUNDS: f64 = 0.3;

/// The share of object splits in a hierarchy over leaf blocks, about.
const SPLITTING: f64 = 0.8;

/// Leaf blocks whose bounds are computed by one thread.
const BLOCKS: usize = 256;

/// The bounds of the leaf blocks over each of some time slices, block by block.
fn bounds_in<S: PrimitiveSet>(
    set: &S,
    draft: &Draft,
    leaves: &[BinaryNode],
    slices: &[TimeSlice],
    progress: &Progress,
) -> Vec<LinearBox3> {
    let over: Vec<TimeInterval> = slices.iter().map(|slice| slice.interval()).collect();
    let times: Vec<TimeInterval> = slices.iter().map(|slice| slice.query_times()).collect();
    let mut all = huge_vec_of(LinearBox3::EMPTY, leaves.len() * over.len());
    let mut parts: Vec<_> = leaves.chunks(BLOCKS).zip(all.chunks_mut(BLOCKS * over.len())).collect();
    let needed = over.iter().copied().reduce(TimeInterval::hull).unwrap_or(TimeInterval::FULL);
    let progress = progress.in_units(leaves.len());
    parallel::each(&mut parts, |(leaves, bounds)| {
        if progress.cancelled() {
            return;
        }
        let mut intervals = Intervals::new(&over);
        for (i, (leaf, bounds)) in leaves.iter().zip(bounds.chunks_mut(over.len())).enumerate() {
            draft.prefetch(set, leaves, i, needed);
            include_slice_bounds(set, draft.references(leaf), draft, (&mut intervals, &times), bounds);
        }
        progress.finished(leaves.len() as f64);
    });
    all
}

impl SliceTree {
    fn build(
        leaves: &[BinaryNode],
        over: TimeInterval,
        density: SurfaceDensity,
        bounds: impl Fn(usize) -> LinearBox3 + Sync,
        progress: &Progress,
    ) -> SliceTree {
        let n = leaves.len();
        let mut blocks = huge_vec(n);
        fill(&mut blocks, n, |i| Reference::new(bounds(i), i as u32));
        // Blocks of which nothing exists in the slice.
        blocks.retain(|block| !block.is_empty());
        if blocks.is_empty() {
            // No hierarchy is empty.
            blocks.push(Reference::new(leaves[0].bounds, 0));
        }
        let binary = build_binary(&mut blocks, 1..=1, None, None, &progress.subtask(SPLITTING));
        let cost = |node: &BinaryNode| {
            (node.count == 1).then(|| {
                let block = &leaves[blocks[node.first as usize].id() as usize];
                leaf_cost(block.count as usize)
            })
        };
        let collapse = Collapse::new(&binary, density, cost, &progress.rest(1.0));
        SliceTree { over, binary, collapse, order: blocks.iter().map(Reference::id).collect() }
    }
}
