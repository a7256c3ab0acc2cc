//! A test helper for implementations of [`Primitive`]: it tests the trait's contract on samples.

use super::custom::Primitive;
use super::intersection::SurfacePoint;
use super::sphere::MovingSphere;
use crate::geometry::{Aabb, Ray, TimeInterval};
use crate::limits::MAX_COORDINATE;
use crate::random::Random;
use core::fmt;
use glam::{DVec3, Vec3};

/// A violation of the contract of [`Primitive`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum PrimitiveError {
    /// Bounds over an interval are NaN, infinite, inverted or too large.
    BadBounds {
        /// The interval.
        over: TimeInterval,
    },
    /// A reported hit lies outside the bounds over an interval that contains the ray's time.
    OutsideBounds {
        /// The interval.
        over: TimeInterval,
        /// The ray.
        ray: Ray,
        /// The hit's distance.
        t: f32,
        /// How far outside the point is.
        by: f64,
    },
    /// A reported hit lies outside the range of the ray.
    OutsideRange {
        /// The ray.
        ray: Ray,
        /// The hit's distance.
        t: f32,
    },
    /// Two calls with the same ray gave different answers.
    Impure {
        /// The ray.
        ray: Ray,
    },
    /// Two calls for the nearest point to the same point gave different answers.
    ImpurePoint {
        /// The query point.
        point: DVec3,
        /// When.
        time: f32,
    },
    /// A nearest point lies outside the bounds over an interval that contains the time.
    PointOutsideBounds {
        /// The interval.
        over: TimeInterval,
        /// The query point.
        point: DVec3,
        /// When.
        time: f32,
        /// How far outside the answer is.
        by: f64,
    },
    /// The sphere of [`Primitive::as_sphere`] has another answer to a ray, or another closest point.
    OtherSphere {
        /// The ray, or one that begins at the point.
        ray: Ray,
    },
    /// A ray hits the primitive nearer to a point than the reported nearest point.
    NotNearest {
        /// The query point.
        point: DVec3,
        /// When.
        time: f32,
        /// Where the ray hits.
        nearer: DVec3,
    },
}

impl fmt::Display for PrimitiveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let between = |over: &TimeInterval| format!("[{}, {}]", over.begin(), over.end());
        match self {
            PrimitiveError::BadBounds { over } => {
                write!(
                    f,
                    "the bounds over {} are NaN, infinite, inverted or beyond {:e}",
                    between(over),
                    MAX_COORDINATE as f32
                )
            }
            PrimitiveError::OutsideBounds { over, ray, t, by } => write!(
                f,
                "the hit at t = {t} of {ray:?} lies {by:e} outside the bounds over {}: pad them if that is rounding, else the bounds or t are wrong (t counts lengths of the direction)",
                between(over)
            ),
            PrimitiveError::OutsideRange { ray, t } => {
                write!(f, "the hit at t = {t} is outside the range of {ray:?}: report the next one, or none")
            }
            PrimitiveError::Impure { ray } => {
                write!(f, "{ray:?} got two different answers: they may depend on the ray alone")
            }
            PrimitiveError::ImpurePoint { point, time } => {
                write!(f, "the nearest point to {point} at time {time} got two different answers")
            }
            PrimitiveError::PointOutsideBounds { over, point, time, by } => write!(
                f,
                "the nearest point to {point} at time {time} lies {by:e} outside the bounds over {}: pad the bounds",
                between(over)
            ),
            PrimitiveError::OtherSphere { ray } => {
                write!(
                    f,
                    "the sphere that the primitive claims to be has another answer to {ray:?}, or closest point to its origin"
                )
            }
            PrimitiveError::NotNearest { point, time, nearer } => {
                write!(f, "{nearer}, which a ray hits at time {time}, is nearer to {point} than the nearest point")
            }
        }
    }
}

impl std::error::Error for PrimitiveError {}

