//! The trait that a caller implements for a custom moving shape.

use super::intersection::{Intersection, SurfacePoint};
use super::sphere::MovingSphere;
use crate::geometry::{LinearBounds, Ray, TimeInterval};
use glam::DVec3;

/// A moving shape that a [`RayTree`](crate::RayTree) can hold.
///
/// The contract, which [`check_primitive`](crate::check_primitive) tests on samples:
/// - At every time of the interval, [`bounds`](Primitive::bounds) contain every point that
///   [`intersect`](Primitive::intersect) can report at that time, *including its own rounding*. So pad them by the error of
///   the intersection arithmetic.
/// - At every time of the interval, they contain every point that [`closest_point`](Primitive::closest_point) reports at
///   that time, exactly.
/// - Bounds are finite, not inverted, and within [`MAX_COORDINATE`](crate::MAX_COORDINATE), over every part of the shutter, down to
///   a single instant.
/// - [`intersect`](Primitive::intersect) reports the nearest intersection in the range of the ray, and none outside it.
/// - [`intersect`](Primitive::intersect) and [`closest_point`](Primitive::closest_point) are pure: the same arguments give
///   the same answer, for any number of calls and on any thread.
/// - The sphere of [`as_sphere`](Primitive::as_sphere), if there is one, has the same answers, and is there at each call.
/// - No function waits for tasks of rayon's. A lazy tree calls [`bounds`](Primitive::bounds) while other threads wait for the
///   subtree, and a thread that waits for its tasks may take up one of those that wait: then none of them goes on.
///
/// A primitive that breaks the contract does not affect others. If its bounds are invalid, the build fails with
/// [`BuildError::BadBounds`](crate::BuildError::BadBounds) (that of a lazy tree only if they are so over the active interval).
/// If its bounds do not contain all hits, or change from one call to the next, hits of this primitive are lost. A tree calls
/// [`active`](Primitive::active) and [`mask`](Primitive::mask) once, when it takes the primitive.
///
/// ```
/// use mbkd::glam::{DVec3, Vec3};
/// use mbkd::{Aabb, BuildParams, Intersection, LinearBounds, Primitive, Ray, RayTree, TimeInterval};
///
/// /// A horizontal unit square that rises from z = 0 to z = 1.
/// struct Lift;
/// impl Primitive for Lift {
///     fn bounds(&self, over: TimeInterval) -> LinearBounds {
///         let at = |t: f32| {
///             let z = f64::from(t);
///             Aabb { min: DVec3::new(0.0, 0.0, z), max: DVec3::new(1.0, 1.0, z) }.pad(1e-6)
///         };
///         LinearBounds { begin: at(over.begin()), end: at(over.end()) }
///     }
///     fn intersect(&self, ray: &Ray) -> Option<Intersection> {
///         let t = (f64::from(ray.time) - ray.origin.z) / f64::from(ray.dir.z);
///         let p = ray.origin + ray.dir.as_dvec3() * t;
///         let inside = p.x >= 0.0 && p.x <= 1.0 && p.y >= 0.0 && p.y <= 1.0;
///         let in_range = (ray.t_min..=ray.t_max).contains(&(t as f32));
///         (inside && in_range).then_some(Intersection { t: t as f32, u: p.x as f32, v: p.y as f32 })
///     }
/// }
/// let tree = RayTree::of_scene(&[], vec![Lift], &BuildParams::default())?;
/// let ray = Ray::new(DVec3::new(0.5, 0.5, 3.0), Vec3::NEG_Z).at_time(0.25);
/// assert_eq!(tree.closest_hit(&ray).unwrap().t, 2.75);
/// # Ok::<(), mbkd::BuildError>(())
/// ```
pub trait Primitive: Send + Sync {
    /// Linear bounds over a part of the shutter, in world coordinates. The primitive need not exist during the whole part.
    fn bounds(&self, over: TimeInterval) -> LinearBounds;

    /// The nearest intersection at `ray.time` with `t` in `[ray.t_min, ray.t_max]`; `None` if there is no intersection in that
    /// range.
    ///
    /// An answer outside that range breaks the contract: trees ignore it, and so lose an intersection in the range behind it.
    fn intersect(&self, ray: &Ray) -> Option<Intersection>;

