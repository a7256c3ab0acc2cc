//! What single primitives answer: where a ray meets them, and their closest points.

use glam::DVec3;

/// The intersection of a ray with a primitive, returned by [`Primitive::intersect`](super::Primitive::intersect).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intersection {
    /// Distance in units of the ray's direction: the point is `origin + t * dir`.
    pub t: f32,
    /// First surface parameter, passed on to [`Hit::u`](crate::Hit::u).
    pub u: f32,
    /// Second surface parameter, passed on to [`Hit::v`](crate::Hit::v).
    pub v: f32,
}

/// A point on a primitive, returned by [`Primitive::closest_point`](super::Primitive::closest_point).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The position, in world coordinates.
    pub point: DVec3,
    /// First surface parameter, passed on to [`ClosestPoint::u`](crate::ClosestPoint::u).
    pub u: f32,
    /// Second surface parameter, passed on to [`ClosestPoint::v`](crate::ClosestPoint::v).
    pub v: f32,
}
