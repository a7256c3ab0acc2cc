//! What a build made, in numbers.

use crate::mbkd::BuildTimes;

/// Figures of a finished tree ([`RayTree::statistics`](crate::RayTree::statistics)).
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// Share of the references that count for a part of their primitive's time only, of all references.
    pub timed: f64,
    /// Share of the building time spent in duplication: handing the Normal references of a node to its children.
    pub duplication_time: f64,
    /// Share of the building time spent in propagation: handing on the BP references.
    pub propagation_time: f64,
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
