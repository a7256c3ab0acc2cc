//! The traits of primitives in a tree.
//!
//! A caller implements [`Primitive`] for a custom moving shape. Inside the crate, a tree accesses a whole set of primitives
//! through [`PrimitiveSet`], in tree space. Triangle meshes are one such set; a list of [`Primitive`]s is another.

use super::intersection::{Intersection, SurfacePoint};
use super::key_window::Intervals;
use super::sphere::MovingSphere;
use super::vertex_tubes::VertexTubes;
use crate::error::BuildError;
use crate::geometry::{Aabb, Box3, CornerBounds, Frame, LaneBounds, LinearBounds, LinearBox3, Ray, TimeInterval};
use crate::limits::MAX_COORDINATE;
use crate::parallel::{self, CHUNK};
use crate::progress::Progress;
use crate::simd::{LANES, prefetch};
use core::sync::atomic::{AtomicU32, Ordering};
use glam::DVec3;

/// A moving shape that a [`RayTree`](crate::RayTree) can hold.
///
/// The contract, which [`check_primitive`](crate::check_primitive) tests on samples:
/// - At every time of the interval, [`bounds`](Primitive::bounds) contain every point that
///   [`intersect`](Primitive::intersect) can report at that time, *including its own rounding*. So pad them by the error of
///   the intersection arithmetic.
/// - At every time of the interval, they contain every point that [`closest_point`](Primitive::closest_point) reports at
///   that time, exactly.
/// - Bounds are finite, not inverted, and within [`MAX_COORDINATE`], over every part of the shutter, down to a single
///   instant.
/// - [`intersect`](Primitive::intersect) reports the nearest intersection in the range of the ray, and none outside it.
/// - [`intersect`](Primitive::intersect) and [`closest_point`](Primitive::closest_point) are pure: the same arguments give
///   the same answer, for any number of calls and on any thread.
/// - The sphere of [`as_sphere`](Primitive::as_sphere), if there is one, has the same answers, and is there at each call.
/// - No function waits for tasks of rayon's. A lazy tree calls [`bounds`](Primitive::bounds) while other threads wait for the
///   subtree, and a thread that waits for its tasks may take up one of those that wait: then none of them goes on.
///
/// A primitive that breaks the contract does not affect others. If its bounds are invalid, the build fails with
/// [`BuildError::BadBounds`]. If its bounds do not contain all hits, or change from one call to the next, hits of this
/// primitive are lost. A tree calls [`active`](Primitive::active) and [`mask`](Primitive::mask) once, when it takes the primitive.
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
/// let tree = RayTree::of_primitives(vec![Lift], &BuildParams::default())?;
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
    /// let tree = RayTree::of_primitives(vec![Lamp(MovingSphere::fixed(DVec3::ZERO, 1.0))], &BuildParams::default())?;
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
    /// /// A ball with a color.
    /// struct Ball(MovingSphere, [u8; 3]);
    /// impl Primitive for Ball {
    ///     fn bounds(&self, over: TimeInterval) -> LinearBounds {
    ///         self.0.bounds(over)
    ///     }
    ///     fn intersect(&self, ray: &Ray) -> Option<Intersection> {
    ///         self.0.intersect(ray)
    ///     }
    ///     fn as_sphere(&self) -> Option<&MovingSphere> {
    ///         Some(&self.0)
    ///     }
    /// }
    /// let balls = (0..9).map(|i| Ball(MovingSphere::fixed(DVec3::X * f64::from(i) * 3.0, 1.0), [i, 0, 0]));
    /// let tree = RayTree::of_primitives(balls.collect(), &BuildParams::default())?;
    /// let hit = tree.closest_hit(&Ray::new(Vec3::new(6.0, 0.0, 5.0), Vec3::NEG_Z)).unwrap();
    /// assert_eq!((hit.t, tree.primitives()[hit.primitive as usize].1), (4.0, [2, 0, 0]));
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
    /// use mbkd::{Aabb, BuildParams, Intersection, LinearBounds, Primitive, Ray, RayTree, Shape, TimeInterval};
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
    /// let tree = RayTree::of_scene(&[], vec![Shape::custom(Tile)], &BuildParams::default())?;
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

