//! A whole set of primitives, as builders and queries access it, in tree space. Triangle meshes are one such set; a list of
//! [`Primitive`](super::Primitive)s is another.

use super::key_window::Intervals;
use super::sphere::MovingSphere;
use crate::error::BuildError;
use crate::geometry::{Box3, CornerBounds, Frame, LaneBounds, LinearBox3, TimeInterval};
use crate::simd::LANES;

/// A set of primitives in tree space: the interface for builders and queries.
pub(crate) trait PrimitiveSet: Send + Sync {
    /// The greatest number of primitives in one leaf block of the wide layout.
    fn per_leaf(&self) -> usize {
        LANES
    }
    /// The number of primitives; ids begin at 0.
    fn len(&self) -> usize;
    /// Primitives that no query sees, in ascending order: no leaf holds them.
    fn hidden(&self) -> &[u32] {
        &[]
    }
    /// The active interval of a primitive.
    fn active(&self, id: u32) -> TimeInterval;
    /// Whether all primitives exist throughout the shutter.
    fn always_active(&self) -> bool;
    /// Whether a primitive exists at a time.
    #[inline(always)]
    fn exists_at(&self, id: u32, time: f32) -> bool {
        self.always_active() || self.active(id).contains(time)
    }
    /// The active interval of each mesh and, after these, of each shape.
    fn active_intervals(&self) -> Vec<TimeInterval> {
        (0..self.len() as u32).map(|id| self.active(id)).collect()
    }
    /// For each mesh and, after these, each shape, the interval to which refits of a tree are bound by the keys that leaf blocks
    /// hold.
    fn intervals_of_keys(&self) -> Vec<TimeInterval> {
        Vec::new()
    }
    /// Linear bounds over an interval. They contain all hits of the kernel, up to the rounding that grows with the ray's
    /// distance; the slack of traversals covers that.
    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3;
    /// The bounds of some primitives in ascending order.
    fn lane_bounds(&self, ids: &[u32], over: TimeInterval, out: &mut [LaneBounds]) {
        for (&id, to) in ids.iter().zip(out) {
            *to = LaneBounds::of(&self.bounds(id, over));
        }
    }
    /// Extends `out` by the bounds of some primitives of one kind ([`PrimitiveSet::leaf_kind`]): one element for each interval.
    fn include_bounds(&self, ids: &[u32], over: &mut Intervals<'_>, out: &mut [LinearBox3]) {
        include_each(self, ids, over, out);
    }
    /// Bounds of the part inside `cell` at one instant, for choosing planes; empty if there is none.
    fn clipped(&self, id: u32, time: f32, cell: Box3) -> Box3 {
        match TimeInterval::half_open(time, time.next_up()) {
            Some(instant) => self.bounds(id, instant).begin.intersection(cell),
            None => Box3::EMPTY,
        }
    }
    /// The kind of leaf block for a primitive. Primitives of different kinds are not put into one block; each number of
    /// keys above two is a kind.
    fn leaf_kind(&self, id: u32) -> u32 {
        let _ = id;
        0
    }
    /// Whether primitives may be of more than one kind.
    fn kinds_differ(&self) -> bool {
        self.bent()
    }
    /// Whether the memory of a leaf block for these primitives of one kind is reasonable.
    fn fits_block(&self, ids: &[u32]) -> bool {
        let _ = ids;
        true
    }
    /// A bound of the bytes of triangles' keys beyond the second and of all keys of spheres in leaf blocks, if each key is stored
    /// once.
    fn further_key_bytes(&self) -> usize {
        0
    }
    /// Whether there are triangles whose leaf blocks hold more than two keys.
    fn bent(&self) -> bool {
        false
    }
    /// Vertex positions over all keys: as given, and those that are kept.
    fn positions(&self) -> [usize; 2] {
        [0, 0]
    }
    /// Whether the primitive is proved disjoint from a cell during the whole interval, by more than the kernel's rounding,
    /// although its bounds overlap the cell. `cell` is the cell at the begin and at the end of the interval, and linear in
    /// between. `false` is always valid.
    fn is_disjoint(&self, id: u32, over: TimeInterval, cell: LinearBox3) -> bool {
        let _ = (id, over, cell);
        false
    }
    /// Linear bounds of the corners of a triangle over an interval; `None` for a primitive that is not split.
    fn corner_bounds(&self, id: u32, over: TimeInterval) -> Option<CornerBounds> {
        let _ = (id, over);
        None
    }
    /// Prefetches the vertex indices of a primitive; the vertices themselves follow with
    /// [`PrimitiveSet::prefetch_vertices`]. A hint.
    fn prefetch(&self, _: u32) {}
    /// Prefetches the vertices of a primitive, as bounds over an interval need them, whose corners were prefetched some time ago.
    fn prefetch_vertices(&self, _: u32, _over: TimeInterval) {}
    /// The sphere that a primitive is. Leaf blocks of spheres hold their positions.
    fn sphere(&self, id: u32) -> Option<&MovingSphere> {
        let _ = id;
        None
    }
    /// The visibility mask.
    fn mask(&self, id: u32) -> u32;
    /// The visibility masks of all meshes and shapes, or one that many have in common; empty if there are none.
    fn masks(&self) -> Vec<u32>;
    /// Mesh and primitive in the caller's numbering.
    fn mesh_and_primitive(&self, id: u32) -> (u32, u32) {
        (0, id)
    }
    /// The map between world and tree space.
    fn frame(&self) -> &Frame;
    /// An error if a custom primitive has returned invalid bounds since the set was made.
    fn input_error(&self) -> Result<(), BuildError> {
        Ok(())
    }
    /// Bytes allocated.
    fn bytes(&self) -> usize;
}

/// Extends `out` by the bounds of some primitives, one by one.
pub(super) fn include_each<S: PrimitiveSet + ?Sized>(
    set: &S,
    ids: &[u32],
    over: &Intervals<'_>,
    out: &mut [LinearBox3],
) {
    for (&over, to) in over.over.iter().zip(out) {
        *to = ids.iter().fold(*to, |all, &id| all.union(set.bounds(id, over)));
    }
}
