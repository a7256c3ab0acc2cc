//! The ray of a query.

use glam::{DVec3, Vec3};

/// A ray with a time: `origin + t * dir` for `t` in `[t_min, t_max]`, seeing the scene as it is at `time`.
///
/// The length of the direction is the unit of `t`; it may be any but zero. An invalid ray (a zero, infinite or NaN direction, a NaN
/// anywhere, `t_min > t_max`, a time outside `[0, 1]`, an origin more than 2^32 scene sizes away) hits nothing. (In an instance:
/// more than 2^32 sizes of what it places, or a direction shorter than 2^-100 or longer than 2^100 there.) The range applies to `t`
/// as it is returned: rounded to f32 once. If the direction is so small that `t` would be infinite, nothing is hit.
///
/// A ray may begin far away: its origin is moved near the scene in f64 first, and then it is traced like one that begins
/// there. Its hits lie where those of the exact ray do up to 2^-50 of its distance from the scene (and `t` itself is rounded
/// to f32, so [`Ray::point`] is as coarse as 2^-24 of that distance).
///
/// ```
/// use mbkd::{Ray, glam::Vec3};
/// let ray = Ray::new(Vec3::ZERO, Vec3::X).at_time(0.5).between(1e-3, 10.0);
/// assert_eq!((ray.time, ray.t_max), (0.5, 10.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The origin, in double precision.
    pub origin: DVec3,
    /// Its direction, of any length but zero.
    pub dir: Vec3,
    /// Hits nearer than this do not count.
    pub t_min: f32,
    /// Hits farther than this do not count; infinity is fine.
    pub t_max: f32,
    /// The time of the ray, in the shutter `[0, 1]`.
    pub time: f32,
}

impl Ray {
    /// The ray from `origin` (`Vec3`, `DVec3` or `[f64; 3]`) along `dir`, at shutter open, without end.
    pub fn new(origin: impl Into<DVec3>, dir: Vec3) -> Ray {
        Ray { origin: origin.into(), dir, t_min: 0.0, t_max: f32::INFINITY, time: 0.0 }
    }

    /// The ray at another time.
    pub fn at_time(self, time: f32) -> Ray {
        Ray { time, ..self }
    }

    /// The ray restricted to `t_min..=t_max`.
    pub fn between(self, t_min: f32, t_max: f32) -> Ray {
        Ray { t_min, t_max, ..self }
    }

    /// The point at `t`, in double precision.
    pub fn point(&self, t: f32) -> DVec3 {
        self.origin + self.dir.as_dvec3() * f64::from(t)
    }
}
