//! Static point trees in files.

use super::boxes::Boxes;
use super::shape::Shape;
use super::static_tree::{LastOrder, StaticTree};
use crate::file::{Decoder, FileError, Record, record_fields, require};
use crate::limits::{MAX_LEVELS, MAX_POINT_COORDINATE};
use crate::parallel;
use crate::simd::{LANES, Lanes, PointBlock};

record_fields!(Boxes { lo: [Lanes<f32>; 3], hi: [Lanes<f32>; 3] });

impl Record for PointBlock {
    const BYTES: usize = 256;
    #[inline(always)]
    fn put(&self, to: &mut [u8]) {
        self.at.put(&mut to[..192]);
        self.id.put(&mut to[192..]);
    }
    #[inline(always)]
    fn get(from: &[u8]) -> PointBlock {
        // Row by row: an array of rows is copied once more.
        let row = |i: usize| Record::get(&from[64 * i..64 * (i + 1)]);
        PointBlock { at: [row(0), row(1), row(2)], id: Record::get(&from[192..]) }
    }
}

/// Faces of boxes that hold points are nearer to zero than this, several times the limit of coordinates.
pub(in crate::point) const FARTHEST_FACE: f32 = 1e19;

/// The contents of a file for one tree, not validated yet.
pub(in crate::point) struct StaticRecord {
    count: u64,
    ordered: Vec<f64>,
    nodes: Vec<Boxes>,
    blocks: Vec<PointBlock>,
}

impl StaticRecord {
    /// Reads a tree that `StaticTree` wrote.
    pub(in crate::point) fn decode(from: &mut Decoder<'_>) -> Result<StaticRecord, FileError> {
        let (count, ordered) = (from.get()?, from.array()?);
        Ok(StaticRecord { count, ordered, nodes: from.array()?, blocks: from.array()? })
    }

    /// The tree, or an error if searches cannot traverse it.
    pub(in crate::point) fn checked(self) -> Result<StaticTree, FileError> {
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
        let ordered = match *ordered {
            [] => None,
            [excess, ref sizes @ ..] => {
                require(sizes.len() == MAX_LEVELS, "what is known of its order has another length")?;
                Some(Box::new(LastOrder { sizes: core::array::from_fn(|level| sizes[level]), excess }))
            }
        };
        Ok(StaticTree { nodes, blocks, shape, references: count, ordered })
    }
}

/// Whether the first `count` lanes of a block are points, and the others absent. Row by row and without branches, so that
/// the comparisons are vectorized.
fn is_fine(block: &PointBlock, count: usize) -> bool {
    const MOST: f32 = MAX_POINT_COORDINATE as f32;
    let mut fine = [true; LANES];
    if count >= LANES {
        for row in &block.at {
            for (fine, x) in fine.iter_mut().zip(row) {
                *fine &= x.abs() <= MOST;
            }
        }
        for (fine, &id) in fine.iter_mut().zip(&block.id) {
            *fine &= id != u32::MAX;
        }
    } else {
        for (lane, fine) in fine.iter_mut().enumerate() {
            let (at, id) = (block.at.map(|row| row[lane]), block.id[lane]);
            *fine = if lane < count {
                at.iter().all(|x| x.abs() <= MOST) && id != u32::MAX
            } else {
                at == [f32::INFINITY; 3] && id == u32::MAX
            };
        }
    }
    fine == [true; LANES]
}

/// Whether boxes are finite and in range, and absent if there is no child.
pub(in crate::point) fn are_fine(boxes: &Boxes, lanes: usize) -> bool {
    (0..LANES).all(|lane| {
        let at = |rows: &[Lanes<f32>; 3]| rows.map(|row| row[lane]);
        let (lo, hi) = (at(&boxes.lo), at(&boxes.hi));
        let absent = lo == [f32::INFINITY; 3] && hi == [f32::NEG_INFINITY; 3];
        let near = lo.into_iter().chain(hi).all(|face| face.abs() <= FARTHEST_FACE);
        absent || near && lane < lanes
    })
}
