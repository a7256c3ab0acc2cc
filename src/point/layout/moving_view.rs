//! A tree of moving points at a time: the view of its leaves, for boxes and planes alike.

use super::moving_leaf::MovingLeaves;
use super::view::{LeafView, Target};
use crate::geometry::KeyTime;
use crate::point::leaf_order::segment_slice::{SegmentSlice, phase};
use crate::simd::{Lanes, Simd};
use glam::Vec3;

/// A tree of moving points at a time; `TIMED` if not all references are active throughout.
pub(in crate::point) struct TreeAtTime<'a, T, const TIMED: bool> {
    pub(in crate::point) tree: &'a T,
    leaves: &'a MovingLeaves,
    pub(super) at: KeyTime,
    phase: f32,
    pub(in crate::point) time: f32,
}

impl<T, const TIMED: bool> Clone for TreeAtTime<'_, T, TIMED> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T, const TIMED: bool> Copy for TreeAtTime<'_, T, TIMED> {}

impl<'a, T, const TIMED: bool> TreeAtTime<'a, T, TIMED> {
    /// A view of a tree with these leaves, whose time slice contains the time.
    #[inline(always)]
    pub(in crate::point) fn new(tree: &'a T, leaves: &'a MovingLeaves, slice: &SegmentSlice, time: f32) -> Self {
        let at = KeyTime::new(time, slice.keys);
        TreeAtTime { tree, leaves, at, phase: phase(at, slice.segment), time }
    }
}

impl<T, const TIMED: bool> LeafView for TreeAtTime<'_, T, TIMED> {
    #[inline(always)]
    fn leaf_blocks(&self) -> usize {
        1
    }
    #[inline(always)]
    fn target<S: Simd>(&self, s: S, q: Vec3) -> Target<S> {
        let point = [s.splat(q.x), s.splat(q.y), s.splat(q.z)];
        Target { point, step: s.splat(self.at.s), phase: s.splat(self.phase), time: s.splat(self.time) }
    }
    #[inline(always)]
    fn point_distances<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> S::F {
        self.leaves.distances::<S, TIMED>(s, self.at, target, block)
    }
    #[inline(always)]
    fn prefetch_leaf(&self, block: usize) {
        self.leaves.prefetch(block);
    }
    #[inline(always)]
    fn leaf_bytes(&self) -> usize {
        size_of_val(&self.leaves.blocks[..])
    }
    #[inline(always)]
    fn ids(&self, block: usize) -> &Lanes<u32> {
        self.leaves.ids(block)
    }
}
