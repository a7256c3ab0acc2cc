//! Several hierarchies over the same leaf blocks, one for each part of the shutter.

use super::draft::{COST_MODEL, Draft, prefetch_blocks, time_slice};
use crate::bvh::{BinaryNode, BinaryTree, Collapse, Reference, build_binary};
use crate::geometry::{Box3, LinearBox3, TimeInterval, ULP};
use crate::parallel;
use crate::primitive::PrimitiveSet;
use crate::simd::huge_vec;

/// The hierarchies and what they share.
pub(crate) struct SharedLeaves {
    /// The binary nodes that are leaf blocks.
    pub clusters: Vec<BinaryNode>,
    pub trees: Vec<Slice>,
}

/// One of them.
pub(crate) struct Slice {
    pub over: TimeInterval,
    pub binary: BinaryTree,
    pub collapse: Collapse,
    /// The cluster at each place of the binary tree's order.
    pub order: Vec<u32>,
}

impl SharedLeaves {
    /// Rebuilds the nodes above the leaf blocks of a draft's subtree for `parts` equal parts of the shutter.
    pub fn build<S: PrimitiveSet>(set: &S, draft: &Draft, of: u32, parts: usize) -> SharedLeaves {
        let clusters = draft.collapse.leaves(&draft.binary, of);
        let seams: Option<Vec<Vec<Box3>>> = (1..parts).map(|i| seam(set, draft, &clusters, i, parts)).collect();
        let trees = parallel::map(parts, |part| {
            let over = time_slice(part, parts);
            let bounds = |i: usize| match &seams {
                Some(seams) => LinearBox3 {
                    begin: if part == 0 { clusters[i].bounds.begin } else { seams[part - 1][i] },
                    end: if part + 1 == parts { clusters[i].bounds.end } else { seams[part][i] },
                },
                None => {
                    let of = draft.references(&clusters[i]).iter();
                    of.fold(LinearBox3::EMPTY, |b, r| b.union(slice_bounds(set, r, draft, over)))
                }
            };
            Slice::build(&clusters, over, bounds)
        });
        SharedLeaves { clusters, trees }
    }

    /// Expected cost of a ray.
    pub fn cost(&self) -> f32 {
        self.trees.iter().map(|t| t.collapse.total()).sum::<f32>() / self.trees.len() as f32
    }
}

/// The boxes of the leaf blocks where part `i` of the shutter begins; nothing where that does not say what a block
/// does in between.
///
/// Corners move on lines up to their slack, so lines between the boxes at both ends of a part bound them all
/// the time. The part before ends a little later than this one begins: the boxes hold the corners at both times.
fn seam<S: PrimitiveSet>(set: &S, draft: &Draft, clusters: &[BinaryNode], i: usize, parts: usize) -> Option<Vec<Box3>> {
    let over = time_slice(i, parts).intersect(time_slice(i - 1, parts))?;
    if draft.presplit || set.ends(draft.references.first()?.id(), over).is_none() {
        return None;
    }
    let mut boxes = huge_vec(clusters.len());
    parallel::fill(&mut boxes, clusters.len(), |i| {
        prefetch_blocks(set, draft, clusters, i);
        draft.references(&clusters[i]).iter().fold(Box3::EMPTY, |b, r| {
            let Some(ends) = set.ends(r.id(), over) else { return b };
            let corners = ends.begin.into_iter().chain(ends.end).fold(Box3::EMPTY, Box3::include);
            b.union(corners.pad(ends.slack))
        })
    });
    Some(boxes)
}

impl Slice {
    fn build(clusters: &[BinaryNode], over: TimeInterval, bounds: impl Fn(usize) -> LinearBox3 + Sync) -> Slice {
        let n = clusters.len();
        let mut blocks = huge_vec(n);
        parallel::fill(&mut blocks, n, |i| Reference::new(bounds(i), i as u32));
        let binary = build_binary(&mut blocks, 1..=1);
        let collapse = Collapse::new(&binary, COST_MODEL, |node| {
            (node.count == 1).then(|| {
                let block = &clusters[blocks[node.first as usize].id() as usize];
                COST_MODEL.leaf + COST_MODEL.primitive * block.count as f32
            })
        });
        Slice { over, binary, collapse, order: blocks.iter().map(Reference::id).collect() }
    }
}

/// Bounds of a draft's reference in a part of its time: what the primitive's own bounds in that part and, where it
/// is cut to a cell, the reference's both hold.
pub(crate) fn slice_bounds<S: PrimitiveSet>(set: &S, r: &Reference, draft: &Draft, over: TimeInterval) -> LinearBox3 {
    let (own, bounds) = (set.bounds(r.id(), over), r.bounds());
    if !draft.presplit {
        return own;
    }
    if !r.moving() {
        return own.tighter(bounds);
    }
    let at = |t: f32| {
        let w = ((t - draft.over.begin()) / draft.over.duration()).clamp(0.0, 1.0);
        // One interpolation: three roundings at sizes of at most twice the largest coordinate.
        bounds.at(w).pad(8.0 * ULP * bounds.swept().magnitude())
    };
    own.tighter(LinearBox3 { begin: at(over.begin()), end: at(over.end()) })
}
