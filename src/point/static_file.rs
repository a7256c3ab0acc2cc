//! Static point trees in files.

use super::snapshot::Boxes;
use super::static_tree::{Ordered, Shape, StaticTree};
use crate::file::{Decoder, Encoder, FileError, record_fields, require};
use crate::limits::MAX_POINT_COORDINATE;
use crate::parallel;
use crate::simd::{LANES, Lanes, PointBlock};

record_fields!(PointBlock { at: [Lanes<f32>; 3], id: Lanes<u32> });
record_fields!(Boxes { lo: [Lanes<f32>; 3], hi: [Lanes<f32>; 3] });

/// Faces of boxes that hold points are nearer to zero than this, several times the limit of coordinates.
pub(super) const FARTHEST_FACE: f32 = 1e19;

/// The contents of a file for one tree, not validated yet.
pub(super) struct StaticRecord {
    count: u64,
    ordered: Vec<[f64; 2]>,
    nodes: Vec<Boxes>,
    blocks: Vec<PointBlock>,
}

impl StaticTree {
    /// Number of points.
    fn count(&self) -> usize {
        self.blocks.iter().flat_map(|block| block.id).filter(|&id| id != u32::MAX).count()
    }

    /// Writes everything.
    pub(super) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put(self.count() as u64)?;
        let ordered = self.ordered.map(|ordered| [ordered.spread, ordered.excess]);
        to.array(ordered.as_slice())?;
        to.array(&self.nodes)?;
        to.array(&self.blocks)
    }
}

impl StaticRecord {
    /// Reads a tree that [`StaticTree::encode`] wrote.
    pub(super) fn decode(from: &mut Decoder<'_>) -> Result<StaticRecord, FileError> {
        let (count, ordered) = (from.get()?, from.array()?);
        Ok(StaticRecord { count, ordered, nodes: from.array()?, blocks: from.array()? })
    }

    /// The tree and the number of its points, or an error if searches cannot traverse it.
    pub(super) fn checked(self) -> Result<(StaticTree, usize), FileError> {
        let StaticRecord { count, ordered, nodes, blocks } = self;
        require(count <= (blocks.len() * LANES) as u64, "it has more points than leaves could hold")?;
        let count = count as usize;
        let shape = Shape::flattest(count);
        let leaves = shape.begin[1] * LANES;
        let fits = nodes.len() == shape.nodes() && blocks.len() == leaves * shape.leaf_blocks;
        require(fits, "the numbers of nodes and leaves do not match its points")?;
        let blocks_fine = parallel::chunks(blocks.len(), |range| {
            range.into_iter().all(|block| is_fine(&blocks[block], count.saturating_sub(block * LANES)))
        });
        require(blocks_fine.into_iter().all(|fine| fine), "a leaf holds invalid points")?;
        let fine = shape.lanes(leaves).all(|(node, lanes)| are_fine(&nodes[node], lanes));
        require(fine, "a node has an invalid box, or a box without a child")?;
        let ordered = ordered.first().map(|&[spread, excess]| Ordered { spread, excess });
        Ok((StaticTree { nodes, blocks, shape, ordered }, count))
    }
}

/// Whether the first `count` lanes of a block are points, and the others absent.
fn is_fine(block: &PointBlock, count: usize) -> bool {
    // Without branches, so that the comparisons are vectorized.
    let mut fine = true;
    for lane in 0..LANES {
        let [x, y, z] = block.at.map(|row| row[lane]);
        let point = is_place([x, y, z]) & (block.id[lane] != u32::MAX);
        let nothing = (x == f32::INFINITY) & (y == f32::INFINITY) & (z == f32::INFINITY) & (block.id[lane] == u32::MAX);
        fine &= if lane < count { point } else { nothing };
    }
    fine
}

/// Whether a point may have this position.
#[inline(always)]
fn is_place([x, y, z]: [f32; 3]) -> bool {
    const MOST: f32 = MAX_POINT_COORDINATE as f32;
    (x.abs() <= MOST) & (y.abs() <= MOST) & (z.abs() <= MOST)
}

/// Whether boxes are finite and in range, and absent if there is no child.
pub(super) fn are_fine(boxes: &Boxes, lanes: usize) -> bool {
    (0..LANES).all(|lane| {
        let at = |rows: &[Lanes<f32>; 3]| rows.map(|row| row[lane]);
        let (lo, hi) = (at(&boxes.lo), at(&boxes.hi));
        let absent = lo == [f32::INFINITY; 3] && hi == [f32::NEG_INFINITY; 3];
        let near = lo.into_iter().chain(hi).all(|face| face.abs() <= FARTHEST_FACE);
        absent || near && lane < lanes
    })
}
