//! Several hierarchies over the same leaf blocks, one for each part of the shutter.

use super::leaf::WideSource;
use super::plan::{PRICES, Plan, part_of_shutter};
use crate::build::object::{BinaryNode, BinaryTree, Collapse, Reference, build_binary};
use crate::build::parallel;
use crate::motion::{LinearBox3, TimeInterval, ULP};
use crate::simd::huge_vec;

/// The hierarchies and what they share.
pub(super) struct Segments {
    /// The binary nodes that are leaf blocks.
    pub clusters: Vec<BinaryNode>,
    pub trees: Vec<Segment>,
}

/// One of them.
pub(super) struct Segment {
    pub over: TimeInterval,
    pub binary: BinaryTree,
    pub collapse: Collapse,
    /// The cluster at each place of the binary tree's order.
    pub order: Vec<u32>,
}

impl Segments {
    /// Rebuilds the nodes above the leaf blocks of a plan's subtree for `parts` equal parts of the shutter.
    pub fn build<S: WideSource>(set: &S, plan: &Plan, of: u32, parts: usize) -> Segments {
        let clusters = plan.collapse.leaves(&plan.binary, of);
        let trees = parallel::map(parts, |i| Segment::build(set, plan, &clusters, part_of_shutter(i, parts)));
        Segments { clusters, trees }
    }

    /// Expected cost of a ray.
    pub fn cost(&self) -> f32 {
        self.trees.iter().map(|t| t.collapse.total()).sum::<f32>() / self.trees.len() as f32
    }
}

impl Segment {
    fn build<S: WideSource>(set: &S, plan: &Plan, clusters: &[BinaryNode], over: TimeInterval) -> Segment {
        let n = clusters.len();
        let mut blocks = huge_vec(n);
        parallel::fill(&mut blocks, n, |i| {
            let node = &clusters[i];
            let of = &plan.references[node.first as usize..][..node.count as usize];
            let bounds = of.iter().fold(LinearBox3::EMPTY, |b, r| b.union(part_bounds(set, r, plan, over)));
            Reference::new(bounds, i as u32)
        });
        let binary = build_binary(&mut blocks, 1);
        let collapse = Collapse::new(&binary, PRICES, |node| {
            (node.count == 1).then(|| {
                let block = &clusters[blocks[node.first as usize].id() as usize];
                PRICES.leaf + PRICES.primitive * block.count as f32
            })
        });
        Segment { over, binary, collapse, order: blocks.iter().map(Reference::id).collect() }
    }
}

/// Bounds of a plan's reference in a part of its time: what the primitive's own bounds in that part and, where it
/// is cut to a cell, the reference's both hold.
pub(super) fn part_bounds<S: WideSource>(set: &S, r: &Reference, plan: &Plan, over: TimeInterval) -> LinearBox3 {
    let (own, bounds) = (set.bounds(r.id(), over), r.bounds());
    if !plan.cut {
        return own;
    }
    if !r.moving() {
        return own.tighter(bounds);
    }
    let at = |t: f32| {
        let w = ((t - plan.over.begin()) / plan.over.duration()).clamp(0.0, 1.0);
        // One interpolation: three roundings at sizes of at most 2.
        bounds.at(w).pad(8.0 * ULP)
    };
    own.tighter(LinearBox3 { begin: at(over.begin()), end: at(over.end()) })
}