/// A set of primitives in tree space: the interface for builders and queries.
pub(crate) trait PrimitiveSet: Send + Sync {
    /// The greatest number of primitives in one leaf block of the wide layout.
    fn per_leaf(&self) -> usize {
        LANES
    }
    /// The number of primitives; ids begin at 0.
    fn len(&self) -> usize;
    /// Primitives that no query sees, in ascending order: no leaf holds them.
    fn hidden(&self) -> &[u32] {
        &[]
    }
    /// The active interval of a primitive.
    fn active(&self, id: u32) -> TimeInterval;
    /// Whether all primitives exist throughout the shutter.
    fn always_active(&self) -> bool;
    /// The active interval of each mesh and, after these, of each shape.
    fn active_intervals(&self) -> Vec<TimeInterval> {
        (0..self.len() as u32).map(|id| self.active(id)).collect()
    }
    /// For each mesh and, after these, each shape, the interval to which refits of a tree are bound by the keys that leaf blocks
    /// hold.
    fn intervals_of_keys(&self) -> Vec<TimeInterval> {
        Vec::new()
    }
    /// Linear bounds over an interval. They contain all hits of the kernel, up to the rounding that grows with the ray's
    /// distance; the slack of traversals covers that.
    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3;
    /// What [`PrimitiveSet::lane_bounds`] can use if it is asked for the bounds of all of these primitives, in ascending order.
    fn tubes(&self, ids: &[u32], over: TimeInterval) -> VertexTubes {
        let _ = (ids, over);
        VertexTubes::default()
    }
    /// The bounds of some primitives in ascending order; `tubes` are over the same interval.
    fn lane_bounds(&self, ids: &[u32], over: TimeInterval, tubes: &VertexTubes, out: &mut [LaneBounds]) {
        let _ = tubes;
        for (&id, to) in ids.iter().zip(out) {
            *to = LaneBounds::of(&self.bounds(id, over));
        }
    }
    /// Extends `out` by the bounds of some primitives of one kind ([`PrimitiveSet::leaf_kind`]): one element for each interval.
    fn include_bounds(&self, ids: &[u32], over: &mut Intervals<'_>, out: &mut [LinearBox3]) {
        include_each(self, ids, over, out);
    }
    /// Bounds of the part inside `cell` at one instant, for choosing planes; empty if there is none.
    fn clipped(&self, id: u32, time: f32, cell: Box3) -> Box3 {
        match TimeInterval::half_open(time, time.next_up()) {
            Some(instant) => self.bounds(id, instant).begin.intersection(cell),
            None => Box3::EMPTY,
        }
    }
    /// The kind of leaf block for a primitive. Primitives of different kinds are not put into one block; each number of
    /// keys above two is a kind.
    fn leaf_kind(&self, id: u32) -> u32 {
        let _ = id;
        0
    }
    /// Whether primitives may be of more than one kind.
    fn kinds_differ(&self) -> bool {
        self.bent()
    }
    /// Whether the memory of a leaf block for these primitives of one kind is reasonable.
    fn fits_block(&self, ids: &[u32]) -> bool {
        let _ = ids;
        true
    }
    /// A bound of the bytes of triangles' keys beyond the second and of all keys of spheres in leaf blocks, if each key is stored
    /// once.
    fn further_key_bytes(&self) -> usize {
        0
    }
    /// Whether there are triangles whose leaf blocks hold more than two keys.
    fn bent(&self) -> bool {
        false
    }
    /// Vertex positions over all keys: as given, and those that are kept.
    fn positions(&self) -> [usize; 2] {
        [0, 0]
    }
    /// Whether the primitive is proved disjoint from a cell during the whole interval, by more than the kernel's rounding,
    /// although its bounds overlap the cell. `cell` is the cell at the begin and at the end of the interval, and linear in
    /// between. `false` is always valid.
    fn is_disjoint(&self, id: u32, over: TimeInterval, cell: LinearBox3) -> bool {
        let _ = (id, over, cell);
        false
    }
    /// Linear bounds of the corners of a triangle over an interval; `None` for a primitive that is not split.
    fn corner_bounds(&self, id: u32, over: TimeInterval) -> Option<CornerBounds> {
        let _ = (id, over);
        None
    }
    /// At the begin of an interval: half the area of the box around the corners of a triangle, and the area of the triangle itself;
    /// `None` for a primitive that is not split.
    fn areas(&self, id: u32, over: TimeInterval) -> Option<[f32; 2]> {
        self.corner_bounds(id, over).map(|corners| corners.areas())
    }
    /// Prefetches the vertex indices of a primitive; the vertices themselves follow with
    /// [`PrimitiveSet::prefetch_vertices`]. A hint.
    fn prefetch(&self, _: u32) {}
    /// Prefetches the vertices of a primitive, as bounds over an interval need them, whose corners were prefetched some time ago.
    fn prefetch_vertices(&self, _: u32, _over: TimeInterval) {}
    /// The sphere that a primitive is. Leaf blocks of spheres hold their positions.
    fn sphere(&self, id: u32) -> Option<&MovingSphere> {
        let _ = id;
        None
    }
    /// The visibility mask.
    fn mask(&self, id: u32) -> u32;
    /// The visibility masks of all meshes and shapes, or one that many have in common; empty if there are none.
    fn masks(&self) -> Vec<u32>;
    /// Mesh and primitive in the caller's numbering.
    fn mesh_and_primitive(&self, id: u32) -> (u32, u32) {
        (0, id)
    }
    /// The map between world and tree space.
    fn frame(&self) -> &Frame;
    /// An error if a custom primitive has returned invalid bounds since the set was made.
    fn input_error(&self) -> Result<(), BuildError> {
        Ok(())
    }
    /// Bytes allocated.
    fn bytes(&self) -> usize;
}

