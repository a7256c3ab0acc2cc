//! Tree space: world coordinates scaled by a power of two so that the farthest vertex has coordinates of about 1,
//! and translated if that is exact.
//!
//! Coordinates given in f32 keep every bit, if they are at least 2^-125 of the largest. They are translated along an axis
//! only if all of them lie within a factor of two of each other: then the difference of any two is exact (Sterbenz,
//! "Floating-point computation", 1974). The same holds for f64 coordinates that are kept exactly; other f64 coordinates
//! are translated relative to the centre of their bounds and rounded there.

use super::aabb::Aabb;
use super::box3::Box3;
use crate::limits::MAX_COORDINATE;
use glam::{DVec3, Vec3};

/// The map from world to tree space: `(x - origin) * scale`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame {
    /// World position of the origin of tree space.
    pub origin: DVec3,
    /// A power of two.
    pub scale: f64,
    /// The largest coordinate of a vertex in tree space: 1, up to rounding.
    pub reach: f32,
    /// The bounds of all primitives at all times, in world space.
    pub bounds: Aabb,
}

impl Frame {
    /// Tree space is world space, up to a distance of 1 from zero.
    pub const WORLD: Frame =
        Frame { origin: DVec3::ZERO, scale: 1.0, reach: 1.0, bounds: Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE } };

    /// The frame of coordinates in f64 with these bounds (within [`MAX_COORDINATE`]).
    pub fn around(swept: Aabb) -> Frame {
        // Rounded to f32 if that moves it little, so that coordinates on a coarse grid stay on it.
        let centre = swept.min * 0.5 + swept.max * 0.5;
        let rounded = centre.as_vec3().as_dvec3();
        let size = (swept.max - swept.min).max_element();
        let origin = if (rounded - centre).abs().max_element() * 64.0 <= size { rounded } else { centre };
        Frame::scaled(swept, origin)
    }

    /// The frame of coordinates in f32 with these bounds. Maps all coordinates exactly that are zero or at least
    /// 2^-125 of the largest.
    pub fn exact(swept: Aabb) -> Frame {
        Frame::moved_exactly(swept, |middle| f64::from(middle as f32))
    }

    /// The frame of coordinates in f64 with these bounds that keep every bit.
    pub fn exact_in_f64(swept: Aabb) -> Frame {
        Frame::moved_exactly(swept, |middle| middle)
    }

    /// Translated to the centre, rounded to the precision of the coordinates, along the axes where that is exact.
    fn moved_exactly(swept: Aabb, rounded: impl Fn(f64) -> f64) -> Frame {
        let mut origin = DVec3::ZERO;
        for axis in 0..3 {
            let (low, high) = (swept.min[axis], swept.max[axis]);
            let nearest = low.max(-high);
            if nearest > 0.0 && low.abs().max(high.abs()) <= 2.0 * nearest {
                origin[axis] = rounded(low * 0.5 + high * 0.5);
            }
        }
        Frame::scaled(swept, origin)
    }

    /// The frame with this origin, of coordinates with these bounds: scaled by the power of two that makes the farthest coordinate
    /// at most 1, computed from its bits. [`Frame::WORLD`] if there are none.
    pub fn scaled(swept: Aabb, origin: DVec3) -> Frame {
        if swept.min.cmpgt(swept.max).any() {
            return Frame::WORLD;
        }
        let reach = (swept.max - origin).max(origin - swept.min).max_element();
        debug_assert!(reach <= 4.0 * MAX_COORDINATE);
        let (exponent, fraction) = (exponent(reach), reach.to_bits() << 12);
        let to_one = if reach > 0.0 { (exponent + i64::from(fraction != 0)).max(LEAST_EXPONENT) } else { 0 };
        let scale = f64::from_bits(((1023 - to_one) as u64) << 52);
        Frame { origin, scale, reach: ((reach * scale) as f32).next_up().max(1.0), bounds: swept }
    }

    /// Whether another frame maps points to the same coordinates.
    pub fn maps_as(&self, other: &Frame) -> bool {
        self.origin == other.origin && self.scale == other.scale
    }

    /// A world point in tree space, rounded to nearest.
    #[inline(always)]
    pub fn point(self, p: DVec3) -> Vec3 {
        self.fine_point(p).as_vec3()
    }

    /// The origin and the scale in f32, if [`Frame::point`] of any f32 coordinates within the bounds is the same
    /// computed in f32. That is so if the frame is [exact](Frame::exact): both differences and products are exact, or
    /// rounded once where the result is denormal.
    pub fn in_f32(self) -> Option<(Vec3, f32)> {
        let (origin, scale) = (self.origin.as_vec3(), self.scale as f32);
        let same = origin.as_dvec3() == self.origin && f64::from(scale) == self.scale && scale.is_normal();
        let moved_exactly = (0..3).all(|axis| {
            let (low, high) = (self.bounds.min[axis], self.bounds.max[axis]);
            self.origin[axis] == 0.0 || low.abs().max(high.abs()) <= 2.0 * low.max(-high)
        });
        (same && moved_exactly).then_some((origin, scale))
    }

    /// A world point in tree space, in f64.
    #[inline(always)]
    pub fn fine_point(self, p: DVec3) -> DVec3 {
        (p - self.origin) * self.scale
    }

    /// A tree-space point in world space.
    #[inline]
    pub fn to_world(self, p: Vec3) -> DVec3 {
        self.fine_to_world(p.as_dvec3())
    }

    /// The same for a point in f64.
    #[inline]
    pub fn fine_to_world(self, p: DVec3) -> DVec3 {
        p / self.scale + self.origin
    }

    /// A world box in tree space, faces rounded outward.
    ///
    /// `p - origin` is rounded once in f64, the scaling is exact, and the conversion to f32 is corrected
    /// outward by a whole f32 step, 2^29 times the f64 rounding.
    pub fn outward(self, b: Aabb) -> Box3 {
        Box3 { min: self.point(b.min).map(f32::next_down), max: self.point(b.max).map(f32::next_up) }
    }

    /// A box in tree space in the world.
    pub fn box_to_world(self, b: Box3) -> Aabb {
        Aabb { min: self.to_world(b.min), max: self.to_world(b.max) }
    }
}

