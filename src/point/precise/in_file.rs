//! Trees of f64 points in files.

use super::hull::Middle;
use super::tree::{ABSENT, PreciseTree, Rows};
use crate::file::{Decoder, Encoder, FileError, Record, require};
use crate::parallel;
use crate::point::moving_file::never;
use crate::point::moving_leaf::Times;
use crate::point::moving_reference::Part;
use crate::point::snapshot::Boxes;
use crate::point::static_file::{FARTHEST_FACE, are_fine};
use crate::point::static_tree::Shape;
use crate::simd::{LANES, Lanes};
use glam::DVec3;

impl Record for Middle {
    const BYTES: usize = 56;
    fn put(&self, to: &mut [u8]) {
        [self.at, self.way].put(&mut to[..48]);
        self.slack.put(&mut to[48..]);
    }
    fn get(from: &[u8]) -> Middle {
        let [at, way] = Record::get(&from[..48]);
        Middle { at, way, slack: Record::get(&from[48..]) }
    }
}

/// What a file says of a tree.
pub(in crate::point) struct PreciseRecord {
    count: u64,
    nodes: Vec<Boxes>,
    slopes: Vec<Boxes>,
    middles: Vec<Middle>,
    begins: Vec<Rows>,
    ends: Vec<Rows>,
    ids: Vec<Lanes<u32>>,
    node_times: Vec<Times>,
    block_times: Vec<Times>,
    lives: Vec<Times>,
}

impl PreciseTree {
    /// Writes everything but which part of the shutter it is for.
    pub(in crate::point) fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put(self.references as u64)?;
        to.array(&self.nodes)?;
        to.array(&self.slopes)?;
        to.array(&self.middles)?;
        to.array(&self.begins)?;
        to.array(&self.ends)?;
        to.array(&self.ids)?;
        to.array(&self.node_times)?;
        to.array(&self.block_times)?;
        to.array(&self.lives)
    }
}

impl PreciseRecord {
    /// Reads what was written.
    pub(in crate::point) fn decode(from: &mut Decoder<'_>) -> Result<PreciseRecord, FileError> {
        Ok(PreciseRecord {
            count: from.get()?,
            nodes: from.array()?,
            slopes: from.array()?,
            middles: from.array()?,
            begins: from.array()?,
            ends: from.array()?,
            ids: from.array()?,
            node_times: from.array()?,
            block_times: from.array()?,
            lives: from.array()?,
        })
    }

    /// Whether it is of points that move or live for a while.
    pub(in crate::point) fn moves(&self) -> bool {
        !self.slopes.is_empty()
    }

    /// The tree of a part of the shutter around an origin, if searches can walk it.
    pub(in crate::point) fn checked(self, part: Part, origin: DVec3) -> Result<PreciseTree, FileError> {
        let (moves, timed) = (self.moves(), !self.node_times.is_empty());
        let PreciseRecord { count, nodes, slopes, middles, begins, ends, ids, node_times, block_times, lives } = self;
        let blocks = begins.len();
        require(count.div_ceil(LANES as u64) == blocks as u64, "it has not as many leaves as its points need")?;
        let references = count as usize;
        let shape = Shape::with_leaf(references, 1);
        let all = |needed: bool, of: usize| if needed { of } else { 0 };
        let of_nodes = [nodes.len(), middles.len()] == [shape.nodes(); 2]
            && slopes.len() == all(moves, nodes.len())
            && node_times.len() == all(timed, nodes.len());
        require(of_nodes, "it has not as many nodes as its points need")?;
        let of_blocks = ids.len() == blocks
            && ends.len() == all(moves, blocks)
            && block_times.len() == all(timed, blocks)
            && lives.len() == all(!lives.is_empty(), blocks);
        require(of_blocks && (moves || !timed && lives.is_empty()), "it has not as many times as leaves")?;
        let tree = PreciseTree {
            part,
            shape,
            nodes,
            slopes,
            middles,
            begins,
            ends,
            ids,
            node_times,
            block_times,
            lives,
            references,
        };
        let fine = parallel::chunks(blocks, |range| range.into_iter().all(|block| tree.block_is_fine(block)));
        require(fine.into_iter().all(|fine| fine), "a leaf holds something else than points")?;
        let fine = tree.shape.lanes(blocks).all(|(node, lanes)| tree.node_is_fine(node, lanes, origin));
        require(fine, "a node has a box that is none, or nothing in it")?;
        Ok(tree)
    }
}

impl PreciseTree {
    /// Whether the first lanes of a block are points and the others nothing.
    fn block_is_fine(&self, block: usize) -> bool {
        let (begin, end) = (&self.begins[block], self.ends.get(block).unwrap_or(&self.begins[block]));
        let count = self.references.saturating_sub(block * LANES);
        (0..LANES).all(|lane| {
            let there = self.ids[block][lane] != u32::MAX;
            let fine = (0..3).all(|axis| {
                let (a, b) = (begin[axis][lane], end[axis][lane]);
                // Also their difference is a number.
                if there { (b - a).is_finite() && a.is_finite() } else { a == ABSENT && b == ABSENT }
            });
            fine && there == (lane < count)
        })
    }

    /// Whether boxes and what they are relative to are numbers, and absent where there is no child.
    fn node_is_fine(&self, node: usize, lanes: usize, origin: DVec3) -> bool {
        let Middle { at, way, slack } = self.middles[node];
        let near = |x: f64| x.abs() <= f64::from(FARTHEST_FACE);
        let has_children = lanes > 0;
        let middle = (0..3).all(|axis| near(at[axis] - origin[axis]) || !has_children && at[axis] == 0.0);
        let fine = middle && way.into_iter().all(near) && (0.0..=f64::from(f32::MAX)).contains(&slack);
        let absent = |lane: usize| self.nodes[node].lo[0][lane] == f32::INFINITY;
        fine && are_fine(&self.nodes[node], lanes)
            && (0..LANES).all(|lane| {
                let slopes =
                    self.slopes.get(node).map(|boxes| [boxes.lo, boxes.hi].map(|rows| rows.map(|row| row[lane])));
                let still = slopes.is_none_or(|slopes| slopes == [[0.0; 3]; 2]);
                let moving = slopes.is_none_or(|slopes| slopes.iter().flatten().all(|x| x.abs() <= FARTHEST_FACE));
                let times = self.node_times.get(node);
                if absent(lane) { still && times.is_none_or(|times| never(times, lane)) } else { moving }
            })
    }
}
