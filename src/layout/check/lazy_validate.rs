//! Checking a lazy tree: the coarse tree, and the subtrees built so far.

use super::validation_error::ValidationError;
use super::wide_validate::TIMES;
use crate::geometry::Frame;
use crate::layout::build::lazy_tree::LazyTree;
use crate::layout::leaf::source::WideSource;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::TimeInterval;
    use crate::layout::wide_node::{ChildRef, children_mut};
    use crate::params::LazyParams;
    use crate::primitive::{Scene, TriangleMesh, no_shapes};
    use crate::progress::Progress;
    use glam::Vec3;

    /// Subtrees are numbered, and so are primitives: whether a primitive with the number of a subtree exists is of no account.
    #[test]
    fn a_subtree_that_no_leaf_lists_is_missing() {
        let row = |from: i32, to: i32| {
            let corners = (from..to).flat_map(|i| [Vec3::ZERO, Vec3::Y, Vec3::Z].map(|p| p + Vec3::X * i as f32));
            let indices = (0..(to - from) as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
            TriangleMesh::fixed(indices.collect(), corners.collect())
        };
        // The first thousand exist at none of the times that are tried.
        let brief = TimeInterval::new(0.01, 0.02).unwrap();
        let meshes = [row(0, 1000).with_active(brief), row(1000, 3000)];
        let set = Scene::new(&meshes, no_shapes()).unwrap();
        let params = LazyParams { subtree: 100, ..LazyParams::default() };
        let mut tree = LazyTree::build(&set, &params, &Progress::new(None)).unwrap();
        assert!((20..1000).contains(&tree.len()));
        assert_eq!(tree.validate(&set), Ok(()));
        let mut above = tree.top.root;
        while let Some((_, child)) = tree.top.lanes(above).find(|(_, child)| !child.kind().is_leaf()) {
            above = child;
        }
        let (lane, leaf) = tree.top.lanes(above).next().unwrap();
        let lost = tree.below(leaf);
        children_mut(&mut tree.top.arena, above)[lane] = ChildRef::NOTHING.0;
        assert!(matches!(tree.validate(&set), Err(ValidationError::Missing { primitive, .. }) if primitive == lost));
    }
}