/// Extends `out` by the bounds of some primitives, one by one.
pub(super) fn include_each<S: PrimitiveSet + ?Sized>(
    set: &S,
    ids: &[u32],
    over: &Intervals<'_>,
    out: &mut [LinearBox3],
) {
    for (&over, to) in over.over.iter().zip(out) {
        *to = ids.iter().fold(*to, |all, &id| all.union(set.bounds(id, over)));
    }
}

/// Custom primitives, as a [`RayTree`](crate::RayTree) holds them.
pub struct Shapes<P> {
    shapes: Vec<P>,
    /// Active intervals; empty if all shapes exist throughout the shutter.
    active: Vec<TimeInterval>,
    /// Visibility masks; empty if all shapes have all bits.
    masks: Vec<u32>,
    /// The bytes of spheres' keys in leaf blocks.
    key_bytes: usize,
    /// The [`kind`] of each shape, or the one that all have, as it was when they were taken: builders ask often and rely on the
    /// answer.
    kinds: Vec<u32>,
    frame: Frame,
    /// The box that holds all shapes at all times.
    swept: Aabb,
    /// The lowest primitive that returned invalid bounds over a part of its interval, or [`NONE`].
    bad: AtomicU32,
}

/// What a sphere at one key takes in a leaf block, in f32 and in f64, at most: an arena may be a thirty-second larger than its
/// blocks.
pub(crate) const SPHERE_KEY_BYTES: usize = size_of::<([f32; 4], [f64; 4])>() * 33 / 32 + 1;

/// No primitive has this id.
const NONE: u32 = u32::MAX;

/// Bounds over a part of the interval are used if they reach at most this many times as far from the origin of tree space
/// as those over the whole interval. A chord shifted to hold the keys between reaches twice as far from its begin.
const FARTHEST: f32 = 4.0;

/// Whether bounds are boxes within [`MAX_COORDINATE`]: not NaN, infinite or inverted.
fn are_boxes(bounds: LinearBounds) -> bool {
    [bounds.begin, bounds.end].into_iter().all(|b| {
        // Comparisons in this form also refuse NaN.
        b.min.cmple(b.max).all() && b.min.abs().max(b.max.abs()).cmple(DVec3::splat(MAX_COORDINATE)).all()
    })
}

