//! Spheres as primitives: the second kind of primitive, and an example for custom ones.

use super::custom::Primitive;
use super::intersection::{Intersection, SurfacePoint};
use super::sphere::{MovingSphere, SPHERE_ROUNDING};
use crate::geometry::{LinearBounds, Ray, TimeInterval};
use glam::DVec3;

impl Primitive for MovingSphere {
    /// Chords of center ± radius, shifted to hold the keys between.
    ///
    /// They are padded by 1e-9 of the size of the numbers (`SPHERE_ROUNDING`); the error that grows with the ray's distance is
    /// covered by the tree.
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        self.padded_bounds(over, SPHERE_ROUNDING)
    }

    /// The nearer of the two intersections that lies in the ray's range; `u` and `v` are the x and y
    /// of the unit normal. (Its z may have either sign: see [`MovingSphere::normal`].)
    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        MovingSphere::intersection(self.at(ray.time), ray)
    }

    /// The nearest point of the surface; `u` and `v` as in [`Primitive::intersect`]. From the center it is the one along
    /// the x axis. A sphere without keys has none.
    fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
        if self.keys.is_empty() {
            return None;
        }
        let (center, radius) = self.at(time);
        let normal = (point - center).try_normalize().unwrap_or(DVec3::X);
        Some(SurfacePoint { point: center + normal * radius, u: normal.x as f32, v: normal.y as f32 })
    }

    fn active(&self) -> TimeInterval {
        self.active
    }

    fn mask(&self) -> u32 {
        self.mask
    }

    fn as_sphere(&self) -> Option<&MovingSphere> {
        Some(self)
    }

    fn surface_normal(&self, ray: &Ray, hit: Intersection) -> Option<DVec3> {
        MovingSphere::normal_of_hit(self.at(ray.time), ray, hit.t)
    }

    /// The point keeps its direction from the centre.
    fn point_at(&self, ray: &Ray, hit: Intersection, time: f32) -> Option<DVec3> {
        let unit = MovingSphere::normal_of_hit(self.at(ray.time), ray, hit.t)?;
        let (center, radius) = self.at(time);
        Some(center + unit * radius)
    }

    fn merge_keys(&mut self) {
        self.drop_redundant_keys();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use glam::Vec3;

    /// Spheres between two keys, at times of the shutter, that reach out of the line between their boxes at its ends.
    fn outside_of_bounds(padding: f64) -> usize {
        let mut random = Random(7);
        let mut outside = 0;
        for _ in 0..5000 {
            let mut key = || {
                (DVec3::new(random.signed_f64(), random.signed_f64(), random.signed_f64()), random.signed_f64().abs())
            };
            let ball = MovingSphere::new(vec![key(), key()]);
            let bounds = ball.padded_bounds(TimeInterval::FULL, padding);
            let time = (random.signed_f64().abs() * 16.0).round() as f32 / 16.0;
            let at = |a: DVec3, b: DVec3| a + (b - a) * f64::from(time);
            let (min, max) = (at(bounds.begin.min, bounds.end.min), at(bounds.begin.max, bounds.end.max));
            let exact = ball.bounds_at(time);
            outside += usize::from(exact.min.cmplt(min).any() || exact.max.cmpgt(max).any());
        }
        outside
    }

    #[test]
    fn keys_are_met_exactly() {
        let mut random = Random(8);
        for keys in [2, 3, 9] {
            let ball = MovingSphere::new((0..keys).map(|_| (random.dvec(), random.dvec().x.abs())).collect());
            for key in 0..keys {
                assert_eq!(ball.at(key as f32 / (keys - 1) as f32), ball.keys[key], "key {key} of {keys}");
            }
        }
    }

    #[test]
    fn bounds_hold_spheres_between_keys_and_would_not_without_padding() {
        assert_eq!(outside_of_bounds(SPHERE_ROUNDING), 0);
        assert!(outside_of_bounds(0.0) > 500, "a padding that nothing needs");
    }

    /// Keys of spheres that reach out of their bounds over a part of the shutter that begins before them and ends after them.
    fn keys_outside(bounds: impl Fn(&MovingSphere, TimeInterval) -> LinearBounds) -> usize {
        let (mut random, mut outside) = (Random(8), 0);
        for _ in 0..5000 {
            let mut key = || {
                (DVec3::new(random.signed_f64(), random.signed_f64(), random.signed_f64()), random.signed_f64().abs())
            };
            let ball = MovingSphere::new(vec![key(), key(), key()]);
            let over = TimeInterval::half_open(0.49 * random.unit(), 0.51 + 0.49 * random.unit()).unwrap();
            let bounds = bounds(&ball, over);
            let (begin, end) = (f64::from(over.begin()), f64::from(over.end()));
            let held = bounds.at((0.5 - begin) / (end - begin));
            let exact = ball.bounds_at(0.5);
            outside += usize::from(exact.min.cmplt(held.min).any() || exact.max.cmpgt(held.max).any());
        }
        outside
    }

    #[test]
    fn bounds_over_a_part_of_the_shutter_hold_the_keys_inside() {
        assert_eq!(keys_outside(|ball, over| ball.bounds(over)), 0);
    }

    /// A sphere that goes through random places at `places` keys, sampled at `keys` keys.
    fn sampled(places: usize, keys: usize, random: &mut Random) -> MovingSphere {
        let path = MovingSphere::new((0..places).map(|_| (random.dvec(), random.dvec().x)).collect());
        let step = (keys - 1).checked_div(places - 1).unwrap_or(usize::MAX);
        let at = |key: usize| {
            let (before, after) = (path.keys[key / step], path.keys[(key / step + 1).min(places - 1)]);
            MovingSphere::between(before, after, (key % step) as f64 / step as f64)
        };
        MovingSphere::new((0..keys).map(at).collect())
    }

    #[test]
    fn straight_motion_keeps_two_keys_and_piecewise_straight_motion_its_bends() {
        let mut random = Random(12);
        for (places, keys, kept) in [
            (1, 1, 1),
            (1, 2, 2),
            (1, 65, 2),
            (2, 2, 2),
            (2, 9, 2),
            (2, 65, 2),
            (3, 9, 3),
            (5, 65, 5),
            (4, 10, 4),
            (9, 9, 9),
        ] {
            for _ in 0..50 {
                let given = sampled(places, keys, &mut random);
                let mut merged = given.clone();
                merged.merge_keys();
                assert_eq!(merged.keys.len(), kept, "{places} places at {keys} keys");
                for time in (0..=64).map(|i| i as f32 / 64.0) {
                    let ((center, radius), (expected, expected_radius)) = (merged.at(time), given.at(time));
                    let off = (center - expected).abs().max_element().max((radius - expected_radius).abs());
                    assert!(off <= 12.0 * f64::EPSILON, "off by {off}");
                }
            }
        }
        let mut none = MovingSphere::new(Vec::new());
        none.merge_keys();
        assert_eq!(none.keys, []);
    }

    #[test]
    fn a_key_beside_the_line_is_kept() {
        let mut random = Random(13);
        for (by, kept) in [(1e-16, 2), (1e-14, 65)] {
            // Relative to the larger end.
            let mut ball = sampled(2, 65, &mut random);
            let size = ball.keys[0].0.y.abs().max(ball.keys[64].0.y.abs());
            ball.keys[20].0.y += by * size;
            ball.merge_keys();
            assert_eq!(ball.keys.len(), kept);
        }
        // In f32.
        for (by, kept) in [(0.0, 2), (1e-5, 65)] {
            let mut ball = sampled(2, 65, &mut random);
            for (center, radius) in &mut ball.keys {
                (*center, *radius) = (center.as_vec3().as_dvec3(), 0.05);
            }
            ball.keys[20].0.y = f64::from((ball.keys[20].0.y + by) as f32);
            ball.merge_keys();
            assert_eq!(ball.keys.len(), kept);
        }
        let mut growing = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::ZERO, 2.0), (DVec3::ZERO, 1.0)]);
        growing.merge_keys();
        assert_eq!(growing.keys.len(), 3);
    }

    #[test]
    fn near_far_grazing_inside_and_degenerate() {
        let ball = MovingSphere::fixed(DVec3::new(0.0, 0.0, 5.0), 1.0);
        let t = |ray: Ray| ball.intersect(&ray).map(|hit| hit.t);
        let ray = Ray::new(Vec3::ZERO, Vec3::Z);
        assert_eq!(t(ray), Some(4.0));
        assert_eq!(t(ray.between(4.5, 10.0)), Some(6.0));
        assert_eq!(t(ray.between(6.5, 10.0)), None);
        assert_eq!(t(Ray::new(Vec3::new(0.0, 0.0, 5.0), Vec3::X * 0.5)), Some(2.0));
        assert_eq!(t(Ray::new(Vec3::new(2.0, 0.0, 0.0), Vec3::Z)), None);
        assert_eq!(t(Ray { dir: Vec3::ZERO, ..ray }), None);
        assert_eq!(MovingSphere::new(vec![]).intersect(&ray), None);
        assert_eq!(MovingSphere::fixed(DVec3::ZERO, 0.0).intersect(&ray), None);
        let inverted = MovingSphere::fixed(DVec3::new(0.0, 0.0, 5.0), -1.0);
        assert_eq!(inverted.intersect(&ray), ball.intersect(&ray));
    }
}
