//! What the wide layout asks of a set of primitives, and its leaf blocks whatever they hold.

use crate::geometry::{LinearBox3, TimeInterval};
use crate::layout::leaf::spheres::{rewrite_shapes, shapes_words, write_shapes};
use crate::layout::wide_node::ChildRef;
use crate::primitive::{PrimitiveSet, Scene, Triangles};
use crate::simd::{Arena, SimdLevel};
use crate::time::TimeSlice;

/// The requirements of the wide layout on a set of primitives, beyond [`PrimitiveSet`].
pub(crate) trait WideSource: PrimitiveSet {
    /// The triangles, if the set may have some. Their ids come first; their corners are in leaf blocks, in f32. Leaf blocks of
    /// other primitives are lists of ids.
    fn triangles(&self) -> Option<&Triangles> {
        None
    }
    /// Whether leaves only list the id of a primitive: false for triangles whose corners are in leaf blocks.
    fn is_listed(&self, id: u32) -> bool {
        let _ = id;
        true
    }
    /// Releases the data that only the build needs: leaf blocks have copies of it.
    fn release_build_data(&mut self) {}

    // What follows is the same for all sets.

    /// The triangles, if these primitives of one leaf block are some. (The build separates kinds.)
    #[inline(always)]
    fn triangles_of(&self, ids: &[u32]) -> Option<&Triangles> {
        self.triangles().filter(|_| ids.first().is_none_or(|&id| !self.is_listed(id)))
    }
    /// The number of words that [`WideSource::write_leaf`] takes, of primitives in any order.
    fn leaf_words(&self, ids: &[u32], slice: TimeSlice) -> usize {
        match self.triangles_of(ids) {
            Some(triangles) => triangles.leaf_words(ids, slice),
            None => shapes_words(self, ids, slice),
        }
    }
    /// Writes a leaf block for queries in a time slice; `None` if the arena is full.
    #[inline]
    fn write_leaf(&self, arena: &mut Arena, ids: &[u32], slice: TimeSlice) -> Option<ChildRef> {
        match self.triangles_of(ids) {
            Some(triangles) => triangles.write_leaf(arena, ids, slice),
            None => write_shapes(self, arena, ids, slice),
        }
    }
    /// Rewrites the coordinates of a leaf block that begins at `words[0]`, and returns the bounds of its primitives; `None` if no
    /// coordinate changed. All primitives of a list of ids count as changed.
    fn rewrite_leaf(&self, words: &mut [u32], of: MovedLeaf<'_>) -> Option<LinearBox3> {
        if let Some(triangles) = self.triangles_of(of.ids) {
            return triangles.rewrite_leaf(words, of);
        }
        rewrite_shapes(self, words, of.ids);
        Some(bounds_of(self, of.ids, of.over))
    }
    /// Prefetches what [`WideSource::rewrite_leaf`] will read and write soon. A hint.
    fn prefetch_leaf(&self, words: &[u32], leaf: ChildRef, ids: &[u32]) {
        if let Some(triangles) = self.triangles_of(ids) {
            triangles.prefetch_leaf(words, leaf, ids);
        }
    }
    /// The bounds of the primitives of a leaf block that begins at `words[0]` and has been rewritten.
    fn leaf_bounds(&self, words: &[u32], of: MovedLeaf<'_>) -> LinearBox3 {
        match self.triangles_of(of.ids) {
            Some(triangles) => triangles.row_bounds(words, of),
            None => bounds_of(self, of.ids, of.over),
        }
    }
}

/// A leaf block whose primitives may have moved.
#[derive(Clone, Copy)]
pub(crate) struct MovedLeaf<'a> {
    pub leaf: ChildRef,
    /// The primitives in the block.
    pub ids: &'a [u32],
    /// The interval of their bounds.
    pub over: TimeInterval,
    pub level: SimdLevel,
}

/// The bounds of some primitives, one by one.
pub(in crate::layout) fn bounds_of<S: PrimitiveSet + ?Sized>(set: &S, ids: &[u32], over: TimeInterval) -> LinearBox3 {
    ids.iter().fold(LinearBox3::EMPTY, |all, &id| all.union(set.bounds(id, over)))
}

impl WideSource for Scene {
    fn triangles(&self) -> Option<&Triangles> {
        Some(&self.triangles)
    }

    #[inline(always)]
    fn is_listed(&self, id: u32) -> bool {
        self.shape(id).is_some()
    }

    fn release_build_data(&mut self) {
        self.triangles.drop_vertices();
    }
}
