//! Moving spheres: their motion, their bounds and their intersection with rays.

use super::intersection::Intersection;
use super::mesh::merge_keys::widest_step;
use crate::geometry::{Aabb, KeyPhase, LinearBounds, Ray, TimeInterval, lerp};
use glam::{DVec3, Vec3};

/// A bound of the rounding of a sphere's own functions, relative to the size of the world's numbers: it is millions of times the
/// rounding of the interpolation and of the intersection, which are in f64 (2^-53 each, a dozen operations).
pub(crate) const SPHERE_ROUNDING: f64 = 1e-9;

/// A sphere whose center and radius move linearly between keys spaced evenly over the shutter.
///
/// A negative radius counts as its absolute value; a sphere without keys is a point at zero that
/// nothing hits.
///
/// Redundant keys cost only the time to read them: a tree keeps every second, third, … key if all others lie on the lines
/// between these ([`Primitive::merge_keys`](super::Primitive::merge_keys)): within 2^-50 relative to the coordinate, or within
/// 2^-22 if f32 has this coordinate at all keys, as it then probably was computed in f32. So a straight motion may be given with
/// any number of keys. (Of several keys two remain in any case, so that a tree of spheres at rest can be refitted.)
///
/// ```
/// use mbkd::glam::{DVec3, Vec3};
/// use mbkd::{BuildParams, MovingSphere, Ray, RayTree};
/// let ball = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::new(0.0, 0.0, 4.0), 2.0)]);
/// let tree = RayTree::of_scene(&[], vec![ball], &BuildParams::default())?;
/// let hit = tree.closest_hit(&Ray::new(DVec3::new(0.0, 0.0, 10.0), Vec3::NEG_Z).at_time(0.5)).unwrap();
/// assert_eq!(hit.t, 6.5); // the center is at 2 and the radius 1.5
/// # Ok::<(), mbkd::BuildError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct MovingSphere {
    /// Center and radius at each key.
    pub keys: Vec<(DVec3, f64)>,
    /// The active interval of the sphere.
    pub active: TimeInterval,
    /// Visibility: a masked query sees the sphere if its mask and this one share a bit.
    pub mask: u32,
}

/// The part of a line that is inside of a sphere.
struct Chord {
    /// Where its middle is along the ray, and half of its length, in lengths of the direction.
    middle: f64,
    half: f64,
    /// From its middle to the center.
    aside: DVec3,
}

impl Chord {
    /// The chord of the line of a ray; `None` if that misses the sphere.
    #[inline(always)]
    fn of((center, radius): (DVec3, f64), ray: &Ray) -> Option<Chord> {
        let d = ray.dir.as_dvec3();
        let per_square = d.length_squared().recip();
        let to_center = center - ray.origin;
        // The foot of the perpendicular from the center: testing its distance avoids cancellation
        // between large squares, however far away the ray begins.
        let middle = to_center.dot(d) * per_square;
        let aside = to_center - d * middle;
        let inside = radius * radius - aside.length_squared();
        if inside.is_nan() || inside <= 0.0 {
            return None;
        }
        Some(Chord { middle, half: (inside * per_square).sqrt(), aside })
    }
}

impl MovingSphere {
    /// A sphere from its center and radius at each key.
    pub fn new(keys: Vec<(DVec3, f64)>) -> MovingSphere {
        MovingSphere { keys, active: TimeInterval::FULL, mask: u32::MAX }
    }

    /// A static sphere.
    pub fn fixed(center: DVec3, radius: f64) -> MovingSphere {
        MovingSphere::new(vec![(center, radius)])
    }

    /// The sphere with an active interval.
    pub fn with_active(self, active: TimeInterval) -> MovingSphere {
        MovingSphere { active, ..self }
    }

    /// The sphere with a visibility mask. With a mask of 0, only queries without a mask see it.
    pub fn with_mask(self, mask: u32) -> MovingSphere {
        MovingSphere { mask, ..self }
    }

    /// Drops the keys on straight lines between others, but for two. The others are spaced evenly again.
    pub(super) fn drop_redundant_keys(&mut self) {
        let step = widest_step(self.keys.len(), true, |key| {
            let (center, radius) = self.keys[key];
            [center.x, center.y, center.z, radius.abs()]
        });
        if step > 1 {
            self.keys = self.keys.iter().step_by(step).copied().collect();
        }
    }

