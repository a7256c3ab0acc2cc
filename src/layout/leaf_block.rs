//! Writes leaf blocks: what a set of primitives stores of itself in the arena.

use super::wide_node::{CORNER_ROWS, ChildRef, Kind, VERTEX_ROWS, sizes_of};
use crate::primitive::{Primitive, PrimitiveSet, Scene, Shapes, Triangles};
use crate::simd::{Arena, LANES, Lanes};
use crate::time::TimeSlice;
use core::ops::Range;
use glam::Vec3;

/// What the wide layout needs of a set of primitives beyond [`PrimitiveSet`].
pub(crate) trait WideSource: PrimitiveSet {
    /// Whether there may be triangles, whose leaf blocks hold them; leaf blocks of other primitives are lists of ids.
    const TRIANGLES: bool;
    /// The triangles, whose ids come first.
    fn triangles(&self) -> Option<&Triangles>;
    /// Drops what leaf blocks hold now.
    fn written(&mut self) {}
    /// Writes a leaf block for queries of a slice of the shutter; nothing where the arena is full.
    fn write_leaf(&self, arena: &mut Arena, ids: &[u32], slice: TimeSlice) -> Option<ChildRef>;
}

impl WideSource for Scene {
    const TRIANGLES: bool = true;

    fn triangles(&self) -> Option<&Triangles> {
        Some(&self.triangles)
    }

    fn written(&mut self) {
        self.triangles.drop_vertices();
    }

    #[inline]
    fn write_leaf(&self, arena: &mut Arena, ids: &[u32], slice: TimeSlice) -> Option<ChildRef> {
        // What is in a block is of one kind, since the build keeps kinds apart.
        match ids.first().and_then(|&id| self.shape(id)) {
            None => self.triangles.write_leaf(arena, ids, slice),
            Some(_) => write_list(arena, ids),
        }
    }
}

impl Triangles {
    /// Writes a block of triangles.
    fn write_leaf(&self, arena: &mut Arena, ids: &[u32], slice: TimeSlice) -> Option<ChildRef> {
        let most = ids.iter().map(|&id| self.keys(id)).max().unwrap_or(1);
        let n = ids.len();
        arena.align();
        if most > 2 {
            return self.write_keyed(arena, ids, most, slice.segments(most));
        }
        if let Some(shared) = Shared::of(self, ids) {
            return shared.write(self, arena, ids, most);
        }
        let (kind, rows) = match most {
            1 => (Kind::StillLeaf, CORNER_ROWS),
            _ => (Kind::Leaf, 2 * CORNER_ROWS),
        };
        let at = arena.grow(rows * n + 1 + n);
        let (first_key, last_key) = arena.floats_mut()[at..at + rows * n].split_at_mut(CORNER_ROWS * n);
        for (lane, &id) in ids.iter().enumerate() {
            let [first, last] = self.corners_at_both(id);
            write_corners(first_key, n, lane, first);
            if kind != Kind::StillLeaf {
                write_corners(last_key, n, lane, last);
            }
        }
        let words = &mut arena.ints_mut()[at + rows * n..];
        words[0] = self.sizes(ids, 0..most.max(1));
        words[1..=n].copy_from_slice(ids);
        ChildRef::new(kind, at, n)
    }
}

impl Triangles {
    /// The sizes of a block of some triangles at some keys (see [`sizes_of`]).
    pub(super) fn sizes(&self, ids: &[u32], keys: Range<usize>) -> u32 {
        sizes_of(keys.flat_map(|key| ids.iter().map(move |&id| self.corners_at_key(id, key))))
    }
}

/// The different vertices of a few triangles.
pub(super) struct Shared {
    /// Their numbers, and how far apart their keys are.
    vertices: Lanes<u32>,
    strides: Lanes<u32>,
    pub(super) count: usize,
    /// The vertices of each triangle, four bits each.
    pub(super) corners: Lanes<u32>,
}

impl Shared {
    /// Nothing where there are too many, or as many as corners: then each triangle has its own.
    pub(super) fn of(set: &Triangles, ids: &[u32]) -> Option<Shared> {
        let mut shared = Shared { vertices: [0; LANES], strides: [0; LANES], count: 0, corners: [0; LANES] };
        // A bit for each vertex that was there, so that most of those that were not need not be looked for.
        let mut seen = 0u64;
        for (corners, &id) in shared.corners.iter_mut().zip(ids) {
            let stride = set.stride(id) as u32;
            for (i, vertex) in set.vertices(id).into_iter().enumerate() {
                let bit = 1u64 << (vertex % 64);
                let known = match seen & bit {
                    0 => None,
                    _ => shared.vertices[..shared.count].iter().position(|&v| v == vertex),
                };
                seen |= bit;
                let place = match known {
                    Some(place) => place,
                    None if shared.count == LANES => return None,
                    None => {
                        shared.vertices[shared.count] = vertex;
                        shared.strides[shared.count] = stride;
                        shared.count += 1;
                        shared.count - 1
                    }
                };
                *corners |= (place as u32) << (4 * i);
            }
        }
        (shared.count < 3 * ids.len()).then_some(shared)
    }

    /// Writes the block, of one or two keys.
    fn write(&self, set: &Triangles, arena: &mut Arena, ids: &[u32], keys: usize) -> Option<ChildRef> {
        let (v, n) = (self.count, ids.len());
        let row = keys * VERTEX_ROWS * v;
        let at = arena.grow(row + 2 * n);
        for (key, words) in arena.floats_mut()[at..at + row].chunks_exact_mut(VERTEX_ROWS * v).enumerate() {
            self.write_key(set, words, key);
        }
        let words = &mut arena.ints_mut()[at + row..];
        words[..n].copy_from_slice(&self.corners[..n]);
        words[0] |= (n as u32 - 1) << 12 | set.sizes(ids, 0..keys);
        words[n..2 * n].copy_from_slice(ids);
        ChildRef::new(if keys == 1 { Kind::SharedStillLeaf } else { Kind::SharedLeaf }, at, v)
    }
}

impl Shared {
    /// Writes the rows of one key.
    #[inline(always)]
    pub(super) fn write_key(&self, set: &Triangles, words: &mut [f32], key: usize) {
        for lane in 0..self.count {
            let position = set.position(self.vertices[lane], key * self.strides[lane] as usize);
            for axis in 0..3 {
                words[axis * self.count + lane] = position[axis];
            }
        }
    }
}

impl<P: Primitive> WideSource for Shapes<P> {
    const TRIANGLES: bool = false;

    fn triangles(&self) -> Option<&Triangles> {
        None
    }

    fn write_leaf(&self, arena: &mut Arena, ids: &[u32], _: TimeSlice) -> Option<ChildRef> {
        write_list(arena, ids)
    }
}

/// Writes a list of ids.
pub(crate) fn write_list(arena: &mut Arena, ids: &[u32]) -> Option<ChildRef> {
    arena.align();
    let at = arena.grow(ids.len());
    arena.ints_mut()[at..at + ids.len()].copy_from_slice(ids);
    ChildRef::new(Kind::OwnLeaf, at, ids.len())
}

/// Writes the corners of one triangle into lane `lane` of nine rows of `n`.
#[inline(always)]
pub(super) fn write_corners(words: &mut [f32], n: usize, lane: usize, [a, b, c]: [Vec3; 3]) {
    for (row, x) in words.chunks_exact_mut(n).zip([a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z]) {
        row[lane] = x;
    }
}
