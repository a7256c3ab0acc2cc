//! What a tree asks of the things in it.
//!
//! [`Primitive`] is what a caller implements for a moving shape of his own. Inside the crate a tree sees
//! a whole set of primitives through [`PrimitiveSet`], in tree space: rebased triangle meshes are one,
//! a list of [`Primitive`]s is another.

use crate::error::BuildError;
use crate::geometry::{Aabb, Box3, Ends, Frame, LinearBounds, LinearBox3, Ray, TimeInterval};
use crate::limits::MAX_COORDINATE;
use crate::simd::LANES;
use core::sync::atomic::{AtomicU32, Ordering};
use glam::DVec3;

/// A moving shape that a [`RayTree`](crate::RayTree) can hold.
///
/// The contract, which [`check_primitive`](crate::check_primitive) tests on samples:
/// - [`bounds`](Primitive::bounds) hold, at every time of the interval, every point that
///   [`intersect`](Primitive::intersect) can report at that time, *including its own rounding*: pad them by
///   the error of the intersection arithmetic.
/// - Bounds are finite, not inverted, and within [`MAX_COORDINATE`], over every part of the
///   shutter, down to a single instant.
/// - They hold every point that [`closest_point`](Primitive::closest_point) reports at that time, exactly.
/// - [`intersect`](Primitive::intersect) and [`closest_point`](Primitive::closest_point) are pure: the same question gets
///   the same answer, however often and on whichever thread it is asked.
///
/// A primitive that breaks the contract does no harm to others. Bounds that are no boxes end the build with
/// [`BuildError::BadBounds`]. Bounds that do not hold what is hit, or that change from one call to the next, lose hits of
/// this primitive. [`active`](Primitive::active) is asked once.
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
///         inside.then_some(Intersection { t: t as f32, u: p.x as f32, v: p.y as f32 })
///     }
/// }
/// let tree = RayTree::of_primitives(vec![Lift], &BuildParams::default())?;
/// let ray = Ray::new(DVec3::new(0.5, 0.5, 3.0), Vec3::NEG_Z).at_time(0.25);
/// assert_eq!(tree.closest_hit(&ray).unwrap().t, 2.75);
/// # Ok::<(), mbkd::BuildError>(())
/// ```
pub trait Primitive: Send + Sync {
    /// Linear bounds over a part of the shutter, in world coordinates. The primitive need not exist all of that time.
    fn bounds(&self, over: TimeInterval) -> LinearBounds;

    /// The nearest intersection at `ray.time` with `t` in `[ray.t_min, ray.t_max]`.
    ///
    /// An answer outside that range counts as none.
    fn intersect(&self, ray: &Ray) -> Option<Intersection>;

    /// The point of the primitive at `time` that is nearest to `point`, for
    /// [`RayTree::closest_point`](crate::RayTree::closest_point).
    ///
    /// The default is `None`, for all points: then the primitive takes no part in such queries, as if it were not there.
    /// A point with a NaN counts as none.
    fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
        let _ = (point, time);
        None
    }

    /// When the primitive exists. The default is the whole shutter.
    fn active(&self) -> TimeInterval {
        TimeInterval::FULL
    }
}

/// Where a ray meets a primitive, as a [`Primitive`] reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intersection {
    /// Distance in units of the ray's direction: the point is `origin + t * dir`.
    pub t: f32,
    /// First surface parameter, handed through to [`Hit::u`](crate::Hit::u).
    pub u: f32,
    /// Second surface parameter, handed through to [`Hit::v`](crate::Hit::v).
    pub v: f32,
}

/// A point on a primitive, as [`Primitive::closest_point`] reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Where it is, in world coordinates.
    pub point: DVec3,
    /// First surface parameter, handed through to [`ClosestPoint::u`](crate::ClosestPoint::u).
    pub u: f32,
    /// Second surface parameter, handed through to [`ClosestPoint::v`](crate::ClosestPoint::v).
    pub v: f32,
}

/// A set of primitives in tree space, as builders and queries see it.
pub(crate) trait PrimitiveSet: Send + Sync {
    /// The most primitives that the wide layout puts into one leaf block.
    const PER_LEAF: usize = LANES;
    /// Number of primitives; ids run from 0.
    fn len(&self) -> usize;
    /// When a primitive exists.
    fn active(&self, id: u32) -> TimeInterval;
    /// Whether all primitives exist throughout the shutter.
    fn always_active(&self) -> bool;
    /// Linear bounds over an interval, holding whatever a ray is found to hit before the rounding that
    /// grows with the ray's distance, for which every traversal keeps slack.
    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3;
    /// Bounds of the part inside `cell` at one instant, for choosing planes; empty where there is none.
    fn clipped(&self, id: u32, time: f32, cell: Box3) -> Box3;
    /// Primitives of different kinds do not lie in one leaf block: each number of keys above two is one.
    fn leaf_kind(&self, id: u32) -> u32 {
        let _ = id;
        0
    }
    /// Whether primitives of one kind may share a leaf block, as far as memory is concerned.
    fn fits_block(&self, ids: &[u32]) -> bool {
        let _ = ids;
        true
    }
    /// The most bytes that keys beyond the second take in leaf blocks which have each of them once.
    fn further_key_bytes(&self) -> usize {
        0
    }
    /// Whether there are primitives whose leaf blocks hold more than two keys.
    fn bent(&self) -> bool {
        self.further_key_bytes() > 0
    }
    /// Vertex positions over all keys: as given, and those that are kept.
    fn positions(&self) -> [usize; 2] {
        [0, 0]
    }
    /// Whether the primitive certainly stays clear of a cell during the whole interval, by more than the kernel's
    /// rounding, although its bounds do not: `cell` is the cell at the begin and end of the interval,
    /// linear in between. `false` is always right.
    fn is_disjoint(&self, id: u32, over: TimeInterval, cell: LinearBox3) -> bool {
        let _ = (id, over, cell);
        false
    }
    /// The corners at both ends of an interval in which they move linearly, of a primitive that may be cut.
    fn ends(&self, id: u32, over: TimeInterval) -> Option<Ends>;
    /// Prefetches where the vertices of a primitive are; the vertices themselves follow with
    /// [`PrimitiveSet::prefetch_vertices`]. A hint.
    fn prefetch(&self, _: u32) {}
    /// Prefetches the vertices of a primitive whose corners were prefetched some time ago.
    fn prefetch_vertices(&self, _: u32) {}
    /// The visibility mask.
    fn mask(&self, id: u32) -> u32 {
        let _ = id;
        u32::MAX
    }
    /// Mesh and primitive as the caller numbers them.
    fn name(&self, id: u32) -> (u32, u32);
    /// The map between world and tree space.
    fn frame(&self) -> &Frame;
    /// What has been wrong with the answers of a caller's primitive since the set was made.
    fn complaint(&self) -> Result<(), BuildError> {
        Ok(())
    }
    /// Bytes allocated.
    fn bytes(&self) -> usize;
}

