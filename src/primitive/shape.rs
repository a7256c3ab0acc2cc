//! Shapes of several types in one list.

use super::custom::Primitive;
use super::intersection::{Intersection, SurfacePoint};
use super::sphere::MovingSphere;
use crate::geometry::{LinearBounds, Ray, TimeInterval};
use core::fmt;
use glam::DVec3;

/// A sphere or a custom primitive of any type, for lists of several types ([`RayTree::of_scene`](crate::RayTree::of_scene)). A list
/// of one type needs none of this.
///
/// ```
/// use mbkd::{MovingSphere, Shape, glam::DVec3};
/// let ball: Shape = MovingSphere::fixed(DVec3::ZERO, 1.0).into();
/// let custom = Shape::custom(MovingSphere::fixed(DVec3::X, 1.0)); // or a type of yours
/// assert!(matches!((ball, custom), (Shape::Sphere(_), Shape::Custom(_))));
/// ```
pub enum Shape {
    /// A moving sphere.
    Sphere(MovingSphere),
    /// A custom primitive.
    Custom(Box<dyn Primitive>),
}

impl fmt::Debug for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Shape::Sphere(sphere) => f.debug_tuple("Sphere").field(sphere).finish(),
            Shape::Custom(_) => f.debug_tuple("Custom").finish_non_exhaustive(),
        }
    }
}

impl Shape {
    /// A custom primitive: any type that implements [`Primitive`].
    pub fn custom(primitive: impl Primitive + 'static) -> Shape {
        Shape::Custom(Box::new(primitive))
    }
}

impl From<MovingSphere> for Shape {
    fn from(sphere: MovingSphere) -> Shape {
        Shape::Sphere(sphere)
    }
}

impl Shape {
    fn as_primitive(&self) -> &dyn Primitive {
        match self {
            Shape::Sphere(sphere) => sphere,
            Shape::Custom(custom) => &**custom,
        }
    }
}

impl Primitive for Shape {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        self.as_primitive().bounds(over)
    }

    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        self.as_primitive().intersect(ray)
    }

    fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
        self.as_primitive().closest_point(point, time)
    }

    fn active(&self) -> TimeInterval {
        self.as_primitive().active()
    }

    fn mask(&self) -> u32 {
        self.as_primitive().mask()
    }

    fn as_sphere(&self) -> Option<&MovingSphere> {
        self.as_primitive().as_sphere()
    }

    fn surface_normal(&self, ray: &Ray, hit: Intersection) -> Option<DVec3> {
        self.as_primitive().surface_normal(ray, hit)
    }

    fn point_at(&self, ray: &Ray, hit: Intersection, time: f32) -> Option<DVec3> {
        self.as_primitive().point_at(ray, hit, time)
    }

    fn merge_keys(&mut self) {
        match self {
            Shape::Sphere(sphere) => sphere.merge_keys(),
            Shape::Custom(custom) => custom.merge_keys(),
        }
    }
}