/// Smaller scenes are scaled like those of this exponent, the least of f32.
const LEAST_EXPONENT: i64 = -149;

/// `e` of a positive normal number in `[2^e, 2^(e + 1))`.
fn exponent(x: f64) -> i64 {
    (x.to_bits() >> 52) as i64 - 1023
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn exact_frames_map_f32_alike_in_f32() {
        let (mut random, mut cases) = (Random(8), 0);
        for size in [1e-44f32, 1e-38, 1e-20, 0.3, 1.0, 1e5, 1e30] {
            for far in [0.0, 0.5, 3.0, 1000.0] {
                let point = |random: &mut Random| Vec3::new(far, 0.0, -far) * size + random.vec() * size;
                let mut points: Vec<Vec3> = (0..500).map(|_| point(&mut random)).collect();
                // Small ones beside large ones, where the middle is at zero.
                points.extend((0..500).map(|_| random.vec() * size * 1e-37 * Vec3::Y));
                points.iter_mut().skip(500).for_each(|p| *p += Vec3::new(far, 0.0, -far) * size);
                let frame = Frame::exact(points.iter().fold(Aabb::EMPTY, |all, p| Aabb {
                    min: all.min.min(p.as_dvec3()),
                    max: all.max.max(p.as_dvec3()),
                }));
                let Some((origin, scale)) = frame.in_f32() else { continue };
                for p in points {
                    let bits = |p: Vec3| p.to_array().map(f32::to_bits);
                    assert_eq!(bits((p - origin) * scale), bits(frame.point(p.as_dvec3())), "{p} in {frame:?}");
                }
                cases += 1;
            }
        }
        assert!(cases > 20, "{cases} of 28");
        // Rounded where neither bounds nor the origin are those of f32.
        let near = Aabb { min: DVec3::splat(0.9), max: DVec3::splat(1.7) };
        let other = Frame::around(Aabb { min: DVec3::splat(0.1), max: DVec3::splat(1.7) });
        assert!(Frame::exact_in_f64(near).in_f32().is_none() && other.in_f32().is_none());
    }

    #[test]
    fn scenes_of_any_size_fill_the_unit_cube() {
        for size in [1e-40, 1e-28, 1e-9, 0.7, 1.0, 1.5, 4096.0, 3e29] {
            for at in [0.0, 0.3, -1e6 * size, 1e10 * size] {
                if at + size == at || size < f64::abs(at) * 1e-12 || f64::abs(at) > MAX_COORDINATE {
                    continue;
                }
                let b = Aabb { min: DVec3::splat(at), max: DVec3::splat(at + size) };
                let frame = Frame::around(b);
                let (low, high) = (frame.point(b.min), frame.point(b.max));
                assert!(low.abs().max_element() <= 1.0 && high.abs().max_element() <= 1.0, "{size} {at}");
                assert!(high.max_element() > 0.2, "{size} {at}: {high}");
                let back = frame.box_to_world(frame.outward(b));
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
        let zero = Aabb { min: DVec3::ZERO, max: DVec3::ZERO };
        for frame in [Frame::around(zero), Frame::exact(zero)] {
            assert_eq!((frame.scale, frame.point(DVec3::ZERO)), (1.0, Vec3::ZERO));
        }
    }

    #[test]
    fn numbers_in_f32_keep_every_bit() {
        let mut random = Random(1);
        let mut next = || (random.bits() >> 32) as u32;
        for round in 0..20_000 {
            // Magnitudes from 2^-63 to 2^0, and what lies within a factor of two.
            let number = |bits: u32| match round % 2 {
                0 => f32::from_bits(bits & 0x9fff_ffff | 0x2000_0000),
                _ => f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000 ^ (round as u32 % 16) << 26),
            };
            let points: [Vec3; 4] = core::array::from_fn(|_| Vec3::from([0; 3].map(|_| number(next()))));
            let fine = |x: f32| x.is_finite() && f64::from(x).abs() <= MAX_COORDINATE;
            if !points.iter().all(|p| p.to_array().into_iter().all(fine)) {
                continue;
            }
            let bounds = Aabb::of_points(points.map(|p| p.as_dvec3()));
            let frame = Frame::exact(bounds);
            for p in points {
                let inside = frame.point(p.as_dvec3());
                assert_eq!(frame.to_world(inside), p.as_dvec3(), "{points:?} {frame:?}");
                assert!(inside.abs().max_element() <= frame.reach);
            }
        }
    }
}