/// The caller's own primitives, as a [`RayTree`](crate::RayTree) holds them.
pub struct Shapes<P> {
    shapes: Vec<P>,
    /// When each exists; empty where all do throughout the shutter.
    active: Vec<TimeInterval>,
    frame: Frame,
    /// The lowest primitive that gave bad bounds over a part of its time, or [`NONE`].
    bad: AtomicU32,
}

/// No primitive has this id.
const NONE: u32 = u32::MAX;

/// Bounds over a part of the time are used if they reach at most so many times as far from tree space's zero as those over
/// the whole time. A chord shifted to hold the keys between reaches twice as far from where it began.
const FARTHEST: f32 = 4.0;

/// Whether bounds are boxes within [`MAX_COORDINATE`]: not NaN, infinite or inverted.
fn are_boxes(bounds: LinearBounds) -> bool {
    [bounds.begin, bounds.end].into_iter().all(|b| {
        // Comparisons in this form also refuse NaN.
        b.min.cmple(b.max).all() && b.min.abs().max(b.max.abs()).cmple(DVec3::splat(MAX_COORDINATE)).all()
    })
}

/// When and where shapes are. Each is asked once when it exists.
pub(crate) struct ShapesExtent {
    /// When each exists; empty where all do throughout the shutter.
    active: Vec<TimeInterval>,
    /// The box that holds all, always.
    pub swept: Aabb,
}

impl ShapesExtent {
    /// Of shapes whose bounds over the whole time they exist are boxes.
    pub fn of<P: Primitive>(shapes: &[P]) -> Result<ShapesExtent, BuildError> {
        if shapes.len() >= NONE as usize {
            return Err(BuildError::TooManyPrimitives { found: shapes.len() });
        }
        let mut active: Vec<TimeInterval> = shapes.iter().map(Primitive::active).collect();
        let mut swept = Aabb::EMPTY;
        for (primitive, (shape, &active)) in shapes.iter().zip(&active).enumerate() {
            let bounds = shape.bounds(active);
            if !are_boxes(bounds) {
                return Err(BuildError::BadBounds { primitive });
            }
            swept = swept.union(bounds.swept());
        }
        if active.iter().all(|&active| active == TimeInterval::FULL) {
            active = Vec::new();
        }
        Ok(ShapesExtent { active, swept })
    }
}

impl<P: Primitive> Shapes<P> {
    /// Takes the shapes after checking their bounds over the whole time they exist.
    pub(crate) fn new(shapes: Vec<P>) -> Result<Shapes<P>, BuildError> {
        let extent = ShapesExtent::of(&shapes)?;
        let frame = Frame::around(extent.swept);
        Ok(Shapes::within(shapes, extent, frame))
    }

    /// Shapes that were checked, in a tree space that holds them.
    pub(crate) fn within(shapes: Vec<P>, extent: ShapesExtent, frame: Frame) -> Shapes<P> {
        Shapes { shapes, active: extent.active, frame, bad: AtomicU32::new(NONE) }
    }

    /// When each exists, as bounds; nothing where all do throughout the shutter.
    pub(crate) fn lives(&self) -> Vec<[f32; 2]> {
        self.active.iter().map(|active| active.to_bounds()).collect()
    }

    /// The shapes as they were given.
    pub(crate) fn shapes(&self) -> &[P] {
        &self.shapes
    }

    /// Takes the shapes away, for a set that replaces this one.
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

    /// Of a primitive that contradicts itself the bounds of all: they hold whatever it was first said to be.
    fn bounds(&self, id: u32, over: TimeInterval) -> LinearBox3 {
        let outward = |b: Aabb| {
            let (min, max) = self.frame.outward(b);
            Box3 { min, max }
        };
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

    fn clipped(&self, id: u32, time: f32, cell: Box3) -> Box3 {
        match TimeInterval::half_open(time, time.next_up()) {
            Some(instant) => self.bounds(id, instant).begin.intersection(cell),
            None => Box3::EMPTY,
        }
    }

    fn ends(&self, _: u32, _: TimeInterval) -> Option<Ends> {
        None
    }

    fn name(&self, id: u32) -> (u32, u32) {
        (0, id)
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn complaint(&self) -> Result<(), BuildError> {
        match self.bad.load(Ordering::Relaxed) {
            NONE => Ok(()),
            primitive => Err(BuildError::BadBounds { primitive: primitive as usize }),
        }
    }

    fn bytes(&self) -> usize {
        self.shapes.capacity() * size_of::<P>() + self.active.capacity() * size_of::<TimeInterval>()
    }
}
