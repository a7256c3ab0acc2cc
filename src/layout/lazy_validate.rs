//! Checking a lazy tree: the coarse tree, and the subtrees built so far.

use super::lazy_tree::LazyTree;
use super::leaf_block::WideSource;
use super::validation_error::ValidationError;
use super::wide_validate::TIMES;
use crate::geometry::Frame;
use crate::primitive::PrimitiveSet;
use crate::simd::LANES;

impl LazyTree {
    /// Checks that each primitive is in one subtree, that the coarse tree leads to every subtree through boxes that
    /// hold its triangles at a number of times, and the subtrees built so far.
    pub fn validate<S: WideSource>(&self, set: &S) -> Result<(), ValidationError> {
        let subtrees: Vec<u32> = (0..self.len() as u32).collect();
        self.top.validate_where(set, &subtrees, |_, _| true)?;
        let mut all = Vec::new();
        for &subtree in &subtrees {
            let mut ids = self.primitives(subtree).to_vec();
            ids.sort_unstable();
            if let Some(tree) = self.built(subtree) {
                tree.validate_ids(set, &ids)?;
            }
            all.extend(ids);
        }
        all.sort_unstable();
        if !all.into_iter().eq(0..set.len() as u32) {
            return Err(ValidationError::References { node: 0 });
        }
        TIMES.into_iter().try_for_each(|time| self.validate_boxes(set, time))
    }

    /// Checks the boxes of all subtrees at a time.
    fn validate_boxes<S: WideSource>(&self, set: &S, time: f32) -> Result<(), ValidationError> {
        let Some(triangles) = set.triangles() else { return Ok(()) };
        let mut result = Ok(());
        self.top.boxes(time, Frame::WORLD, 1, &mut |b, child| {
            let ids = if b.leaf { self.primitives(self.below(child)) } else { &[] };
            for &id in ids.iter().filter(|&&id| (id as usize) < triangles.len()) {
                let corners = triangles.precise_corners(id, time);
                let corners = corners.unwrap_or_else(|| triangles.fine_corners(id, time));
                if !corners.into_iter().all(|corner| b.bounds.contains(corner)) {
                    result = Err(ValidationError::Bounds { primitive: id, time, node: child.at() / LANES });
                }
            }
        });
        result
    }
}
