//! A primitive of a caller's, for tests.

use mbkd::glam::DVec3;
use mbkd::{Intersection, LinearBounds, MovingSphere, Primitive, Ray, SurfacePoint, TimeInterval};

/// A sphere that does not say that it is one, so that leaf blocks list it with its box.
#[derive(Clone, Debug)]
pub struct Blob(pub MovingSphere);

impl Primitive for Blob {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        self.0.bounds(over)
    }

    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        self.0.intersect(ray)
    }

    fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
        self.0.closest_point(point, time)
    }

    fn active(&self) -> TimeInterval {
        self.0.active()
    }

    fn mask(&self) -> u32 {
        self.0.mask
    }
}
