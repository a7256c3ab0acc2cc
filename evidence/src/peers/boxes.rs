//! Boxes in tree space, and boxes that move linearly during the shutter.

use super::ULP;
use mbkd::baseline::{PreparedRay, TriangleTests};
use mbkd::glam::{Vec3, Vec3A};

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    pub min: Vec3,
    pub max: Vec3,
}

impl Box3 {
    /// The empty box.
    pub const EMPTY: Box3 = Box3 { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
    /// The whole space.
    pub const ALL: Box3 = Box3 { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };

    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Box3 {
        points.into_iter().fold(Box3::EMPTY, |b, p| Box3 { min: b.min.min(p), max: b.max.max(p) })
    }

    pub fn union(self, other: Box3) -> Box3 {
        Box3 { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub fn intersection(self, other: Box3) -> Box3 {
        Box3 { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    pub fn is_empty(self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    pub fn pad(self, by: f32) -> Box3 {
        Box3 { min: self.min - by, max: self.max + by }
    }

    pub fn middle(self) -> Vec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Half the surface area; 0 for an empty box.
    pub fn half_area(self) -> f32 {
        let d = (self.max - self.min).max(Vec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// The largest magnitude of a coordinate.
    pub fn magnitude(self) -> f32 {
        (-self.min).max(self.max).max_element()
    }

    /// The part on one side of a plane.
    pub fn side(self, axis: usize, at: f32, above: bool) -> Box3 {
        let mut part = self;
        if above {
            part.min[axis] = part.min[axis].max(at)
        } else {
            part.max[axis] = part.max[axis].min(at)
        }
        part
    }
}

/// A box at shutter open and one at close, linear in between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingBox {
    pub open: Box3,
    pub close: Box3,
}

impl MovingBox {
    pub const EMPTY: MovingBox = MovingBox { open: Box3::EMPTY, close: Box3::EMPTY };

    pub fn union(self, other: MovingBox) -> MovingBox {
        MovingBox { open: self.open.union(other.open), close: self.close.union(other.close) }
    }

    /// The box swept between open and close.
    pub fn swept(self) -> Box3 {
        self.open.union(self.close)
    }

    /// The box padded so that [`MovingBox::entry`] finds it wherever the kernel hits its contents.
    ///
    /// The padding of [`TriangleTests::padding`] is for exact faces. Those of [`MovingBox::entry`] are `a + (b - a) t`
    /// with three roundings. With `m` the largest coordinate at either end their error is at most `2u m` (the
    /// difference, `u` of `2m`), `2u m` (the product) and `u m` (the sum): less than `8u m`, which also covers the
    /// rounding of this padding.
    pub fn padded(self) -> MovingBox {
        let magnitude = self.swept().magnitude();
        let by = TriangleTests::padding(magnitude) + 8.0 * ULP * magnitude;
        MovingBox { open: self.open.pad(by), close: self.close.pad(by) }
    }

    /// Where a ray enters the box as it is at the ray's time, if that is no farther away than `reach`.
    #[inline(always)]
    pub fn entry(&self, ray: &SlabRay, reach: f32) -> Option<f32> {
        let at = |open: Vec3, close: Vec3| Vec3A::from(open) + (Vec3A::from(close) - Vec3A::from(open)) * ray.time;
        let a = (at(self.open.min, self.close.min) - ray.origin) * ray.inverse;
        let b = (at(self.open.max, self.close.max) - ray.origin) * ray.inverse;
        let enter = (a.min(b) - ray.pad).max_element().max(ray.begin);
        let leave = (a.max(b) + ray.pad).min_element().min(reach);
        (enter <= leave).then_some(enter)
    }
}

/// A ray prepared for slab tests.
#[derive(Debug)]
pub struct SlabRay {
    pub origin: Vec3A,
    pub inverse: Vec3A,
    /// The ray's slack in units of distance.
    pub pad: Vec3A,
    pub begin: f32,
    pub time: f32,
}

impl SlabRay {
    #[inline(always)]
    pub fn new(ray: &PreparedRay) -> SlabRay {
        let inverse = ray.inverse();
        let pad = inverse.abs() * ray.slack();
        SlabRay { origin: ray.origin(), inverse, pad, begin: ray.range().0, time: ray.time() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mbkd::{Ray, TriangleMesh};
    use mbkd_scenes::Random;

    /// Counts rays past an edge of a triangle's box, at an edge of the triangle, that hit the triangle and miss the
    /// box. The triangles are static, since bounds of moving ones have some padding of their own.
    fn hits_lost(padded: bool) -> usize {
        const TRIANGLES: u32 = 500;
        let mut random = Random(77);
        let mut corners = Vec::new();
        for _ in 0..TRIANGLES {
            let mut vec = || random.dvec().as_vec3();
            let (a, b, c) = (vec().abs(), vec(), vec().abs());
            corners.extend([a, b.with_x(a.x).with_y(a.y), Vec3::new(a.x - c.x, a.y + c.y, c.z)]);
        }
        let indices = (0..TRIANGLES).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let tests = TriangleTests::new(&[TriangleMesh::fixed(indices, corners.clone())]).unwrap();
        let (mut hits, mut lost) = (0, 0);
        for index in 0..TRIANGLES {
            let bounds = Box3::of(tests.corners(index, 0.0));
            let tight = MovingBox { open: bounds, close: bounds };
            let bounds = if padded { tight.padded() } else { tight };
            let [a, b] = [0, 1].map(|corner| corners[3 * index as usize + corner]);
            for _ in 0..400 {
                let target = a.lerp(b, random.unit_f64() as f32);
                // From nearby, since the slack of a ray is that of its origin.
                let origin = random.dvec().as_vec3() * 1e-3;
                let ray = Ray::new(origin, target - origin).at_time(random.unit_f64() as f32);
                let Some(prepared) = tests.prepare(&ray) else { continue };
                if tests.hit(&prepared, index, f32::INFINITY).is_some() {
                    hits += 1;
                    lost += usize::from(bounds.entry(&SlabRay::new(&prepared), f32::MAX).is_none());
                }
            }
        }
        assert!(hits > 1000, "{hits}");
        lost
    }

    #[test]
    fn boxes_are_entered_by_rays_that_hit_and_would_not_be_without_padding() {
        assert_eq!(hits_lost(true), 0);
        assert!(hits_lost(false) > 10, "{}", hits_lost(false));
    }
}
