//! The corners of single triangles, read from the leaf blocks that hold them.
//!
//! Queries read whole blocks instead; this is for normals and for drawing.

use super::leaf::keyed::KeyedLeaf;
use super::wide_node::{CORNER_ROWS, ChildRef, Kind, VERTEX_ROWS};
use super::wide_tree::WideTree;
use crate::geometry::KeyTime;
use crate::primitive::{PrimitiveSet, Triangles};
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
        let lane = self.ids(leaf)?.iter().position(|&other| other == id)?;
        Some(self.corners_in(leaf, lane, time, || set.segments_of_life(id)))
    }

    /// The corners of the triangle in one lane of a leaf block at a time, whose mesh exists in the motion segments `life`.
    pub(super) fn corners_in(
        &self,
        leaf: ChildRef,
        lane: usize,
        time: f32,
        life: impl FnOnce() -> [usize; 2],
    ) -> [DVec3; 3] {
        let (at, n) = (leaf.at(), leaf.len());
        let (linear, key) = (KeyTime::new(time, 2), CORNER_ROWS * n);
        let corners = match leaf.kind() {
            Kind::StaticLeaf => return fine(self.own(at, n, lane)),
            Kind::SharedStaticLeaf => return fine(self.shared(at, n, at + VERTEX_ROWS * n + lane)),
            Kind::SharedLeaf => {
                let numbers = at + 2 * VERTEX_ROWS * n + lane;
                (linear, self.shared(at, n, numbers), self.shared(at + VERTEX_ROWS * n, n, numbers))
            }
            Kind::OtherLeaf => {
                let keyed = KeyedLeaf::read(self.arena.ints(), leaf);
                let time = KeyTime::within(time, keyed.segments + 1, life());
                let (rows, numbers) = (at + keyed.rows(time.segment), at + keyed.vertices() + lane);
                match keyed.shared {
                    true => (time, self.shared(rows, n, numbers), self.shared(rows + VERTEX_ROWS * n, n, numbers)),
                    false => (time, self.own(rows, n, lane), self.own(rows + key, n, lane)),
                }
            }
            _ => (linear, self.own(at, n, lane), self.own(at + key, n, lane)),
        };
        let (time, begin, end) = corners;
        let ([a, b, c], [d, e, f]) = (fine(begin), fine(end));
        [time.fine_position(a, d), time.fine_position(b, e), time.fine_position(c, f)]
    }

    // Each number by itself here and below: closures in `map` of an array become calls, with which this takes twice as long.

    /// The corners in one lane of nine rows of n floats each.
    #[inline(always)]
    fn own(&self, rows: usize, n: usize, lane: usize) -> [Vec3; 3] {
        [self.place(rows, n, lane), self.place(rows + 3 * n, n, lane), self.place(rows + 6 * n, n, lane)]
    }

    /// The shared vertices of a triangle in rows of n, whose numbers are a word of the arena.
    #[inline(always)]
    fn shared(&self, rows: usize, n: usize, numbers: usize) -> [Vec3; 3] {
        let vertices = self.arena.ints()[numbers] as usize;
        let vertex = |shift: u32| self.place(rows, n, vertices >> shift & 15);
        [vertex(0), vertex(4), vertex(8)]
    }

    /// The coordinates in one lane of three rows of n.
    #[inline(always)]
    fn place(&self, rows: usize, n: usize, lane: usize) -> Vec3 {
        let floats = &self.arena.floats()[rows + lane..];
        Vec3::new(floats[0], floats[n], floats[2 * n])
    }
}

/// Three points in f64.
#[inline(always)]
fn fine([a, b, c]: [Vec3; 3]) -> [DVec3; 3] {
    [a.as_dvec3(), b.as_dvec3(), c.as_dvec3()]
}
