//! The k-d layout over points in files.

use super::kd_points::KdPoints;
use super::moving_leaf::MovingLeaves;
use crate::file::{Decoder, FileError, broken, require};
use crate::geometry::Box3;
use crate::kd::{KdNode, check_links};
use crate::point::leaf_order::segment_slice::SegmentSlice;

/// The contents of a file for one tree, not validated yet.
pub(in crate::point) struct KdRecord {
    root: Box3,
    nodes: Vec<KdNode>,
    slack: Vec<f32>,
    leaves: MovingLeaves,
}

impl KdRecord {
    /// Reads a tree that `KdPoints` wrote.
    pub(in crate::point) fn decode(from: &mut Decoder<'_>) -> Result<KdRecord, FileError> {
        let (root, nodes, slack) = (from.get()?, from.array()?, from.array()?);
        Ok(KdRecord { root, nodes, slack, leaves: MovingLeaves::decode(from)? })
    }

    /// The tree of a time slice, or an error if searches cannot traverse it.
    pub(in crate::point) fn checked(self, slice: SegmentSlice) -> Result<KdPoints, FileError> {
        let KdRecord { root, nodes, slack, leaves } = self;
        require(!root.min.is_nan() && !root.max.is_nan(), "its bounds are not a box")?;
        let fine = slack.len() == nodes.len() && slack.iter().all(|slack| (0.0..=f32::MAX).contains(slack));
        require(fine, "the number of slacks does not match its nodes")?;
        leaves.check(true)?;
        let Ok(depth) = check_links(&nodes, leaves.blocks.len()) else {
            return broken("a node is reached twice, never, or has a link outside the tree");
        };
        let references = leaves.references();
        Ok(KdPoints { slice, root, nodes, slack, leaves, depth, references })
    }
}
