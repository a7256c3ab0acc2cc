//! The corners of single triangles, read from the leaf blocks that hold them.
//!
//! Queries read whole blocks instead; this is for normals and for drawing.

use super::keyed_leaf::KeyedLeaf;
use super::wide_node::{CORNER_ROWS, ChildRef, Kind, VERTEX_ROWS};
use super::wide_tree::WideTree;
use crate::geometry::KeyTime;
use crate::primitive::{PrimitiveSet, Scene, Triangles};
use glam::{DVec3, Vec3};

impl WideTree {
    /// The corners of a triangle at any time, bit for bit as ray queries see them where it exists. NaN if the tree is damaged.
    pub fn corners(&self, set: &Triangles, id: u32, time: f32) -> [DVec3; 3] {
        self.corners_at(set, id, time).unwrap_or([DVec3::NAN; 3])
    }

    fn corners_at(&self, set: &Triangles, id: u32, time: f32) -> Option<[DVec3; 3]> {
        let (first, count) = set.entries_of(id, self.slices);
        // In the nearest slice in which the triangle exists.
        let active = set.active(id);
        let slice = KeyTime::new(time.clamp(active.begin(), active.last()), count + 1).segment;
        let leaf = ChildRef(*self.blocks.get(first + slice)?);
        let lane = self.ids::<Scene>(leaf)?.iter().position(|&other| other == id)?;
        let (at, n) = (leaf.at(), leaf.len());
        let (linear, key) = (KeyTime::new(time, 2), CORNER_ROWS * n);
        let corners = match leaf.kind() {
            Kind::StaticLeaf => return Some(self.own(at, n, lane).map(Vec3::as_dvec3)),
            Kind::SharedStaticLeaf => {
                return Some(self.shared(at, n, at + VERTEX_ROWS * n + lane).map(Vec3::as_dvec3));
            }
            Kind::SharedLeaf => {
                let numbers = at + 2 * VERTEX_ROWS * n + lane;
                (linear, self.shared(at, n, numbers), self.shared(at + VERTEX_ROWS * n, n, numbers))
            }
            Kind::OtherLeaf => {
                let keyed = KeyedLeaf::read(self.arena.ints(), leaf);
                let time = KeyTime::within(time, keyed.segments + 1, set.segments_of_life(id));
                let (rows, numbers) = (at + keyed.rows(time.segment), at + keyed.vertices() + lane);
                match keyed.shared {
                    true => (time, self.shared(rows, n, numbers), self.shared(rows + VERTEX_ROWS * n, n, numbers)),
                    false => (time, self.own(rows, n, lane), self.own(rows + key, n, lane)),
                }
            }
            _ => (linear, self.own(at, n, lane), self.own(at + key, n, lane)),
        };
        let (time, begin, end) = corners;
        Some(core::array::from_fn(|i| time.fine_position(begin[i].as_dvec3(), end[i].as_dvec3())))
    }

    /// The corners in one lane of nine rows of n floats each.
    fn own(&self, rows: usize, n: usize, lane: usize) -> [Vec3; 3] {
        [0, 3, 6].map(|row| self.place(rows + row * n, n, lane))
    }

    /// The shared vertices of a triangle in rows of n, whose numbers are a word of the arena.
    fn shared(&self, rows: usize, n: usize, numbers: usize) -> [Vec3; 3] {
        let vertices = self.arena.ints()[numbers];
        [0, 4, 8].map(|shift| self.place(rows, n, (vertices >> shift & 15) as usize))
    }

    /// The coordinates in one lane of three rows of n.
    fn place(&self, rows: usize, n: usize, lane: usize) -> Vec3 {
        Vec3::from([0, 1, 2].map(|axis| self.arena.floats()[rows + axis * n + lane]))
    }
}