/// The intervals, masks and bounds of shapes. The interval and the mask of each shape are read here, and nowhere else.
#[derive(Clone)]
pub(crate) struct ShapesExtent {
    /// Active intervals; empty if all shapes exist throughout the shutter.
    active: Vec<TimeInterval>,
    /// Visibility masks; empty if all shapes have all bits.
    masks: Vec<u32>,
    /// The box that holds all shapes at all times.
    pub swept: Aabb,
}

impl ShapesExtent {
    /// Checks that the bounds of shapes over their whole intervals are valid boxes.
    pub fn of<P: Primitive>(shapes: &[P], progress: &Progress) -> Result<ShapesExtent, BuildError> {
        if shapes.len() >= NONE as usize {
            return Err(BuildError::TooManyPrimitives { found: shapes.len() });
        }
        let mut active: Vec<TimeInterval> = shapes.iter().map(Primitive::active).collect();
        let mut swept = Aabb::EMPTY;
        let progress = progress.in_units(shapes.len());
        for (primitive, (shape, &active)) in shapes.iter().zip(&active).enumerate() {
            if primitive.is_multiple_of(CHUNK) {
                progress.check()?;
                progress.finished(CHUNK as f64);
            }
            let bounds = shape.bounds(active);
            if !are_boxes(bounds) {
                return Err(BuildError::BadBounds { primitive });
            }
            swept = swept.union(bounds.swept());
        }
        if active.iter().all(|&active| active == TimeInterval::FULL) {
            active = Vec::new();
        }
        let mut masks: Vec<u32> = shapes.iter().map(Primitive::mask).collect();
        if masks.iter().all(|&mask| mask == u32::MAX) {
            masks = Vec::new();
        }
        Ok(ShapesExtent { active, masks, swept })
    }

    /// The active interval of a shape.
    pub fn active(&self, shape: usize) -> TimeInterval {
        self.active.get(shape).copied().unwrap_or(TimeInterval::FULL)
    }
}

/// The kind of leaf block for a shape: a sphere of more than two keys shares one with those of as many.
fn kind(shape: &impl Primitive) -> u32 {
    match shape.as_sphere() {
        Some(sphere) if sphere.keys.len() > 2 => sphere.keys.len() as u32,
        _ => 0,
    }
}

/// The same shapes without the keys that they do not need.
pub(super) fn with_merged_keys<P: Primitive>(mut shapes: Vec<P>) -> Vec<P> {
    let mut parts: Vec<_> = shapes.chunks_mut(CHUNK).collect();
    parallel::each(&mut parts, |part| part.iter_mut().for_each(P::merge_keys));
    shapes
}

impl<P: Primitive> Shapes<P> {
    /// A set of shapes, after checking their bounds over their whole intervals.
    pub(crate) fn new(shapes: Vec<P>) -> Result<Shapes<P>, BuildError> {
        Shapes::read(shapes, &Progress::new(None))
    }

    /// The same as a part of a build.
    pub(crate) fn read(shapes: Vec<P>, progress: &Progress) -> Result<Shapes<P>, BuildError> {
        let shapes = with_merged_keys(shapes);
        let extent = ShapesExtent::of(&shapes, progress)?;
        let frame = Frame::around(extent.swept);
        Ok(Shapes::within(shapes, extent, frame))
    }

    /// Shapes that were checked, in a tree space that holds them.
    pub(crate) fn within(shapes: Vec<P>, extent: ShapesExtent, frame: Frame) -> Shapes<P> {
        let keys = shapes.iter().filter_map(|shape| Some(shape.as_sphere()?.keys.len()));
        let key_bytes = keys.sum::<usize>() * SPHERE_KEY_BYTES;
        let mut kinds: Vec<u32> = shapes.iter().map(kind).collect();
        if kinds.iter().all(|kind| *kind == kinds[0]) {
            kinds.truncate(1);
            kinds.shrink_to_fit();
        }
        let ShapesExtent { active, masks, swept } = extent;
        Shapes { shapes, active, masks, key_bytes, kinds, frame, swept, bad: AtomicU32::new(NONE) }
    }

