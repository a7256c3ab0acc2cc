//! Bounds of a finished tree during the shutter, from the boxes of its root.

use super::wide_node::{ChildRef, Kind};
use super::wide_tree::WideTree;
use crate::geometry::{Box3, Frame, LinearBounds};

impl WideTree {
    /// Linear bounds of all primitives over the shutter, in world space, as wide as queries see them; `None` if the
    /// root has no boxes.
    ///
    /// Faces of a node move on lines, and so the box around all of a node's boxes lies inside the linear interpolation
    /// between its first and its last state. Under a time node that holds for each slice; the whole is the
    /// interpolation between the ends of the shutter, shifted to hold the boxes at the ends of all slices.
    pub(crate) fn linear_bounds(&self, frame: &Frame) -> Option<LinearBounds> {
        if self.root.kind() != Kind::Time {
            return self.node_bounds(self.root, [0.0, 1.0], frame);
        }
        let slices = self.slots(self.root);
        let count = slices.len() as f32;
        let over = |i: usize| [i as f32 / count, (i + 1) as f32 / count];
        let bounds = |i: usize| Some((over(i).map(f64::from), self.node_bounds(ChildRef(slices[i]), over(i), frame)?));
        let each: Vec<([f64; 2], LinearBounds)> = (0..slices.len()).map(bounds).collect::<Option<_>>()?;
        LinearBounds::of_slices(&each)
    }

    /// Linear bounds of each of the root's children, if the root is a node.
    pub(crate) fn bounds_of_children(&self, frame: &Frame) -> Option<Vec<LinearBounds>> {
        if !self.root.kind().has_boxes() {
            return None;
        }
        let at = |lane: usize, time: f32| frame.box_to_world(self.lane_box(self.root, lane, time));
        Some(self.lanes(self.root).map(|(lane, _)| LinearBounds { begin: at(lane, 0.0), end: at(lane, 1.0) }).collect())
    }

    fn node_bounds(&self, node: ChildRef, over: [f32; 2], frame: &Frame) -> Option<LinearBounds> {
        if !node.kind().has_boxes() {
            return None;
        }
        let at = |time: f32| {
            let boxes = self.lanes(node).map(|(lane, _)| self.lane_box(node, lane, time));
            frame.box_to_world(boxes.fold(Box3::EMPTY, Box3::union))
        };
        Some(LinearBounds { begin: at(over[0]), end: at(over[1]) })
    }
}