    /// The point of the primitive at `time` that is nearest to `point`, for
    /// [`RayTree::closest_point`](crate::RayTree::closest_point).
    ///
    /// The default is `None` for all points; closest-point queries then ignore the primitive. A point with a NaN is
    /// ignored.
    fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
        let _ = (point, time);
        None
    }

    /// The active interval of the primitive. The default is the whole shutter.
    fn active(&self) -> TimeInterval {
        TimeInterval::FULL
    }

    /// The visibility mask: a query with a mask sees the primitive if the two share a bit. With a mask of 0, only queries without a
    /// mask see it. The default has all bits. A tree calls this once, when it takes the primitive.
    ///
    /// ```
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{BuildParams, Intersection, LinearBounds, MovingSphere, Primitive, Ray, RayTree, TimeInterval};
    ///
    /// /// A lamp, which camera rays (mask 0b01) do not see.
    /// struct Lamp(MovingSphere);
    /// impl Primitive for Lamp {
    ///     fn bounds(&self, over: TimeInterval) -> LinearBounds {
    ///         self.0.bounds(over)
    ///     }
    ///     fn intersect(&self, ray: &Ray) -> Option<Intersection> {
    ///         self.0.intersect(ray)
    ///     }
    ///     fn mask(&self) -> u32 {
    ///         0b10
    ///     }
    /// }
    /// let lamp = Lamp(MovingSphere::fixed(DVec3::ZERO, 1.0));
    /// let tree = RayTree::of_scene(&[], vec![lamp], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.0, 0.0, 5.0), Vec3::NEG_Z);
    /// assert!(tree.any_hit(&ray) && tree.any_hit_masked(&ray, 0b10) && !tree.any_hit_masked(&ray, 0b01));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    fn mask(&self) -> u32 {
        u32::MAX
    }

    /// The sphere that has the same intersections and, where the primitive has any, the same closest points; for instance of a
    /// sphere that carries further data of the caller's. Its active interval and its mask do not count, those of the primitive do.
    ///
    /// Rays are tested against up to sixteen spheres at a time, by the sphere's functions instead of the primitive's. The default
    /// is `None`: rays are tested against one primitive after the other.
    ///
    /// ```
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{BuildParams, Intersection, LinearBounds, MovingSphere, Primitive, Ray, RayTree, TimeInterval};
    ///
    /// /// A ball that only camera rays see.
    /// struct Ball(MovingSphere);
    /// impl Primitive for Ball {
    ///     fn bounds(&self, over: TimeInterval) -> LinearBounds {
    ///         self.0.bounds(over)
    ///     }
    ///     fn intersect(&self, ray: &Ray) -> Option<Intersection> {
    ///         self.0.intersect(ray)
    ///     }
    ///     fn mask(&self) -> u32 {
    ///         0b01
    ///     }
    ///     fn as_sphere(&self) -> Option<&MovingSphere> {
    ///         Some(&self.0)
    ///     }
    /// }
    /// let balls = (0..9).map(|i| Ball(MovingSphere::fixed(DVec3::X * f64::from(i) * 3.0, 1.0)));
    /// let tree = RayTree::of_scene(&[], balls.collect(), &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(6.0, 0.0, 5.0), Vec3::NEG_Z);
    /// assert_eq!(tree.closest_hit_masked(&ray, 0b01).map(|hit| (hit.primitive, hit.t)), Some((2, 4.0)));
    /// assert!(!tree.any_hit_masked(&ray, 0b10));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    fn as_sphere(&self) -> Option<&MovingSphere> {
        None
    }

    /// The outward normal, of any length, where a ray at `ray.time` met the primitive, for
    /// [`RayTree::surface_normal`](crate::RayTree::surface_normal) and [`RayTree::secondary_ray`](crate::RayTree::secondary_ray).
    /// `hit` is what [`intersect`](Primitive::intersect) returned.
    ///
    /// The default is `None`, no known normal; so is one that is zero or not finite. A primitive with a sphere of its own
    /// ([`Primitive::as_sphere`]) has that of the sphere.
    ///
    /// ```
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{Aabb, BuildParams, Intersection, LinearBounds, Primitive, Ray, RayTree, TimeInterval};
    ///
    /// /// The plane z = 0, as far as 1 from the origin along x and y.
    /// struct Tile;
    /// impl Primitive for Tile {
    ///     fn bounds(&self, _: TimeInterval) -> LinearBounds {
    ///         LinearBounds::fixed(Aabb { min: DVec3::new(-1.0, -1.0, 0.0), max: DVec3::new(1.0, 1.0, 0.0) }.pad(1e-6))
    ///     }
    ///     fn intersect(&self, ray: &Ray) -> Option<Intersection> {
    ///         let t = (-ray.origin.z / f64::from(ray.dir.z)) as f32;
    ///         let p = ray.point(t);
    ///         let hit = p.x.abs() <= 1.0 && p.y.abs() <= 1.0 && (ray.t_min..=ray.t_max).contains(&t);
    ///         hit.then_some(Intersection { t, u: p.x as f32, v: p.y as f32 })
    ///     }
    ///     fn surface_normal(&self, _: &Ray, _: Intersection) -> Option<DVec3> {
    ///         Some(DVec3::Z)
    ///     }
    /// }
    /// let tree = RayTree::of_scene(&[], vec![Tile], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(-0.3, 0.2, 0.9), Vec3::new(0.3, 0.1, -0.7));
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// assert_eq!(tree.surface_normal(&ray, &hit), Vec3::Z);
    /// assert!(!tree.any_hit(&tree.secondary_ray(&ray, &hit, Vec3::new(0.9, 0.0, 0.1))), "it leaves to the side of its direction");
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    fn surface_normal(&self, ray: &Ray, hit: Intersection) -> Option<DVec3> {
        let _ = (ray, hit);
        None
    }

    /// Where the point of the surface that a ray met at `ray.time` is at another time of the shutter, for motion vectors
    /// ([`RayTree::point_at`](crate::RayTree::point_at)). `hit` is what [`intersect`](Primitive::intersect) returned, whose `u` and
    /// `v` may say which point it is.
    ///
    /// The default is `None`, not known; so is a point that is not a number. A primitive with a sphere of its own
    /// ([`Primitive::as_sphere`]) has the points of the sphere.
    ///
    /// ```
    /// use mbkd::glam::{DVec3, Vec3};
    /// use mbkd::{Aabb, BuildParams, Intersection, LinearBounds, Primitive, Ray, RayTree, TimeInterval};
    ///
    /// /// The plane z = 0, as far as 1 from a middle that moves along x.
    /// struct Tile;
    /// impl Primitive for Tile {
    ///     fn bounds(&self, over: TimeInterval) -> LinearBounds {
    ///         let at = |x: f64| Aabb { min: DVec3::new(x - 1.0, -1.0, 0.0), max: DVec3::new(x + 1.0, 1.0, 0.0) }.pad(1e-6);
    ///         LinearBounds { begin: at(over.begin().into()), end: at(over.end().into()) }
    ///     }
    ///     fn intersect(&self, ray: &Ray) -> Option<Intersection> {
    ///         let t = (-ray.origin.z / f64::from(ray.dir.z)) as f32;
    ///         let p = ray.point(t) - DVec3::X * f64::from(ray.time);
    ///         let hit = p.x.abs() <= 1.0 && p.y.abs() <= 1.0 && (ray.t_min..=ray.t_max).contains(&t);
    ///         hit.then_some(Intersection { t, u: p.x as f32, v: p.y as f32 })
    ///     }
    ///     fn point_at(&self, _: &Ray, hit: Intersection, time: f32) -> Option<DVec3> {
    ///         Some(DVec3::new(f64::from(hit.u + time), hit.v.into(), 0.0))
    ///     }
    /// }
    /// let tree = RayTree::of_scene(&[], vec![Tile], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.5, 0.25, 2.0), Vec3::NEG_Z).at_time(0.5);
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// assert_eq!(tree.point_at(&ray, &hit, 1.0), Some(DVec3::new(1.0, 0.25, 0.0)));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    fn point_at(&self, ray: &Ray, hit: Intersection, time: f32) -> Option<DVec3> {
        let _ = (ray, hit, time);
        None
    }

    /// Drops what the motion does not need. A tree, and brute force, call this once when they take the primitive, before anything
    /// else.
    ///
    /// A [`MovingSphere`] drops keys on the straight lines between others. A primitive with a sphere of its own
    /// ([`Primitive::as_sphere`]) best calls this method of it: queries read all keys that remain. The default changes nothing.
    ///
    /// ```
    /// use mbkd::{MovingSphere, Primitive, glam::DVec3};
    /// // Straight ahead, then back again, given at 65 keys.
    /// let x = |key: i32| f64::from(32 - (key - 32).abs());
    /// let mut ball = MovingSphere::new((0..65).map(|key| (DVec3::X * x(key), 1.0)).collect());
    /// ball.merge_keys();
    /// assert_eq!(ball.keys, [(DVec3::ZERO, 1.0), (DVec3::X * 32.0, 1.0), (DVec3::ZERO, 1.0)]);
    /// ```
    fn merge_keys(&mut self) {}
}
