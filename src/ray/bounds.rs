//! Boxes around all that a tree holds.

use super::ray_tree::RayTree;
use crate::geometry::{Aabb, LinearBounds};
use crate::primitive::PrimitiveSet;

impl RayTree {
    /// A box around all primitives over the shutter, in most trees slightly enlarged for rounding; `None` if there are none. Motion
    /// of meshes outside of their active intervals may count as well; that of shapes does not. Takes constant time.
    ///
    /// ```
    /// use mbkd::{BuildParams, RayTree, TriangleMesh, glam::{DVec3, Vec3}};
    /// let open = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let close = open.iter().map(|p| *p + Vec3::Z).collect();
    /// let tree = RayTree::build(&[TriangleMesh::new(vec![[0, 1, 2]], vec![open, close])], &BuildParams::default())?;
    /// let bounds = tree.bounds().unwrap();
    /// assert!(bounds.contains(DVec3::ZERO) && bounds.contains(DVec3::ONE));
    /// assert!(bounds.max.abs_diff_eq(DVec3::ONE, 1e-5));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn bounds(&self) -> Option<Aabb> {
        self.linear_bounds().map(LinearBounds::swept)
    }

    /// A box at the beginning of the shutter and one at its end, between which the box of each time is interpolated: around all
    /// primitives that exist then, slightly enlarged for rounding; `None` if there are none. Of k-d trees, and of trees of one
    /// leaf block, both are [`RayTree::bounds`], around the positions as given. Takes constant time.
    ///
    /// ```
    /// use mbkd::{BuildParams, RayTree, TriangleMesh, glam::{DVec3, Vec3}};
    /// // A hundred triangles that rise by 4.
    /// let corner = |i: u32, z: f32| Vec3::new((i / 3 + i % 3 % 2) as f32, (i % 3 / 2) as f32, z);
    /// let corners = |z: f32| (0..300).map(|i| corner(i, z)).collect::<Vec<_>>();
    /// let triangles = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    /// let mesh = TriangleMesh::new(triangles, vec![corners(0.0), corners(4.0)]);
    /// let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    /// let middle = tree.linear_bounds().unwrap().at(0.5);
    /// assert!(middle.contains(DVec3::new(50.0, 0.5, 2.0)) && !middle.contains(DVec3::new(50.0, 0.5, 1.9)));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn linear_bounds(&self) -> Option<LinearBounds> {
        (self.scene.len() > 0).then(|| self.own_bounds())
    }

    /// Linear bounds of all primitives over the shutter, in world space, as wide as the boxes of queries.
    fn own_bounds(&self) -> LinearBounds {
        let bounds = self.layout.top().and_then(|tree| tree.linear_bounds(self.frame()));
        bounds.unwrap_or(LinearBounds::fixed(self.frame().bounds))
    }

    /// Linear bounds of several subtrees, which together hold all primitives.
    pub(crate) fn linear_bounds_of_subtrees(&self) -> Vec<LinearBounds> {
        let subtrees = self.layout.top().and_then(|tree| tree.bounds_of_children(self.frame()));
        subtrees.unwrap_or_else(|| vec![self.own_bounds()])
    }
}
