//! Rays that leave a surface of an instance where another ray hit it.

use super::distortion::{abs, row_sums};
use super::hit::InstanceHit;
use super::tree::{InstanceOf, InstanceTree};
use crate::geometry::Ray;
use crate::ray::{Departure, Hit, OF_COORDINATE};
use glam::{DAffine3, DMat3, DVec3, Vec3};

impl InstanceTree {
    /// The ray from the point where `ray` hit the surface into the direction `dir`, at the same time, as [`RayTree::secondary_ray`] makes
    /// it: with its origin moved off the surface, to the side that `dir` leaves to.
    ///
    /// The direction is rounded again in the space of an instance. So a ray that leaves within 2^-24 of the surface may hit it all the same.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::{BuildParams, Instance, InstanceTree, Pose, Ray, RayTree, TriangleMesh, WideParams};
    /// use mbkd::glam::{DQuat, DVec3, Vec3};
    /// let corners = vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
    /// let tile = RayTree::build(&[TriangleMesh::fixed(vec![[0, 1, 2]], corners)], &BuildParams::default())?;
    /// let pose = Pose { rotation: DQuat::from_rotation_x(0.3), translation: DVec3::Z, ..Pose::IDENTITY };
    /// let tree = InstanceTree::build(vec![Instance::new(Arc::new(tile), pose)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.1, 0.2, 5.0), Vec3::new(0.0, 0.01, -1.0));
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// let mirrored = ray.dir.reflect(tree.normal(&hit, ray.time));
    /// assert!(!tree.any_hit(&tree.secondary_ray(&ray, &hit, mirrored)));
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    ///
    /// [`RayTree::secondary_ray`]: crate::RayTree::secondary_ray
    pub fn secondary_ray(&self, ray: &Ray, hit: &InstanceHit, dir: Vec3) -> Ray {
        let from = match self.departure(ray, (&hit.path, &hit.hit), dir.as_dvec3()) {
            Some(from) => from.point + from.away * from.lift,
            None => ray.point(hit.hit.t),
        };
        Ray::new(from, dir).at_time(ray.time)
    }

    /// Where a ray into a direction leaves what another one hit; `None` for a hit that is not of this tree.
    fn departure(&self, ray: &Ray, (path, hit): (&[u32], &Hit), dir: DVec3) -> Option<Departure> {
        let (&first, rest) = path.split_first()?;
        // Nothing of a hidden instance is hit.
        let matrix = self.matrix(&[first], ray.time).filter(|matrix| matrix.matrix3 != DMat3::ZERO)?;
        let inward = matrix.inverse();
        let origin = inward.transform_point3(ray.origin);
        let local = Ray { origin, dir: (inward.matrix3 * ray.dir.as_dvec3()).as_vec3(), ..*ray };
        let dir = inward.matrix3 * dir;
        let inside = match self.placed(first)? {
            InstanceOf::Tree(tree) => rest.is_empty().then(|| tree.departure(&local, hit, dir))?,
            InstanceOf::Instances(tree) => tree.departure(&local, (rest, hit), dir)?,
        };
        Some(placed(inside, matrix, inward))
    }
}

/// A departure from a surface that is placed by a matrix.
///
/// A step of length s along the normal `N = M^-T n` of the placed surface is one of s |N| along the normal n of the surface itself.
fn placed(inside: Departure, matrix: DAffine3, inward: DAffine3) -> Departure {
    let point = matrix.transform_point3(inside.point);
    let normal = inward.matrix3.transpose() * inside.away;
    // The point is rounded here, and again when it is mapped back.
    let largest = point.abs() + matrix.translation.abs() + abs(matrix.matrix3) * inside.point.abs();
    let back = row_sums(inward.matrix3).max_element() * largest.max_element();
    let lift = (inside.lift + OF_COORDINATE * back) / normal.length();
    Departure { point, away: normal.normalize_or_zero(), lift: if lift.is_finite() { lift } else { 0.0 } }
}
