//! A primitive of a caller's, for tests.

use mbkd::glam::DVec3;
use mbkd::{Intersection, LinearBounds, MovingSphere, Primitive, Ray, Shape, SurfacePoint, TimeInterval};

/// A sphere with a mask of its own, which counts instead of the sphere's.
#[derive(Clone, Debug)]
pub struct Blob {
    pub ball: MovingSphere,
    pub mask: u32,
    /// Whether it says that it is a sphere. If not, leaf blocks list it with its box.
    pub named: bool,
}

impl Blob {
    pub fn hidden(ball: MovingSphere) -> Blob {
        Blob { mask: ball.mask, ball, named: false }
    }

    #[allow(dead_code)] // not by all who include this
    pub fn named(ball: MovingSphere) -> Blob {
        Blob { named: true, ..Blob::hidden(ball) }
    }
}

impl Primitive for Blob {
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        self.ball.bounds(over)
    }

    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        self.ball.intersect(ray)
    }

    fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
        self.ball.closest_point(point, time)
    }

    fn active(&self) -> TimeInterval {
        self.ball.active
    }

    fn mask(&self) -> u32 {
        self.mask
    }

    fn as_sphere(&self) -> Option<&MovingSphere> {
        self.named.then_some(&self.ball)
    }
}

impl From<Blob> for Shape {
    fn from(blob: Blob) -> Shape {
        Shape::custom(blob)
    }
}