    /// Center and radius at a time in [0, 1].
    pub fn at(&self, time: f32) -> (DVec3, f64) {
        match self.keys.as_slice() {
            [] => (DVec3::ZERO, 0.0),
            &[only] => MovingSphere::between(only, only, 0.0),
            keys => {
                let KeyPhase { segment, w } = KeyPhase::new(time.into(), keys.len());
                MovingSphere::between(keys[segment], keys[segment + 1], w)
            }
        }
    }

    /// Center and radius between two keys.
    #[inline(always)]
    pub(crate) fn between((p, r): (DVec3, f64), (q, s): (DVec3, f64), w: f64) -> (DVec3, f64) {
        (lerp(p, q, w), lerp(r.abs(), s.abs(), w))
    }

    /// The nearer of the two intersections with a sphere that lies in the ray's range, as
    /// [`Primitive::intersect`](super::Primitive::intersect) returns it.
    #[inline(always)]
    pub(crate) fn intersection(sphere: (DVec3, f64), ray: &Ray) -> Option<Intersection> {
        let Chord { middle, half, aside } = Chord::of(sphere, ray)?;
        let in_range = |t: f32| ray.t_min <= t && t <= ray.t_max;
        let (near, far) = ((middle - half) as f32, (middle + half) as f32);
        let (t, to_hit) = if in_range(near) { (near, -half) } else { (far, half) };
        if !in_range(t) {
            return None;
        }
        // From the chord, since `t` is rounded: far from the origin of the ray by more than the radius.
        let normal = (ray.dir.as_dvec3() * to_hit - aside) * sphere.1.recip();
        // Zero is added so that neither is -0: leaf blocks have zeros of centers with either sign.
        Some(Intersection { t, u: normal.x as f32 + 0.0, v: normal.y as f32 + 0.0 })
    }

    /// The outward unit normal where a ray hits a sphere at `t`, which is rounded; `None` where there is none.
    pub(crate) fn normal_of_hit(sphere: (DVec3, f64), ray: &Ray, t: f32) -> Option<DVec3> {
        let Chord { middle, half, aside } = Chord::of(sphere, ray)?;
        // The near one, if both are rounded to this: from far away, `t` may be rounded by more than the chord is long.
        let (near, far) = (middle - half, middle + half);
        let first = near as f32 == t || (f64::from(t) - near).abs() <= (f64::from(t) - far).abs();
        (ray.dir.as_dvec3() * if first { -half } else { half } - aside).try_normalize()
    }

    /// The outward unit normal at a point of the surface, at a time in [0, 1]; zero at the center. Where a ray hits,
    /// [`RayTree::surface_normal`](crate::RayTree::surface_normal) does not depend on the rounding of `t`.
    ///
    /// ```
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{BuildParams, MovingSphere, Primitive, Ray, RayTree};
    /// let ball = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::X, 1.0)]);
    /// let tree = RayTree::of_scene(&[], vec![ball], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.5, 0.0, 9.0), Vec3::NEG_Z).at_time(0.5);
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// let hit_ball = tree.shape(hit.primitive).and_then(|shape| shape.as_sphere()).unwrap();
    /// assert_eq!(hit_ball.normal(ray.point(hit.t), ray.time), Vec3::Z);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn normal(&self, point: DVec3, time: f32) -> Vec3 {
        (point - self.at(time).0).normalize_or_zero().as_vec3()
    }

    pub(super) fn bounds_at(&self, time: f32) -> Aabb {
        let (center, radius) = self.at(time);
        Aabb { min: center - radius, max: center + radius }
    }

    /// Chords of center ± radius, shifted to hold the keys between, with a padding relative to the size of the numbers.
    pub(super) fn padded_bounds(&self, over: TimeInterval, padding: f64) -> LinearBounds {
        let mut bounds = LinearBounds { begin: self.bounds_at(over.begin()), end: self.bounds_at(over.end()) };
        let segments = self.keys.len().max(1) - 1;
        let place = |time: f32| f64::from(time) * segments as f64;
        for key in (place(over.begin()) as usize).max(1)..(place(over.end()).ceil() as usize).min(segments) {
            let time = key as f64 / segments as f64;
            let w = (time - f64::from(over.begin())) / over.fine_duration();
            if 0.0 < w && w < 1.0 {
                let (center, radius) = self.keys[key];
                bounds.include(w, Aabb { min: center - radius.abs(), max: center + radius.abs() });
            }
        }
        let swept = bounds.swept();
        let by = padding * swept.min.abs().max(swept.max.abs()).max_element();
        LinearBounds { begin: bounds.begin.pad(by), end: bounds.end.pad(by) }
    }
}
