//! Writes leaf blocks: what a set of primitives stores of itself in the arena.

use super::layout::LeafShape;
use crate::build::object::Ends;
use crate::motion::{Primitive, PrimitiveSet, Shapes, TimeInterval, Triangles, ULP};
use crate::simd::Arena;
use glam::Vec3;

/// What the wide layout needs of a set of primitives beyond [`PrimitiveSet`].
pub(crate) trait WideSource: PrimitiveSet {
    /// Whether leaf blocks may be lists of ids.
    const LISTS: bool;
    /// Number of keys of a primitive's motion; 1 for what stands still.
    fn keys(&self, id: u32) -> usize;
    /// The corners at both ends of an interval in which they move linearly, of a primitive that may be cut.
    fn ends(&self, id: u32, over: TimeInterval) -> Option<Ends>;
    /// How a leaf block with these primitives is stored.
    fn leaf_shape(&self, ids: &[u32]) -> LeafShape;
    /// Writes a leaf block for the key segment that begins at key `segment`.
    fn write_leaf(&self, arena: &mut Arena, shape: LeafShape, ids: &[u32], segment: usize) -> usize;
}

impl WideSource for Triangles {
    const LISTS: bool = false;

    fn keys(&self, id: u32) -> usize {
        Triangles::keys(self, id)
    }

    fn ends(&self, id: u32, over: TimeInterval) -> Option<Ends> {
        let slack = match Triangles::keys(self, id) {
            1 => 0.0,
            2 => 4.0 * ULP,
            // The interval reaches 4 ULP of the shutter beyond the segment, where corners already move
            // differently, by at most 2 per segment.
            n => (4 + 26 * (n - 1)) as f32 * ULP,
        };
        Some(Ends { begin: self.corners(id, over.begin()), end: self.corners(id, over.end()), slack })
    }

    fn leaf_shape(&self, ids: &[u32]) -> LeafShape {
        match ids.iter().map(|&id| Triangles::keys(self, id)).max() {
            None | Some(1) => LeafShape::Still,
            Some(2) => LeafShape::Moving,
            Some(_) => LeafShape::Keyed,
        }
    }

    fn write_leaf(&self, arena: &mut Arena, shape: LeafShape, ids: &[u32], segment: usize) -> usize {
        let n = ids.len();
        let id_row = shape.ids(n);
        let at = arena.grow(id_row + n + usize::from(shape == LeafShape::Keyed));
        let mut segments = 1;
        for (lane, &id) in ids.iter().enumerate() {
            let keys = Triangles::keys(self, id);
            let first = segment.min(keys - 1);
            write_corners(&mut arena.floats_mut()[at..], n, lane, self.corners_at_key(id, first));
            if shape != LeafShape::Still {
                let last = (segment + 1).min(keys - 1);
                write_corners(&mut arena.floats_mut()[at + id_row / 2..], n, lane, self.corners_at_key(id, last));
                segments = segments.max(keys - 1);
            }
            arena.ints_mut()[at + id_row + lane] = id;
        }
        if shape == LeafShape::Keyed {
            arena.ints_mut()[at + id_row + n] = segments as u32;
        }
        at
    }
}

impl<P: Primitive> WideSource for Shapes<P> {
    const LISTS: bool = true;

    fn keys(&self, id: u32) -> usize {
        let bounds = self.bounds(id, TimeInterval::FULL);
        if bounds.begin == bounds.end { 1 } else { 2 }
    }

    fn ends(&self, _: u32, _: TimeInterval) -> Option<Ends> {
        None
    }

    fn leaf_shape(&self, _: &[u32]) -> LeafShape {
        LeafShape::List
    }

    fn write_leaf(&self, arena: &mut Arena, _: LeafShape, ids: &[u32], _: usize) -> usize {
        let at = arena.grow(ids.len());
        arena.ints_mut()[at..at + ids.len()].copy_from_slice(ids);
        at
    }
}

/// Writes the corners of one triangle into lane `lane` of rows of `n`, beginning at word `at`.
fn write_corners(words: &mut [f32], n: usize, lane: usize, corners: [Vec3; 3]) {
    for (i, corner) in corners.into_iter().enumerate() {
        for axis in 0..3 {
            words[(3 * i + axis) * n + lane] = corner[axis];
        }
    }
}