/// Tests the contract of [`Primitive`] with `samples` rays at the primitive, over intervals of all lengths, each of them once more
/// from just behind its hit, and with the rays' origins for [`Primitive::closest_point`], if that is implemented: its answers lie
/// within the bounds and are no farther than hits of rays. A primitive that is a sphere ([`Primitive::as_sphere`]) has that
/// sphere's answers.
///
/// Rays are drawn from a fixed sequence around the primitive's swept box, many of them aimed at its faces and edges,
/// where padding matters. Passing is no proof; a failure is one, and the error contains the ray. The rounding of `t` to f32
/// is handled by the tree and allowed for. Not tested are normals, points at other times, and whether each hit is found: a far
/// side that rays from inside do not meet is no violation.
///
/// ```
/// use mbkd::{MovingSphere, check_primitive, glam::DVec3};
/// let ball = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::X, 0.5)]);
/// check_primitive(&ball, 1000)?;
/// # Ok::<(), mbkd::PrimitiveError>(())
/// ```
///
/// # Errors
/// A [`PrimitiveError`] that says which rule of the contract is broken, by which ray or point.
pub fn check_primitive(primitive: &impl Primitive, samples: usize) -> Result<(), PrimitiveError> {
    let active = primitive.active();
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let swept = primitive.bounds(active).swept();
    check_bounds(swept, active)?;
    let size = (swept.max - swept.min).max_element().max(f64::MIN_POSITIVE);
    for _ in 0..samples {
        let (a, b) = (time_in(active, &mut random), time_in(active, &mut random));
        // Every fourth interval is only a few floats long.
        let b = if random.unit_f64() < 0.25 { a + f32::EPSILON } else { b };
        let Some(over) = TimeInterval::half_open(a.min(b), a.max(b)).and_then(|i| i.intersect(active)) else {
            continue;
        };
        let bounds = primitive.bounds(over);
        check_bounds(bounds.begin, over)?;
        check_bounds(bounds.end, over)?;
        let time = time_in(over, &mut random);
        if !over.contains(time) {
            continue;
        }
        let passed = f64::from(time) - f64::from(over.begin());
        let w = if passed > 0.0 { passed / over.fine_duration() } else { 0.0 };
        let now = bounds.at(w);
        let target = point_in(now, &mut random);
        let origin = swept.min * 0.5 + swept.max * 0.5 + random.dvec() * size * 2.0;
        let dir = ((target - origin) / size).as_vec3();
        if dir == Vec3::ZERO {
            continue;
        }
        let ray = Ray::new(origin, dir).at_time(time);
        let hit = check_hit(primitive, &ray, over, now, size)?;
        check_nearest(primitive, &ray, over, now, hit.map(|t| ray.point(t)), size)?;
        if let Some(t) = hit {
            // Just behind the first hit there may be another one, but not the first again.
            check_hit(primitive, &ray.between(t.next_up(), f32::INFINITY), over, now, size)?;
        }
    }
    Ok(())
}

/// Tests the hit of a ray, and returns its distance. The bounds over an interval are `now` at the ray's time, and `size` is about
/// the size of the primitive.
fn check_hit(
    primitive: &impl Primitive,
    ray: &Ray,
    over: TimeInterval,
    now: Aabb,
    size: f64,
) -> Result<Option<f32>, PrimitiveError> {
    let ray = *ray;
    let hit = primitive.intersect(&ray);
    if primitive.intersect(&ray) != hit {
        return Err(PrimitiveError::Impure { ray });
    }
    if let Some(sphere) = primitive.as_sphere()
        && (sphere.intersect(&ray) != hit || !is_closest_point_of(sphere, primitive, &ray))
    {
        return Err(PrimitiveError::OtherSphere { ray });
    }
    let Some(t) = hit.map(|hit| hit.t).filter(|t| !t.is_nan()) else { return Ok(None) };
    if t < ray.t_min || t > ray.t_max || t.is_infinite() {
        return Err(PrimitiveError::OutsideRange { ray, t });
    }
    // t is rounded to f32, and the fraction of the interval in f64.
    let allowed = 2.0 * f64::from(f32::EPSILON) * (f64::from(t) * ray.dir.as_dvec3().abs().max_element() + size * 1e-9);
    let p = ray.point(t);
    let by = (now.min - p).max(p - now.max).max_element();
    if by > allowed {
        return Err(PrimitiveError::OutsideBounds { over, ray, t, by });
    }
    Ok(Some(t))
}

