//! The boxes of a finished tree at one time, for drawing and inspection.

use super::wide_node::{ChildRef, Kind};
use super::wide_tree::WideTree;
use crate::geometry::{Aabb, Box3, Frame};
use crate::simd::LANES;
use glam::Vec3;

/// The box around a node or leaf block of a [`RayTree`](crate::RayTree) at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeBox {
    /// The number of nodes above it; at least 1, since the root has no box.
    pub level: u32,
    /// Whether it is around a leaf block.
    pub leaf: bool,
    /// The box, in world space.
    pub bounds: Aabb,
}

impl WideTree {
    /// Calls `visitor` with every box that a ray of that time might be tested against, and with the block in it;
    /// `level` is that of the children of the root.
    pub fn boxes(&self, time: f32, frame: Frame, level: u32, visitor: &mut impl FnMut(TreeBox, ChildRef)) {
        let mut stack = vec![(self.in_slice(self.root, time), level)];
        while let Some((at, level)) = stack.pop() {
            if at == ChildRef::NOTHING || at.kind().is_leaf() {
                continue;
            }
            for (lane, child) in self.lanes(at) {
                let bounds = frame.box_to_world(self.lane_box(at, lane, time));
                let child = self.in_slice(child, time);
                visitor(TreeBox { level, leaf: self.is_leaf_at(child, time), bounds }, child);
                stack.push((child, level + 1));
            }
        }
    }

    /// Whether there is nothing but a leaf block at a time.
    pub(super) fn is_leaf_at(&self, at: ChildRef, time: f32) -> bool {
        let at = self.in_slice(at, time);
        at != ChildRef::NOTHING && at.kind().is_leaf()
    }

    /// What time nodes lead to at a time.
    fn in_slice(&self, mut at: ChildRef, time: f32) -> ChildRef {
        while at != ChildRef::NOTHING && at.kind() == Kind::Time {
            at = self.child_at(at, time);
        }
        at
    }

    /// Both corners of a node's box at a time, in tree space.
    pub fn lane_box(&self, node: ChildRef, lane: usize, time: f32) -> Box3 {
        let words = &self.arena.floats()[node.at()..];
        let face = |row: usize| {
            let at = words[row * LANES + lane];
            if node.kind() == Kind::Node { at + words[(row + 6) * LANES + lane] * time } else { at }
        };
        Box3 { min: Vec3::new(face(0), face(2), face(4)), max: Vec3::new(face(1), face(3), face(5)) }
    }
}
