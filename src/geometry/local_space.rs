//! Tree space: world coordinates moved to the scene's centre and scaled by a power of two, so that
//! every vertex lies in `[-1, 1]` and f32 spends its bits on the scene instead of on where it stands.

use super::aabb::Aabb;
use crate::limits::MAX_COORDINATE;
use glam::{DVec3, Vec3};

/// The map from world to tree space: `(x - origin) * scale`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame {
    /// World position of the tree's zero.
    pub origin: DVec3,
    /// A power of two.
    pub scale: f64,
}

impl Frame {
    /// The frame of a scene with these swept bounds (world coordinates within [`MAX_COORDINATE`]).
    pub fn around(swept: Aabb) -> Frame {
        if swept.min.cmpgt(swept.max).any() {
            return Frame { origin: DVec3::ZERO, scale: 1.0 };
        }
        // Rounded to f32 where that moves it little, so that f32 input on a coarse grid stays on it.
        let centre = swept.min * 0.5 + swept.max * 0.5;
        let rounded = centre.as_vec3().as_dvec3();
        let size = (swept.max - swept.min).max_element();
        let origin = if (rounded - centre).abs().max_element() * 64.0 <= size { rounded } else { centre };
        let reach = (swept.max - origin).max(origin - swept.min).max_element();
        debug_assert!(reach <= 4.0 * MAX_COORDINATE);
        // The least power of two that is at least `reach`; scenes smaller than 2^-100 keep that scale.
        let exponent = if reach > 0.0 { reach.log2().ceil().clamp(-100.0, 110.0) as i32 } else { 0 };
        let mut scale = 2f64.powi(-exponent);
        if reach * scale > 1.0 {
            scale *= 0.5;
        }
        Frame { origin, scale }
    }

    /// A world point in tree space, rounded to nearest.
    #[inline(always)]
    pub fn point(self, p: DVec3) -> Vec3 {
        ((p - self.origin) * self.scale).as_vec3()
    }

    /// A tree-space point in world space.
    #[inline]
    pub fn to_world(self, p: Vec3) -> DVec3 {
        p.as_dvec3() / self.scale + self.origin
    }

    /// A world box in tree space, faces rounded outward.
    ///
    /// `p - origin` is rounded once in f64, the scaling is exact, and the conversion to f32 is corrected
    /// outward by a whole f32 step, 2^29 times the f64 rounding.
    pub fn outward(self, b: Aabb) -> (Vec3, Vec3) {
        let low = self.point(b.min);
        let high = self.point(b.max);
        (low.map(f32::next_down), high.map(f32::next_up))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_of_any_size_fill_the_unit_cube() {
        for size in [1e-28, 1e-9, 0.7, 1.0, 1.5, 4096.0, 3e29] {
            for at in [0.0, 0.3, -1e6 * size, 1e10 * size] {
                if at + size == at || size < f64::abs(at) * 1e-12 || f64::abs(at) > MAX_COORDINATE {
                    continue;
                }
                let b = Aabb { min: DVec3::splat(at), max: DVec3::splat(at + size) };
                let frame = Frame::around(b);
                let (low, high) = (frame.point(b.min), frame.point(b.max));
                assert!(low.abs().max_element() <= 1.0 && high.abs().max_element() <= 1.0, "{size} {at}");
                assert!(high.max_element() > 0.2, "{size} {at}: {high}");
                let (low, high) = frame.outward(b);
                let back = Aabb { min: frame.to_world(low), max: frame.to_world(high) };
                assert!(back.contains(b.min) && back.contains(b.max));
            }
        }
    }

    #[test]
    fn a_point_and_nothing_have_a_frame_too() {
        let p = DVec3::new(5.0, -3.0, 1e20);
        let frame = Frame::around(Aabb { min: p, max: p });
        assert!(frame.point(p).is_finite());
        assert_eq!(Frame::around(Aabb::EMPTY).scale, 1.0);
    }
}