    /// Active intervals as bounds; empty if all shapes exist throughout the shutter.
    pub(crate) fn active_bounds(&self) -> Vec<[f32; 2]> {
        self.active.iter().map(|active| active.to_bounds()).collect()
    }

    /// The shapes as they were given, after [`Primitive::merge_keys`].
    pub(crate) fn shapes(&self) -> &[P] {
        &self.shapes
    }

    /// The box that holds all shapes at all times, in world space.
    pub(super) fn swept(&self) -> Aabb {
        self.swept
    }

    /// What is known of the shapes, as it was read when they were taken.
    pub(super) fn extent(&self) -> ShapesExtent {
        ShapesExtent { active: self.active.clone(), masks: self.masks.clone(), swept: self.swept }
    }

    /// Replaces the frame by one that maps points to the same coordinates.
    pub(super) fn set_frame(&mut self, frame: Frame) {
        debug_assert!(self.frame.maps_as(&frame));
        self.frame = frame;
    }

    /// Moves the shapes out, for a set that replaces this one.
    pub(super) fn take(&mut self) -> Vec<P> {
        core::mem::take(&mut self.shapes)
    }
}

impl<P: Primitive> PrimitiveSet for Shapes<P> {
    fn len(&self) -> usize {
        self.shapes.len()
    }

    fn active(&self, id: u32) -> TimeInterval {
        if self.always_active() { TimeInterval::FULL } else { self.active[id as usize] }
    }

    fn always_active(&self) -> bool {
        self.active.is_empty()
    }

    fn intervals_of_keys(&self) -> Vec<TimeInterval> {
        let of = |id: u32| if self.leaf_kind(id) > 2 { self.active(id) } else { TimeInterval::FULL };
        (0..self.shapes.len() as u32).map(of).collect()
    }

    /// For a primitive with contradictory bounds the bounds of all primitives: these hold its first bounds.
    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        let outward = |b: Aabb| self.frame.outward(b);
        let everything = || outward(self.frame.bounds);
        let bounds = self.shapes[id as usize].bounds(over);
        if !are_boxes(bounds) {
            self.bad.fetch_min(id, Ordering::Relaxed);
            return LinearBox3 { begin: everything(), end: everything() };
        }
        let bounds = LinearBox3 { begin: outward(bounds.begin), end: outward(bounds.end) };
        if bounds.swept().magnitude() <= FARTHEST * self.frame.reach {
            return bounds;
        }
        LinearBox3 { begin: everything(), end: everything() }
    }

    fn leaf_kind(&self, id: u32) -> u32 {
        if self.kinds_differ() { self.kinds[id as usize] } else { self.kinds[0] }
    }

    fn kinds_differ(&self) -> bool {
        self.kinds.len() > 1
    }

    fn sphere(&self, id: u32) -> Option<&MovingSphere> {
        self.shapes[id as usize].as_sphere()
    }

    fn mask(&self, id: u32) -> u32 {
        if self.masks.is_empty() { u32::MAX } else { self.masks[id as usize] }
    }

    fn masks(&self) -> Vec<u32> {
        match self.masks.is_empty() {
            true => vec![u32::MAX; self.len().min(1)],
            false => self.masks.clone(),
        }
    }

    fn prefetch(&self, id: u32) {
        prefetch(&self.shapes[id as usize]);
    }

    fn prefetch_vertices(&self, id: u32, _: TimeInterval) {
        if let Some(key) = self.sphere(id).and_then(|sphere| sphere.keys.first()) {
            prefetch(key);
        }
    }

    fn further_key_bytes(&self) -> usize {
        self.key_bytes
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn input_error(&self) -> Result<(), BuildError> {
        match self.bad.load(Ordering::Relaxed) {
            NONE => Ok(()),
            primitive => Err(BuildError::BadBounds { primitive: primitive as usize }),
        }
    }

    fn bytes(&self) -> usize {
        self.shapes.capacity() * size_of::<P>()
            + self.active.capacity() * size_of::<TimeInterval>()
            + self.masks.capacity() * size_of::<u32>()
            + self.kinds.capacity() * size_of::<u32>()
    }
}
