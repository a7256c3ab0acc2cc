//! Moving point trees in files.

use super::boxes::LinearBoxes;
use super::lane_intervals::LaneIntervals;
use super::moving_leaf::MovingLeaves;
use super::moving_tree::MovingTree;
use super::shape::Shape;
use crate::file::{Decoder, Encoder, FileError, record_fields, require};
use crate::limits::MAX_POINT_COORDINATE;
use crate::parallel;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::simd::{LANES, Lanes, MovingPointBlock};

record_fields!(MovingPointBlock { open: [Lanes<f32>; 3], close: [Lanes<f32>; 3], id: Lanes<u32> });
record_fields!(LaneIntervals { begin: Lanes<f32>, end: Lanes<f32> });
record_fields!(LinearBoxes {
    lo: [Lanes<f32>; 3],
    lo_slope: [Lanes<f32>; 3],
    hi: [Lanes<f32>; 3],
    hi_slope: [Lanes<f32>; 3],
});

impl MovingLeaves {
    /// Writes everything.
    pub(in crate::point) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.array(&self.blocks)?;
        to.array(&self.times)?;
        to.array(&self.active)
    }

    /// Reads leaves that [`MovingLeaves::encode`] wrote, without validating them.
    pub(in crate::point) fn decode(from: &mut Decoder<'_>) -> Result<MovingLeaves, FileError> {
        Ok(MovingLeaves { blocks: from.array()?, times: from.array()?, active: from.array()? })
    }

    /// Validates that points have valid positions and other lanes are absent, and that there are times for all or for
    /// none.
    pub(in crate::point) fn check(&self, timed: bool) -> Result<(), FileError> {
        let blocks = self.blocks.len();
        let fits = self.times.len() == if timed { blocks } else { 0 };
        require(
            fits && (self.active.is_empty() || self.active.len() == blocks),
            "the number of active intervals does not match its leaves",
        )?;
        let fine = parallel::chunks(blocks, |range| range.into_iter().all(|block| is_fine(&self.blocks[block])));
        require(fine.into_iter().all(|fine| fine), "a leaf holds invalid points")
    }
}

/// Whether each lane of a block is a point or absent. Row by row, without branches: there are many blocks.
fn is_fine(block: &MovingPointBlock) -> bool {
    const MOST: f32 = MAX_POINT_COORDINATE as f32;
    let exists = block.id.map(|id| id != u32::MAX);
    let mut fine = [true; LANES];
    for row in block.open.iter().chain(&block.close) {
        for (lane, fine) in fine.iter_mut().enumerate() {
            let x = row[lane];
            *fine &= (exists[lane] & (x.abs() <= MOST)) | (!exists[lane] & (x == f32::MAX));
        }
    }
    fine == [true; LANES]
}

/// The contents of a file for one tree, not validated yet.
pub(in crate::point) struct MovingRecord {
    count: u64,
    nodes: Vec<LinearBoxes>,
    node_times: Vec<LaneIntervals>,
    leaves: MovingLeaves,
}

impl MovingRecord {
    /// Reads a tree that `MovingTree` wrote.
    pub(in crate::point) fn decode(from: &mut Decoder<'_>) -> Result<MovingRecord, FileError> {
        let (count, nodes, node_times) = (from.get()?, from.array()?, from.array()?);
        Ok(MovingRecord { count, nodes, node_times, leaves: MovingLeaves::decode(from)? })
    }

    /// The tree of a time slice, or an error if searches cannot traverse it.
    pub(in crate::point) fn checked(self, slice: SegmentSlice) -> Result<MovingTree, FileError> {
        let MovingRecord { count, nodes, node_times, leaves } = self;
        let blocks = leaves.blocks.len();
        require(leaves.references() as u64 == count, "the number of leaves does not match its points")?;
        // Lanes may be empty where fast points were left out.
        let (count, shape) = (count as usize, Shape::with_leaf(blocks * LANES, 1));
        let timed = !node_times.is_empty();
        let fits = nodes.len() == shape.nodes() && (!timed || node_times.len() == nodes.len());
        require(fits, "the number of nodes does not match its points")?;
        leaves.check(timed)?;
        for (node, lanes) in shape.lanes(blocks) {
            let times = node_times.get(node);
            let fine = (0..LANES).all(|lane| is_child(&nodes[node], times, lane, lane < lanes));
            require(fine, "a node has an invalid box, or a box without a child")?;
        }
        Ok(MovingTree { slice, nodes, shape, leaves, node_times, references: count })
    }
}

/// Whether a lane of a node is a box with a child, or absent.
fn is_child(boxes: &LinearBoxes, times: Option<&LaneIntervals>, lane: usize, exists: bool) -> bool {
    let at = |rows: &[Lanes<f32>; 3]| rows.map(|row| row[lane]);
    let (lo, hi) = (at(&boxes.lo), at(&boxes.hi));
    let slopes = [at(&boxes.lo_slope), at(&boxes.hi_slope)];
    let absent = lo == [f32::INFINITY; 3] && hi == [f32::NEG_INFINITY; 3] && slopes == [[0.0; 3]; 2];
    let numbers = [lo, hi].iter().chain(&slopes).flatten().all(|face| face.is_finite());
    numbers && exists || absent && times.is_none_or(|times| times.is_never(lane))
}
