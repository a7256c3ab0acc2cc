//! Building and writing the paper's layout.

use super::kd::{KdNode, KdReference, KdTree};
use crate::error::BuildError;
use crate::geometry::{Plane, TimeInterval};
use crate::limits::MAX_NODES;
use crate::mbkd::{self, BuildTimes, Output, Root, Subtree};
use crate::params::BuildParams;
use crate::primitive::PrimitiveSet;
use crate::progress::Progress;

/// Builds a k-d tree by the policy of `params`, which must be valid.
pub(crate) fn build_kd<S: PrimitiveSet>(
    set: &S,
    params: &BuildParams,
    progress: &Progress,
) -> Result<(KdTree, BuildTimes), BuildError> {
    let Root { cell, tree } = mbkd::build::<S, Arrays>(set, params, progress)?;
    let Subtree { out: Arrays { mut nodes, mut references }, depth, times } = tree;
    if nodes.len() > MAX_NODES || references.len() > u32::MAX as usize {
        return Err(BuildError::TooManyReferences);
    }
    nodes.shrink_to_fit();
    references.shrink_to_fit();
    Ok((KdTree { root: cell, nodes, references, depth }, times))
}

/// The two arrays of a subtree; indices count from its own begin.
#[derive(Default)]
struct Arrays {
    nodes: Vec<KdNode>,
    references: Vec<KdReference>,
}

impl Output for Arrays {
    fn begin_inner(&mut self, plane: Plane) -> usize {
        self.nodes.push(KdNode::inner(plane, 0));
        self.nodes.len() - 1
    }

    fn set_right(&mut self, inner: usize) {
        // Where the index does not fit, the build is about to fail with an error.
        let right = self.nodes.len().min(MAX_NODES - 1) as u32;
        self.nodes[inner].set_right(right);
    }

    fn leaf(&mut self, references: impl Iterator<Item = (u32, TimeInterval)>) {
        let first = self.references.len();
        self.references.extend(references.map(|(id, interval)| KdReference::new(id, interval)));
        // In the order of ids: neighbours in memory, and independent of how the references came here.
        self.references[first..].sort_unstable_by_key(|r| (r.id, r.begin.to_bits()));
        self.nodes.push(KdNode::leaf(first as u32, (self.references.len() - first) as u32));
    }

    fn append(&mut self, subtree: Arrays) {
        let (node_base, reference_base) = (self.nodes.len() as u32, self.references.len() as u32);
        self.nodes.extend(subtree.nodes.iter().map(|n| n.shifted(node_base, reference_base)));
        self.references.extend_from_slice(&subtree.references);
    }
}
