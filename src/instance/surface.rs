//! The surface at a hit of an instance: corners, normals, points at other times, and rays that leave it.

use super::distortion::{abs, row_sums};
use super::hit::InstanceHit;
use super::tree::{InstanceOf, InstanceTree};
use crate::geometry::Ray;
use crate::ray::{Departure, Hit, OF_COORDINATE};
use glam::{DAffine3, DMat3, DVec3, Vec3};

impl InstanceTree {
    /// The corners of the triangle that was hit, at any time of the shutter, as the instance places it then. NaN for a
    /// hit on another shape and for a hit that is not of this tree. Outside the active interval of its mesh: see
    /// [`RayTree::triangle`](crate::RayTree::triangle).
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let mesh = TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
    /// let of = Arc::new(RayTree::build(&[mesh], &BuildParams::default())?);
    /// let place = |z: f64| Instance::new(of.clone(), DAffine3::from_translation(DVec3::Z * z));
    /// let tree = InstanceTree::build(vec![place(1.0), place(2.0)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::Z);
    /// let found = tree.closest_hit(&ray).unwrap();
    /// assert_eq!(tree.vertices(&found, 0.0)[1], DVec3::new(1.0, 0.0, 1.0));
    /// # Ok::<(), mbkd::InstanceError>(())
    /// ```
    pub fn vertices(&self, hit: &InstanceHit, time: f32) -> [DVec3; 3] {
        match (self.tree(&hit.path), self.matrix(&hit.path, time)) {
            (Some(tree), Some(matrix)) => tree.vertices(&hit.hit, time).map(|p| matrix.transform_point3(p)),
            _ => [DVec3::NAN; 3],
        }
    }

    /// The unit normal of the triangle that was hit, at any time of the shutter, on the side of the triangle on which
    /// it is in the placed tree (a mirroring transform changes the order of corners, but not the side). Zero for
    /// another shape or a degenerate triangle, and for a hit that is not of this tree.
    pub fn triangle_normal(&self, hit: &InstanceHit, time: f32) -> Vec3 {
        match (self.tree(&hit.path), self.matrix(&hit.path, time)) {
            (Some(tree), Some(matrix)) => placed_normal(tree.normal_of_triangle(&hit.hit, time), &matrix),
            _ => Vec3::ZERO,
        }
    }

    /// The unit normal of the surface at the point that `ray` hit, at its time, as the instance places it then: as
    /// [`RayTree::surface_normal`](crate::RayTree::surface_normal), so also of spheres, which a scale may have made ellipsoids.
    /// Zero for a hit that is not of this tree as well.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, MovingSphere, Ray, RayTree, WideParams};
    /// let ball = MovingSphere::fixed(DVec3::ZERO, 1.0);
    /// let ball = Arc::new(RayTree::of_scene(&[], vec![ball.into()], &BuildParams::default())?);
    /// let flat = DAffine3::from_scale(DVec3::new(2.0, 2.0, 1.0));
    /// let tree = InstanceTree::build(vec![Instance::new(ball, flat)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(1.2, 0.0, 9.0), Vec3::NEG_Z);
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// // At (.6, .8) of the circle, which is (1.2, .8) of the ellipse.
    /// assert!((tree.surface_normal(&ray, &hit) - Vec3::new(0.3, 0.0, 0.8).normalize()).length() < 1e-6);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn surface_normal(&self, ray: &Ray, hit: &InstanceHit) -> Vec3 {
        let normal = || {
            let (tree, matrix) = (self.tree(&hit.path)?, self.matrix(&hit.path, ray.time)?);
            let local = self.ray_inside(ray, &hit.path)?;
            Some(placed_normal(tree.unit_normal(&local, &hit.hit), &matrix))
        };
        normal().unwrap_or(Vec3::ZERO)
    }

    /// Where the point of the surface that `ray` hit is at another time of the shutter, as the instance places it then: for motion
    /// vectors. As [`RayTree::point_at`](crate::RayTree::point_at); `None` for a hit that is not of this tree and for a time
    /// outside of [0, 1], too.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, Ray, RayTree, TriangleMesh, WideParams};
    /// let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let tile = Arc::new(RayTree::build(&[TriangleMesh::fixed(vec![[0, 1, 2]], corners)], &BuildParams::default())?);
    /// let path = [DVec3::ZERO, DVec3::X * 3.0].map(DAffine3::from_translation).to_vec();
    /// let tree = InstanceTree::build(vec![Instance::new(tile, path)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(1.75, 0.25, 1.0), Vec3::NEG_Z).at_time(0.5);
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// assert_eq!(tree.point_at(&ray, &hit, 1.0), Some(DVec3::new(3.25, 0.25, 0.0)));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn point_at(&self, ray: &Ray, hit: &InstanceHit, time: f32) -> Option<DVec3> {
        let (tree, then) = (self.tree(&hit.path)?, self.matrix(&hit.path, time)?);
        let local = self.ray_inside(ray, &hit.path)?;
        Some(then.transform_point3(tree.point_at(&local, &hit.hit, time)?))
    }

    /// The ray that queries use for the tree at the end of a path: rounded at each level.
    fn ray_inside(&self, ray: &Ray, path: &[u32]) -> Option<Ray> {
        let (&first, rest) = path.split_first()?;
        let local = self.local_ray(first, ray)?;
        match self.placed(first)? {
            InstanceOf::Tree(_) => rest.is_empty().then_some(local),
            InstanceOf::Instances(tree) => tree.ray_inside(&local, rest),
        }
    }

    /// The ray from the point where `ray` hit the surface into the direction `dir`, at the same time, as [`RayTree::secondary_ray`]
    /// makes it: with its origin moved off the surface, to the side that `dir` leaves to.
    ///
    /// The direction is rounded again in the space of an instance. So a ray that leaves within 2^-24 of the surface may hit it all
    /// the same.
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
    /// let mirrored = ray.dir.reflect(tree.triangle_normal(&hit, ray.time));
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
        let (local, matrix) = (self.local_ray(first, ray)?, self.matrix(&[first], ray.time)?);
        let inward = matrix.inverse();
        let dir = inward.matrix3 * dir;
        let inside = match self.placed(first)? {
            InstanceOf::Tree(tree) => rest.is_empty().then(|| tree.departure(&local, hit, dir))?,
            InstanceOf::Instances(tree) => tree.departure(&local, (rest, hit), dir)?,
        };
        Some(placed(inside, matrix, inward))
    }
}

/// The unit normal of a placed surface, from its normal in the placed tree; on the same side.
fn placed_normal(normal: DVec3, matrix: &DAffine3) -> Vec3 {
    // By the inverse transpose, up to a factor: far from zero, placed corners have lost digits that the normal needs.
    let DMat3 { x_axis: x, y_axis: y, z_axis: z } = matrix.matrix3;
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    (cofactors * normal * matrix.matrix3.determinant().signum()).normalize_or_zero().as_vec3()
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
