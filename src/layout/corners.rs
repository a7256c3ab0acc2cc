//! The corners of single triangles, read out of the leaf blocks that hold them.
//!
//! Queries never ask for them this way; normals and whoever draws a triangle do.

use super::wide_node::{CORNER_ROWS, ChildRef, Kind, VERTEX_ROWS};
use super::wide_tree::WideTree;
use crate::geometry::KeyTime;
use crate::primitive::{Scene, Triangles};
use glam::Vec3;

impl WideTree {
    /// The corners of a triangle at a time, bit for bit as queries see them.
    pub fn corners(&self, set: &Triangles, id: u32, time: f32) -> [Vec3; 3] {
        let keys = set.keys(id);
        let at = KeyTime::new(time, keys);
        match self.piece(set, id, at.segment) {
            Some((begin, _)) if keys == 1 => begin,
            Some((begin, end)) => core::array::from_fn(|i| at.position(begin[i], end[i])),
            None => [Vec3::NAN; 3],
        }
    }

    /// The corners of a triangle at both keys of a segment. There are none where the tree is broken.
    pub(crate) fn piece(&self, set: &Triangles, id: u32, segment: usize) -> Option<([Vec3; 3], [Vec3; 3])> {
        let leaf = ChildRef(*self.blocks.get(set.piece(id, segment))?);
        let lane = self.ids::<Scene>(leaf)?.iter().position(|&other| other == id)?;
        let (begin, end) = match leaf.kind() {
            Kind::StillLeaf | Kind::SharedStillLeaf => (0, 0),
            Kind::SharedLeaf => (0, VERTEX_ROWS),
            _ => (0, CORNER_ROWS),
        };
        Some((self.corners_in(leaf, lane, begin), self.corners_in(leaf, lane, end)))
    }

    /// The corners in a lane of a leaf block, at the key whose rows begin with row `first`.
    fn corners_in(&self, leaf: ChildRef, lane: usize, first: usize) -> [Vec3; 3] {
        let (n, words) = (leaf.len(), &self.arena.floats()[leaf.at()..]);
        let at = |row: usize, lane: usize| Vec3::from([0, 1, 2].map(|axis| words[(row + axis) * n + lane]));
        let shared = match leaf.kind() {
            Kind::SharedLeaf => 2 * VERTEX_ROWS,
            Kind::SharedStillLeaf => VERTEX_ROWS,
            _ => return [0, 3, 6].map(|row| at(first + row, lane)),
        };
        let vertices = self.arena.ints()[leaf.at() + shared * n + lane];
        [0, 4, 8].map(|shift| at(first, (vertices >> shift & 15) as usize))
    }
}
