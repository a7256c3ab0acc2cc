//! The surface at a point that a ray hit, and rays that leave it.
//!
//! A ray that begins at the computed point of a hit begins on either side of the surface, by rounding, and may hit it again. So its
//! origin is moved off the surface, to the side that the ray leaves to, by no more than the rounding of the intersection asks for.
//! The point is not `origin + t * dir`, as `t` is an f32: it is the point of the triangle with the weights of the hit, which lies
//! in the triangle's plane up to the rounding of f64, however far away the first ray began.

use super::hit::Hit;
use crate::geometry::Ray;
use crate::primitive::{Intersection, Primitive};
use glam::{DVec3, Vec3};

/// The point of a surface that a ray hit, its normal, and rays that leave from there: what shading needs of a hit, found by one
/// look at the primitive ([`RayTree::interaction`](crate::RayTree::interaction),
/// [`InstanceTree::interaction`](crate::InstanceTree::interaction)).
///
/// ```
/// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::{DVec3, Vec3}};
/// let floor = vec![Vec3::new(-9.0, -9.0, 0.0), Vec3::new(9.0, -9.0, 0.0), Vec3::new(0.0, 9.0, 0.0)];
/// let tree = RayTree::build(&[TriangleMesh::fixed(vec![[0, 1, 2]], floor)], &BuildParams::default())?;
/// let ray = Ray::new(Vec3::new(0.5, 0.0, 7.0), Vec3::new(0.0, 0.0, -1.0)).at_time(0.25);
/// let hit = tree.closest_hit(&ray).unwrap();
/// let surface = tree.interaction(&ray, &hit);
/// assert!(surface.point().distance(DVec3::X * 0.5) < 1e-6);
/// assert_eq!(surface.normal(), Vec3::Z);
/// // To a lamp, and a mirrored ray.
/// let shadow = surface.secondary_ray((DVec3::new(2.0, 3.0, 4.0) - surface.point()).as_vec3()).between(0.0, 1.0);
/// let mirrored = surface.secondary_ray(ray.dir.reflect(surface.normal()));
/// assert!(!tree.any_hit(&shadow) && !tree.any_hit(&mirrored));
/// assert_eq!((mirrored.dir, mirrored.time), (Vec3::Z, 0.25));
/// # Ok::<(), mbkd::BuildError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceInteraction {
    pub(crate) point: DVec3,
    /// The unit vector along which an origin is moved, to one side or the other.
    pub(crate) away: DVec3,
    /// Whether that is the normal.
    pub(crate) is_normal: bool,
    /// How far an origin has to be moved.
    pub(crate) lift: f64,
    pub(crate) time: f32,
}

/// How far an origin is moved off a triangle, relative to the sum `M` of its longest edge `L` and the largest coordinate of a
/// corner from the origin of tree space. (Of a sphere: relative to its radius.) Beside that it is moved by [`OF_COORDINATE`].
///
/// If it is `d` off the plane of a triangle, the numerator of the computed distance from it is `d` times twice the area, `|n|`,
/// with the sign that matters. The origin is rounded in tree space, by 2^-53 M; the corners as seen from it, and their shear, by
/// less. So sheared coordinates are off by 6 times 2^-53 M, each of the six products of two of them by 6 times 2^-52 M L, and their
/// sum, weighted with depths of at most L, by less than 2^-46 M L². So `d` has to be more than 2^-46 M L² / |n|, which this is
/// where triangles are up to a thousand times as long as wide; of others [`OF_SLIVER`] is. What else is in the scene, and how far
/// away, does not matter.
const OF_TRIANGLE: f64 = 1.0 / (1u64 << 36) as f64;
const OF_SLIVER: f64 = 1.0 / (1u64 << 46) as f64;

/// The same relative to a coordinate of the world, where a point is rounded.
pub(crate) const OF_COORDINATE: f64 = 1.0 / (1u64 << 48) as f64;

/// Where the surface is not known, the point has the precision of `t`: two ULP of it.
const OF_DISTANCE: f64 = 1.0 / (1u64 << 22) as f64;

impl SurfaceInteraction {
    /// The point of the triangle with the weights of the hit, or the point of the sphere. Of a custom primitive that is no sphere,
    /// and of a triangle whose corners are in a line, it is `origin + t * dir`.
    pub fn point(&self) -> DVec3 {
        self.point
    }

    /// The geometric unit normal, as [`RayTree::surface_normal`](crate::RayTree::surface_normal) gives it; zero where there is
    /// none.
    pub fn normal(&self) -> Vec3 {
        if self.is_normal { self.away.as_vec3() } else { Vec3::ZERO }
    }

    /// The ray from this point into a direction, at the same time, as [`RayTree::secondary_ray`](crate::RayTree::secondary_ray)
    /// makes it.
    pub fn secondary_ray(&self, dir: Vec3) -> Ray {
        let up = if self.away.dot(dir.as_dvec3()) < 0.0 { -self.away } else { self.away };
        Ray::new(self.point + up * self.lift, dir).at_time(self.time)
    }

    /// With a triangle, as seen from the origin of tree space; `None` if it is degenerate.
    pub(super) fn with_triangle(corners: [DVec3; 3], space: DVec3, ray: &Ray, hit: &Hit) -> Option<SurfaceInteraction> {
        let [a, b, c] = corners;
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(ac);
        let away = normal.try_normalize()?;
        let point = a + ab * f64::from(hit.u) + ac * f64::from(hit.v);
        let longest = ab.length_squared().max(ac.length_squared()).max((c - b).length_squared());
        let coordinate = |p: DVec3| (p - space).abs().max_element();
        let size = longest.sqrt() + coordinate(a).max(coordinate(b)).max(coordinate(c));
        let lift = size * OF_TRIANGLE.max(OF_SLIVER * longest / normal.length()) + rounding(point);
        Some(SurfaceInteraction { point, away, is_normal: true, lift, time: ray.time })
    }

    /// With a shape, or with what is not known.
    pub(crate) fn with_shape(shape: Option<&dyn Primitive>, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        let (normal, time) = (shape.and_then(|shape| normal_of_shape(shape, ray, hit)), ray.time);
        if let (Some(sphere), Some(away)) = (shape.and_then(Primitive::as_sphere), normal) {
            let (center, radius) = sphere.at(time);
            let point = center + away * radius;
            return SurfaceInteraction {
                point,
                away,
                is_normal: true,
                lift: OF_TRIANGLE * radius + rounding(point),
                time,
            };
        }
        let point = ray.point(hit.t);
        // Without a normal back to where the ray came from, or on if it goes on.
        let away = normal.unwrap_or_else(|| ray.dir.as_dvec3().normalize_or_zero());
        let lift = OF_DISTANCE * (point - ray.origin).length() + rounding(point);
        SurfaceInteraction { point, away, is_normal: normal.is_some(), lift, time }
    }
}

/// The unit normal of a shape that was hit, outwards; `None` if it is not known.
fn normal_of_shape(shape: &dyn Primitive, ray: &Ray, hit: &Hit) -> Option<DVec3> {
    let met = Intersection { t: hit.t, u: hit.u, v: hit.v };
    match shape.as_sphere() {
        Some(sphere) => sphere.surface_normal(ray, met),
        None => shape.surface_normal(ray, met)?.try_normalize(),
    }
}

/// How far the coordinates of a point are rounded.
fn rounding(point: DVec3) -> f64 {
    OF_COORDINATE * point.abs().max_element()
}
