//! Sizes and counts of a finished tree.

use crate::mbkd::{BuildTimes, KdReference, KdTree, KdView};
use crate::primitive::PrimitiveSet;

/// Sizes and counts of a finished tree ([`RayTree::statistics`](crate::RayTree::statistics)).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Primitives in the tree.
    pub primitives: usize,
    /// Inner nodes.
    pub nodes: usize,
    /// Leaves, empty ones included.
    pub leaves: usize,
    /// Leaves without references.
    pub empty_leaves: usize,
    /// Depth of the deepest leaf; the root has depth 0.
    pub depth: u32,
    /// References in the leaves.
    pub references: usize,
    /// Share of the references that are duplicates: references beyond the first of each primitive, divided by
    /// all references.
    pub duplicates: f64,
    /// Share of the references whose time interval is a part of their primitive's, of all references.
    pub timed: f64,
    /// Share of the build time spent in duplication: distributing the Normal references of a node to its children.
    pub duplication_time: f64,
    /// Share of the build time spent in propagation: distributing the BP references.
    pub propagation_time: f64,
    /// Vertex positions of all meshes, over all keys, as given to the build.
    pub positions: usize,
    /// Those of them that are stored: keys on the straight line between others are removed, and so are keys of static
    /// vertices.
    pub kept_positions: usize,
    /// References to static triangles, in leaf blocks without motion (wide trees).
    pub static_references: usize,
    /// Temporal splits: nodes that select a child by the time of the query (wide trees).
    pub time_nodes: usize,
    /// Share of the primitives below temporal splits, each counted once for each time slice, that the slice leaves out since they do not
    /// exist in it (wide trees). 0 if everything exists all the time.
    pub left_out: f64,
    /// Subtrees that are built when a query first enters them ([`Policy::Lazy`](crate::Policy::Lazy)); 0 in other trees.
    pub subtrees: usize,
    /// Those of them that are built. Nodes, leaves, references and bytes are those of built subtrees and of the coarse
    /// tree.
    pub built_subtrees: usize,
    /// Expected cost of a ray, relative to that of the tree as it was built: 1, and usually more after a refit
    /// ([`Refit::cost`](crate::Refit::cost)).
    pub cost: f64,
    /// Bytes allocated for the tree.
    pub bytes: usize,
    /// Bytes allocated for the primitives.
    pub primitive_bytes: usize,
}

impl Statistics {
    /// References per primitive; 0 for an empty tree.
    pub fn references_per_primitive(&self) -> f64 {
        if self.primitives == 0 { 0.0 } else { self.references as f64 / self.primitives as f64 }
    }

    pub(crate) fn with_times(self, times: BuildTimes) -> Statistics {
        Statistics {
            duplication_time: times.share(times.duplication),
            propagation_time: times.share(times.propagation),
            ..self
        }
    }
}

impl KdTree {
    /// Counts nodes and references.
    pub fn statistics(&self, set: &impl PrimitiveSet) -> Statistics {
        let (mut leaves, mut empty_leaves) = (0, 0);
        for node in &self.nodes {
            if let KdView::Leaf { count, .. } = node.view() {
                leaves += 1;
                empty_leaves += usize::from(count == 0);
            }
        }
        let timed = self.references.iter().filter(|r| **r != KdReference::new(r.id, set.active(r.id))).count();
        let references = self.references.len();
        let share = |n: usize| n as f64 / references.max(1) as f64;
        Statistics {
            primitives: set.len(),
            nodes: self.nodes.len() - leaves,
            leaves,
            empty_leaves,
            depth: self.depth,
            references,
            duplicates: share(references - set.len().min(references)),
            timed: share(timed),
            positions: set.positions()[0],
            kept_positions: set.positions()[1],
            cost: 1.0,
            bytes: self.bytes(),
            primitive_bytes: set.bytes(),
            ..Statistics::default()
        }
    }
}
