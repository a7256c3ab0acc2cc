//! The k-d layout over points in files.

use super::moving_leaf::MovingLeaves;
use super::plane_tree::PlaneTree;
use crate::file::{Decoder, Encoder, FileError, broken, require};
use crate::geometry::Box3;
use crate::kd::{KdNode, check_links};
use crate::point::leaf_order::segment_slice::SegmentSlice;

/// The contents of a file for one tree, not validated yet.
pub(in crate::point) struct PlaneRecord {
    root: Box3,
    nodes: Vec<KdNode>,
    slack: Vec<f32>,
    leaves: MovingLeaves,
}

impl PlaneTree {
    /// Writes everything except the time slice.
    pub(in crate::point) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put(self.root)?;
        to.array(&self.nodes)?;
        to.array(&self.slack)?;
        self.leaves.encode(to)
    }
}

impl PlaneRecord {
    /// Reads a tree that [`PlaneTree::encode`] wrote.
    pub(in crate::point) fn decode(from: &mut Decoder<'_>) -> Result<PlaneRecord, FileError> {
        let (root, nodes, slack) = (from.get()?, from.array()?, from.array()?);
        Ok(PlaneRecord { root, nodes, slack, leaves: MovingLeaves::decode(from)? })
    }

    /// The tree of a time slice, or an error if searches cannot traverse it.
    pub(in crate::point) fn checked(self, slice: SegmentSlice) -> Result<PlaneTree, FileError> {
        let PlaneRecord { root, nodes, slack, leaves } = self;
        require(!root.min.is_nan() && !root.max.is_nan(), "its bounds are not a box")?;
        let fine = slack.len() == nodes.len() && slack.iter().all(|slack| (0.0..=f32::MAX).contains(slack));
        require(fine, "the number of slacks does not match its nodes")?;
        leaves.check(true)?;
        let Ok(depth) = check_links(&nodes, leaves.blocks.len()) else {
            return broken("a node is reached twice, never, or has a link outside the tree");
        };
        let references = leaves.all_ids().count();
        Ok(PlaneTree { slice, root, nodes, slack, leaves, depth, references })
    }
}