/// Tests the reported nearest point to the origin of a ray that may hit the primitive at `hit`. The bounds over an
/// interval are `now` at the ray's time, and `size` is about the size of the primitive.
fn check_nearest(
    primitive: &impl Primitive,
    ray: &Ray,
    over: TimeInterval,
    now: Aabb,
    hit: Option<DVec3>,
    size: f64,
) -> Result<(), PrimitiveError> {
    let (point, time) = (ray.origin, ray.time);
    let found = primitive.closest_point(point, time);
    let again = primitive.closest_point(point, time);
    let nan = |p: Option<SurfacePoint>| p.is_some_and(|p| p.point.is_nan());
    if again != found && !(nan(again) && nan(found)) {
        return Err(PrimitiveError::ImpurePoint { point, time });
    }
    let Some(found) = found.filter(|found| !found.point.is_nan()) else { return Ok(()) };
    let by = (now.min - found.point).max(found.point - now.max).max_element();
    // The bounds at the time are interpolated in f64.
    if by > 1e-15 * now.min.abs().max(now.max.abs()).max_element() {
        return Err(PrimitiveError::PointOutsideBounds { over, point, time, by });
    }
    if let Some(nearer) = hit {
        let distance = (nearer - point).length();
        // The hit's distance is rounded to f32.
        if (found.point - point).length() > distance + f64::from(f32::EPSILON) * (distance + size) {
            return Err(PrimitiveError::NotNearest { point, time, nearer });
        }
    }
    Ok(())
}

/// Whether a primitive has the closest point of a sphere to the origin of a ray, or none.
fn is_closest_point_of(sphere: &MovingSphere, primitive: &impl Primitive, ray: &Ray) -> bool {
    let found = primitive.closest_point(ray.origin, ray.time);
    found.is_none_or(|found| Some(found) == sphere.closest_point(ray.origin, ray.time))
}

fn check_bounds(b: Aabb, over: TimeInterval) -> Result<(), PrimitiveError> {
    let large = b.min.abs().max(b.max.abs());
    let fine = b.min.cmple(b.max).all() && large.cmple(DVec3::splat(MAX_COORDINATE)).all();
    if fine { Ok(()) } else { Err(PrimitiveError::BadBounds { over }) }
}

/// A time of the interval, often its begin or end.
fn time_in(over: TimeInterval, random: &mut Random) -> f32 {
    match (random.unit_f64() * 8.0) as u32 {
        0 => over.begin(),
        1 => over.end(),
        _ => over.begin() + over.duration() * random.unit_f64() as f32,
    }
}

