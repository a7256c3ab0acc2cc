//! Object splits: each reference goes to one of two children, by binned SAH (Wald, "On fast Construction of SAH-based
//! Bounding Volume Hierarchies", RT 2007) on the boxes at mid-shutter.

use super::boxes::Box3;
use super::bvh::{Reference, split_cost};
use mbkd::glam::Vec3;

/// Bins per axis.
pub const BINS: usize = 32;

/// A split by the centres of references.
pub struct ObjectSplit {
    pub cost: f32,
    /// Half the area of the intersection of the children's boxes.
    pub overlap: f32,
    axis: usize,
    low: f32,
    scale: f32,
    /// The first bin of the right side.
    edge: usize,
}

impl ObjectSplit {
    /// The cheapest split of a node with this box, if the centres of its references differ.
    pub fn best(references: &[Reference], node: Box3) -> Option<ObjectSplit> {
        let middles = Box3::of(references.iter().map(|r| r.middle.middle()));
        let mut best: Option<ObjectSplit> = None;
        for axis in 0..3 {
            let (low, high) = (middles.min[axis], middles.max[axis]);
            let scale = BINS as f32 / (high - low);
            if !(low < high && scale.is_finite()) {
                continue;
            }
            let mut bins = [(Box3::EMPTY, 0usize); BINS];
            for r in references {
                let (bounds, count) = &mut bins[bin(r.middle.middle(), axis, low, scale)];
                (*bounds, *count) = (bounds.union(r.middle), *count + 1);
            }
            // Box and number of the references to the right of each edge.
            let mut right = [(Box3::EMPTY, 0usize); BINS + 1];
            for edge in (0..BINS).rev() {
                right[edge] = (right[edge + 1].0.union(bins[edge].0), right[edge + 1].1 + bins[edge].1);
            }
            let mut left = (Box3::EMPTY, 0usize);
            for edge in 1..BINS {
                left = (left.0.union(bins[edge - 1].0), left.1 + bins[edge - 1].1);
                if left.1 == 0 || right[edge].1 == 0 {
                    continue;
                }
                let cost = split_cost(node, left, right[edge]);
                if best.as_ref().is_none_or(|b| cost < b.cost) {
                    let overlap = left.0.intersection(right[edge].0);
                    let overlap = if overlap.is_empty() { 0.0 } else { overlap.half_area() };
                    best = Some(ObjectSplit { cost, overlap, axis, low, scale, edge });
                }
            }
        }
        best
    }

    /// The references of both children.
    pub fn apply(&self, references: Vec<Reference>) -> [Vec<Reference>; 2] {
        let goes_left = |r: &Reference| bin(r.middle.middle(), self.axis, self.low, self.scale) < self.edge;
        let (left, right) = references.into_iter().partition(goes_left);
        [left, right]
    }
}

fn bin(middle: Vec3, axis: usize, low: f32, scale: f32) -> usize {
    (((middle[axis] - low) * scale) as usize).min(BINS - 1)
}
