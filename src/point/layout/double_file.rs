//! Trees over f64 points in files.

use super::double_box::DoubleNode;
use super::double_tree::{ABSENT, DoubleBlock, DoubleTree};
use crate::file::{Decoder, FileError, record_fields, require};
use crate::limits::MAX_COORDINATE;
use crate::parallel;
use crate::point::layout::boxes::Boxes;
use crate::point::layout::lane_intervals::LaneIntervals;
use crate::point::layout::static_file::{FARTHEST_FACE, are_fine};
use crate::point::layout::view::DoubleRows;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::simd::{LANES, Lanes};
use glam::DVec3;

record_fields!(DoubleNode { middle: [f64; 3], displacement: [f64; 3], boxes: Boxes });
record_fields!(DoubleRows { 0: [Lanes<f64>; 3] });
record_fields!(DoubleBlock { begin: DoubleRows, id: Lanes<u32> });

/// The contents of a file for one tree, not validated yet.
pub(in crate::point) struct DoubleRecord {
    count: u64,
    nodes: Vec<DoubleNode>,
    slopes: Vec<Boxes>,
    blocks: Vec<DoubleBlock>,
    ends: Vec<DoubleRows>,
    node_times: Vec<LaneIntervals>,
    block_times: Vec<LaneIntervals>,
    active: Vec<LaneIntervals>,
}

impl DoubleRecord {
    /// Reads a tree that `DoubleTree` wrote.
    pub(in crate::point) fn decode(from: &mut Decoder<'_>) -> Result<DoubleRecord, FileError> {
        Ok(DoubleRecord {
            count: from.get()?,
            nodes: from.array()?,
            slopes: from.array()?,
            blocks: from.array()?,
            ends: from.array()?,
            node_times: from.array()?,
            block_times: from.array()?,
            active: from.array()?,
        })
    }

    /// Whether its points may move or exist for a while only.
    pub(in crate::point) fn moves(&self) -> bool {
        !self.slopes.is_empty()
    }

    /// The tree of a time slice around an origin, or an error if searches cannot traverse it.
    pub(in crate::point) fn checked(self, slice: SegmentSlice, origin: DVec3) -> Result<DoubleTree, FileError> {
        let (moves, timed) = (self.moves(), !self.node_times.is_empty());
        let DoubleRecord { count, nodes, slopes, blocks, ends, node_times, block_times, active } = self;
        require(count <= (blocks.len() * LANES) as u64, "it has more points than leaves could hold")?;
        let references = count as usize;
        let shape = DoubleTree::shape(references, moves);
        let leaves = references.div_ceil(shape.leaf());
        require(blocks.len() == leaves * shape.leaf_blocks, "the number of leaves does not match its points")?;
        let all = |needed: bool, of: usize| if needed { of } else { 0 };
        let of_nodes = nodes.len() == shape.nodes()
            && slopes.len() == all(moves, nodes.len())
            && node_times.len() == all(timed, nodes.len());
        require(of_nodes, "the number of nodes does not match its points")?;
        let of_blocks = ends.len() == all(moves, blocks.len())
            && block_times.len() == all(timed, blocks.len())
            && active.len() == all(!active.is_empty(), blocks.len());
        require(
            of_blocks && (moves || !timed && active.is_empty()),
            "the number of active intervals does not match its leaves",
        )?;
        let tree =
            DoubleTree { slice, shape, nodes, slopes, blocks, ends, node_times, block_times, active, references };
        let fine =
            parallel::chunks(tree.blocks.len(), |range| range.into_iter().all(|block| tree.block_is_fine(block)));
        require(fine.into_iter().all(|fine| fine), "a leaf holds invalid points")?;
        let fine = tree.shape.lanes(leaves).all(|(node, lanes)| tree.node_is_fine(node, lanes, origin));
        require(fine, "a node has an invalid box, or a box without a child")?;
        Ok(tree)
    }
}

impl DoubleTree {
    /// Whether the first lanes of a block are points and the others absent.
    fn block_is_fine(&self, block: usize) -> bool {
        let DoubleBlock { begin, id } = &self.blocks[block];
        let end = self.ends.get(block).unwrap_or(begin);
        let count = self.references.saturating_sub(block * LANES);
        (0..LANES).all(|lane| {
            let exists = id[lane] != u32::MAX;
            let fine = (0..3).all(|axis| {
                let (a, b) = (begin.0[axis][lane], end.0[axis][lane]);
                if exists { a.abs() <= MAX_COORDINATE && b.abs() <= MAX_COORDINATE } else { a == ABSENT && b == ABSENT }
            });
            fine && exists == (lane < count)
        })
    }

    /// Whether boxes and their centre are finite and in range, and absent where there is no child.
    fn node_is_fine(&self, node: usize, lanes: usize, origin: DVec3) -> bool {
        let DoubleNode { middle, displacement, boxes } = &self.nodes[node];
        let near = |x: f64| x.abs() <= f64::from(FARTHEST_FACE);
        let has_children = lanes > 0;
        let placed = (0..3).all(|axis| near(middle[axis] - origin[axis]) || !has_children && middle[axis] == 0.0);
        let fine = placed && displacement.iter().all(|&x| near(x));
        let absent = |lane: usize| boxes.lo[0][lane] == f32::INFINITY;
        fine && are_fine(boxes, lanes)
            && (0..LANES).all(|lane| {
                let slopes =
                    self.slopes.get(node).map(|boxes| [boxes.lo, boxes.hi].map(|rows| rows.map(|row| row[lane])));
                let unmoved = slopes.is_none_or(|slopes| slopes == [[0.0; 3]; 2]);
                let moving = slopes.is_none_or(|slopes| slopes.iter().flatten().all(|x| x.abs() <= FARTHEST_FACE));
                let times = self.node_times.get(node);
                if absent(lane) { unmoved && times.is_none_or(|times| times.is_never(lane)) } else { moving }
            })
    }
}
