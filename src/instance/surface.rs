//! The surface at a hit of an instance: corners, normals, points at other times, and rays that leave it.

use super::distortion::{abs, row_sums};
use super::hit::InstanceHit;
use super::tree::{InstanceOf, InstanceTree};
use crate::geometry::Ray;
use crate::ray::{Hit, OF_COORDINATE, SurfaceInteraction};
use glam::{DAffine3, DMat3, DVec3, Vec3};

impl InstanceTree {
    /// The corners of the triangle that was hit, at any time of the shutter, as the instance places it then. NaN for a
    /// hit on another shape, for indices that this tree does not have and for a time outside of [0, 1]. Outside the active
    /// interval of its mesh: see [`RayTree::triangle`](crate::RayTree::triangle).
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
    /// another shape or a degenerate triangle, for indices that this tree does not have and for a time outside of [0, 1].
    pub fn triangle_normal(&self, hit: &InstanceHit, time: f32) -> Vec3 {
        match (self.tree(&hit.path), self.matrix(&hit.path, time)) {
            (Some(tree), Some(matrix)) => placed_normal(tree.normal_of_triangle(&hit.hit, time), &matrix).as_vec3(),
            _ => Vec3::ZERO,
        }
    }

    /// The unit normal of the surface at the point that `ray` hit, at its time, as the instance places it then: as
    /// [`RayTree::surface_normal`](crate::RayTree::surface_normal), so also of spheres, which a scale may have made ellipsoids.
    /// Zero for indices that this tree does not have as well.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, MovingSphere, Ray, RayTree, WideParams};
    /// let ball = MovingSphere::fixed(DVec3::ZERO, 1.0);
    /// let ball = Arc::new(RayTree::of_scene(&[], vec![ball], &BuildParams::default())?);
    /// let flat = DAffine3::from_scale(DVec3::new(2.0, 2.0, 1.0));
    /// let tree = InstanceTree::build(vec![Instance::new(ball, flat)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(1.2, 0.0, 9.0), Vec3::NEG_Z);
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// // At (.6, .8) of the circle, which is (1.2, .8) of the ellipse.
    /// assert!((tree.surface_normal(&ray, &hit) - Vec3::new(0.3, 0.0, 0.8).normalize()).length() < 1e-6);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn surface_normal(&self, ray: &Ray, hit: &InstanceHit) -> Vec3 {
        self.interaction(ray, hit).normal()
    }

    /// The point of the surface that `ray` hit, its normal and rays that leave from there, as the instance places them then: as
    /// [`RayTree::interaction`](crate::RayTree::interaction). Where more than one of them is needed, this takes less time than a
    /// call for each.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mbkd::glam::{DAffine3, DVec3, Vec3};
    /// use mbkd::{BuildParams, Instance, InstanceTree, MovingSphere, Ray, RayTree, WideParams};
    /// let ball = MovingSphere::fixed(DVec3::ZERO, 1.0);
    /// let ball = Arc::new(RayTree::of_scene(&[], vec![ball], &BuildParams::default())?);
    /// let above = DAffine3::from_translation(DVec3::Z * 3.0);
    /// let tree = InstanceTree::build(vec![Instance::new(ball, above)], &WideParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z);
    /// let surface = tree.interaction(&ray, &tree.closest_hit(&ray).unwrap());
    /// assert_eq!((surface.point(), surface.normal()), (DVec3::Z * 4.0, Vec3::Z));
    /// assert!(!tree.any_hit(&surface.secondary_ray(Vec3::Z)) && tree.any_hit(&surface.secondary_ray(Vec3::NEG_Z)));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn interaction(&self, ray: &Ray, hit: &InstanceHit) -> SurfaceInteraction {
        self.interaction_in(ray, &hit.path, &hit.hit)
            .unwrap_or_else(|| SurfaceInteraction::with_shape(None, ray, &hit.hit))
    }

    /// Where the point of the surface that `ray` hit is at another time of the shutter, as the instance places it then: for motion
    /// vectors. As [`RayTree::point_at`](crate::RayTree::point_at).
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
        self.interaction(ray, hit).secondary_ray(dir)
    }

    /// What a ray hit at the end of a path; `None` for indices that this tree does not have.
    fn interaction_in(&self, ray: &Ray, path: &[u32], hit: &Hit) -> Option<SurfaceInteraction> {
        let (&first, rest) = path.split_first()?;
        let (local, matrix) = (self.local_ray(first, ray)?, self.matrix(&[first], ray.time)?);
        let inside = match self.placed(first)? {
            InstanceOf::Tree(tree) => rest.is_empty().then(|| tree.interaction(&local, hit))?,
            InstanceOf::Instances(tree) => tree.interaction_in(&local, rest, hit)?,
        };
        Some(placed(inside, &matrix))
    }
}

/// The unit normal of a placed surface, from its normal in the placed tree; on the same side.
fn placed_normal(normal: DVec3, matrix: &DAffine3) -> DVec3 {
    // By the inverse transpose, up to a factor: far from zero, placed corners have lost digits that the normal needs.
    let DMat3 { x_axis: x, y_axis: y, z_axis: z } = matrix.matrix3;
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    (cofactors * normal * matrix.matrix3.determinant().signum()).normalize_or_zero()
}

/// A surface as a matrix places it.
///
/// A step of length s along the normal `N = M^-T n` of the placed surface is one of s |N| along the normal n of the surface itself.
fn placed(inside: SurfaceInteraction, matrix: &DAffine3) -> SurfaceInteraction {
    let inward = matrix.matrix3.inverse();
    let point = matrix.transform_point3(inside.point);
    // The point is rounded here, and again when it is mapped back.
    let largest = point.abs() + matrix.translation.abs() + abs(matrix.matrix3) * inside.point.abs();
    let back = row_sums(inward).max_element() * largest.max_element();
    let lift = (inside.lift + OF_COORDINATE * back) / (inward.transpose() * inside.away).length();
    let lift = if lift.is_finite() { lift } else { 0.0 };
    SurfaceInteraction { point, away: placed_normal(inside.away, matrix), lift, ..inside }
}