/// A point of the box, in half of the cases on a face or near it.
fn point_in(b: Aabb, random: &mut Random) -> DVec3 {
    let mut w = random.dvec() * 0.5 + 0.5;
    if random.unit_f64() < 0.5 {
        let axis = (random.unit_f64() * 3.0) as usize;
        w[axis.min(2)] = if random.unit_f64() < 0.5 { 1e-7 } else { 1.0 - 1e-7 };
    }
    b.min + (b.max - b.min) * w
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::LinearBounds;
    use crate::primitive::Intersection;

    /// A sphere with its bounds or answers spoiled.
    struct Spoiled(MovingSphere, fn(LinearBounds) -> LinearBounds, fn(&Ray, f32) -> f32);

    impl Primitive for Spoiled {
        fn bounds(&self, over: TimeInterval) -> LinearBounds {
            self.1(self.0.bounds(over))
        }
        fn intersect(&self, ray: &Ray) -> Option<Intersection> {
            self.0.intersect(ray).map(|hit| Intersection { t: self.2(ray, hit.t), ..hit })
        }
    }

    #[test]
    fn good_primitives_pass_and_each_way_to_be_wrong_is_found() {
        let ball = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::X * 3.0, 0.5), (DVec3::Y * 9.0, 2.0)]);
        assert_eq!(check_primitive(&ball, 20_000), Ok(()));
        let far = MovingSphere::new(vec![(DVec3::splat(1e9), 1.0), (DVec3::splat(1e9 + 3.0), 0.1)]);
        assert_eq!(check_primitive(&far, 20_000), Ok(()));
        let keep: fn(&Ray, f32) -> f32 = |_, t| t;
        let check = |bounds, t| check_primitive(&Spoiled(ball.clone(), bounds, t), 20_000);
        assert!(matches!(
            check(|b| LinearBounds { begin: b.begin.pad(-1e-3), end: b.end.pad(-1e-3) }, keep),
            Err(PrimitiveError::OutsideBounds { .. })
        ));
        // Right at both ends, but not in between: the middle key forgotten.
        let forgetful = MovingSphere::new(vec![ball.keys[0], ball.keys[2]]);
        struct Forgetful(MovingSphere, MovingSphere);
        impl Primitive for Forgetful {
            fn bounds(&self, over: TimeInterval) -> LinearBounds {
                self.0.bounds(over)
            }
            fn intersect(&self, ray: &Ray) -> Option<Intersection> {
                self.1.intersect(ray)
            }
        }
        assert!(check_primitive(&Forgetful(forgetful, ball.clone()), 20_000).is_err());
        assert!(matches!(
            check(|b| LinearBounds { begin: b.end, end: Aabb::EMPTY }, keep),
            Err(PrimitiveError::BadBounds { .. })
        ));
        assert!(matches!(check(|b| b, |_, t| -t), Err(PrimitiveError::OutsideRange { .. })));
        assert!(matches!(check(|b| b, |_, _| f32::INFINITY), Err(PrimitiveError::OutsideRange { .. })));
        // The front again, for a ray that begins behind it.
        struct Hasty(MovingSphere);
        impl Primitive for Hasty {
            fn bounds(&self, over: TimeInterval) -> LinearBounds {
                self.0.bounds(over)
            }
            fn intersect(&self, ray: &Ray) -> Option<Intersection> {
                self.0.intersect(&ray.between(0.0, ray.t_max))
            }
        }
        let behind =
            |error| matches!(error, PrimitiveError::OutsideRange { ray, t } if t < ray.t_min && ray.t_min > 0.0);
        assert!(check_primitive(&Hasty(ball), 20_000).is_err_and(behind));
    }

    #[test]
    fn primitives_that_are_other_spheres_than_they_claim_are_found() {
        /// A sphere, the sphere that it claims to be, and whether its inside counts as near.
        struct Claims(MovingSphere, MovingSphere, bool);
        impl Primitive for Claims {
            fn bounds(&self, over: TimeInterval) -> LinearBounds {
                self.0.bounds(over)
            }
            fn intersect(&self, ray: &Ray) -> Option<Intersection> {
                self.0.intersect(ray)
            }
            fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
                let found = self.0.closest_point(point, time)?;
                let (center, radius) = self.0.at(time);
                let solid = self.2 && (point - center).length() < radius;
                Some(if solid { SurfacePoint { point, ..found } } else { found })
            }
            fn as_sphere(&self) -> Option<&MovingSphere> {
                Some(&self.1)
            }
        }
        let ball = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::X * 3.0, 0.5)]);
        let larger = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::X * 3.0, 0.6)]);
        let check = |ball: &MovingSphere, claimed: &MovingSphere, solid| {
            check_primitive(&Claims(ball.clone(), claimed.clone(), solid), 5000)
        };
        assert_eq!(check(&ball, &ball, false), Ok(()));
        assert!(matches!(check(&ball, &larger, false), Err(PrimitiveError::OtherSphere { .. })));
        // More points are inside of one that does not move.
        let still = MovingSphere::fixed(DVec3::ZERO, 1.0);
        assert!(matches!(check(&still, &still, true), Err(PrimitiveError::OtherSphere { .. })));
    }

    #[test]
    fn each_way_to_be_wrong_about_the_nearest_point_is_found() {
        use core::sync::atomic::{AtomicU32, Ordering};
        /// A sphere with another nearest point.
        struct Faulty(MovingSphere, fn(DVec3) -> DVec3, AtomicU32);
        impl Primitive for Faulty {
            fn bounds(&self, over: TimeInterval) -> LinearBounds {
                self.0.bounds(over)
            }
            fn intersect(&self, ray: &Ray) -> Option<Intersection> {
                self.0.intersect(ray)
            }
            fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
                let found = self.0.closest_point(point, time)?;
                let calls = self.2.fetch_add(1, Ordering::Relaxed) as f32;
                Some(SurfacePoint { point: self.1(found.point), u: found.u * calls.min(1.0), ..found })
            }
        }
        let ball = MovingSphere::new(vec![(DVec3::ZERO, 1.0), (DVec3::X * 3.0, 0.5)]);
        let check = |f| check_primitive(&Faulty(ball.clone(), f, AtomicU32::new(1)), 5000);
        assert_eq!(check(|p| p), Ok(()));
        assert!(matches!(check(|p| p * 1.001), Err(PrimitiveError::PointOutsideBounds { .. })));
        // Inside a static ball, so within its bounds at every time.
        let fixed = Faulty(MovingSphere::fixed(DVec3::ZERO, 1.0), |p| p * 0.5, AtomicU32::new(1));
        assert!(matches!(check_primitive(&fixed, 5000), Err(PrimitiveError::NotNearest { .. })));
        assert_eq!(check(|_| DVec3::NAN), Ok(()));
        let impure = check_primitive(&Faulty(ball, |p| p, AtomicU32::new(0)), 5000);
        assert!(matches!(impure, Err(PrimitiveError::ImpurePoint { .. })));
    }
}
