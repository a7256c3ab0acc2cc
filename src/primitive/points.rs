//! Sets of points: the trait, and its implementations for common containers.
//!
//! A set has positions at `n` keys spaced evenly over the shutter (one key: static), moves
//! linearly between keys, and may have an active interval for each point. Builds read a set in place;
//! it need not be copied into a type of this crate first.

use crate::geometry::TimeInterval;
use glam::{DVec3, Vec3};

/// A position in one of the usual forms: `Vec3`, `DVec3`, `[f32; 3]`, `[f64; 3]`.
///
/// f32 positions are used exactly. So are f64 positions of points, unless the tree rounds them
/// ([`Precision::Single`](crate::Precision::Single)), and query points among them. A query point in f64
/// among f32 positions is rounded to f32, relative to the origin of the tree.
pub trait Position: Copy + Send + Sync {
    /// Whether positions need f64, and so an origin near them.
    const WIDE: bool;
    /// The position in f64, exactly.
    fn wide(self) -> DVec3;
    /// The position relative to `origin`, rounded to f32 once; exact if the origin is zero and the
    /// position is f32.
    #[inline(always)]
    fn relative(self, origin: DVec3) -> Vec3 {
        (self.wide() - origin).as_vec3()
    }
}

impl Position for Vec3 {
    const WIDE: bool = false;
    #[inline(always)]
    fn wide(self) -> DVec3 {
        self.as_dvec3()
    }
}

impl Position for [f32; 3] {
    const WIDE: bool = false;
    #[inline(always)]
    fn wide(self) -> DVec3 {
        Vec3::from_array(self).as_dvec3()
    }
}

impl Position for DVec3 {
    const WIDE: bool = true;
    #[inline(always)]
    fn wide(self) -> DVec3 {
        self
    }
}

impl Position for [f64; 3] {
    const WIDE: bool = true;
    #[inline(always)]
    fn wide(self) -> DVec3 {
        DVec3::from_array(self)
    }
}

/// A set of points that may move and may exist for a while only.
///
/// Implemented for slices, arrays and vectors of positions (one key) and of [`MovingPoint`], and for
/// [`PointArrays`] and [`PointColumns`]. Implement it for your own particle type to build without
/// copying. A build may ask for a position, interval or id several times, from any of its threads, and the answers must
/// be the same each time. (A set that contradicts itself gets an error, or a tree of some of its answers.)
///
/// ```
/// use mbkd::{PointParams, PointSet, PointTree, glam::DVec3};
/// struct Dust { place: [f32; 3], speed: [f32; 3] }
/// struct Cloud(Vec<Dust>);
/// impl PointSet for Cloud {
///     const WIDE: bool = false;
///     fn len(&self) -> usize { self.0.len() }
///     fn keys(&self) -> usize { 2 }
///     fn position(&self, point: usize, key: usize) -> DVec3 {
///         let d = &self.0[point];
///         let at: [f32; 3] = std::array::from_fn(|i| d.place[i] + key as f32 * d.speed[i]);
///         mbkd::glam::Vec3::from_array(at).as_dvec3()
///     }
/// }
/// let cloud = Cloud(vec![Dust { place: [0.0; 3], speed: [1.0, 0.0, 0.0] }]);
/// let tree = PointTree::build(&cloud, &PointParams::default())?;
/// assert_eq!(tree.nearest([0.25f32, 0.0, 0.0], 0.25).unwrap().distance_squared, 0.0);
/// # Ok::<(), mbkd::PointError>(())
/// ```
#[allow(clippy::len_without_is_empty)] // a set to be read by a build, not a container
pub trait PointSet: Sync {
    /// Whether positions need f64. False promises that every position is an f32 one.
    const WIDE: bool;
    /// Number of points.
    fn len(&self) -> usize;
    /// Number of keys, the same for all points.
    fn keys(&self) -> usize {
        1
    }
    /// The position of a point at a key.
    fn position(&self, point: usize, key: usize) -> DVec3;
    /// The active interval of a point.
    fn active(&self, _point: usize) -> TimeInterval {
        TimeInterval::FULL
    }
    /// The id that answers carry for a point: its index unless overridden. `u32::MAX` is reserved.
    fn id(&self, point: usize) -> u32 {
        point as u32
    }
    /// The name of an array whose length differs from the others, the expected length, and its length.
    fn mismatch(&self) -> Option<(&'static str, usize, usize)> {
        None
    }
}

impl<P: Position> PointSet for [P] {
    const WIDE: bool = P::WIDE;
    fn len(&self) -> usize {
        <[P]>::len(self)
    }
    #[inline(always)]
    fn position(&self, point: usize, _key: usize) -> DVec3 {
        self[point].wide()
    }
}

/// A point that moves on a straight line from shutter open to shutter close, and may be active for a part of it only.
///
/// ```
/// use mbkd::{MovingPoint, PointParams, PointTree, TimeInterval, glam::Vec3};
/// let photons = [
///     MovingPoint::fixed(Vec3::ZERO).with_active(TimeInterval::new(0.0, 0.5)?),
///     MovingPoint::new(Vec3::X, -Vec3::X),
/// ];
/// let tree = PointTree::build(&photons, &PointParams::default())?;
/// assert_eq!(tree.nearest(Vec3::ZERO, 0.25).unwrap().id, 0);
/// assert_eq!(tree.nearest(Vec3::ZERO, 0.75).unwrap().id, 1, "the first is gone");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingPoint {
    /// Position at time 0.
    pub open: Vec3,
    /// Position at time 1.
    pub close: Vec3,
    /// The active interval.
    pub active: TimeInterval,
}

impl MovingPoint {
    /// A point that is active throughout the shutter.
    pub fn new(open: Vec3, close: Vec3) -> MovingPoint {
        MovingPoint { open, close, active: TimeInterval::FULL }
    }

    /// A static point.
    pub fn fixed(at: Vec3) -> MovingPoint {
        MovingPoint::new(at, at)
    }

    /// The same point, active during `interval` only.
    pub fn with_active(self, interval: TimeInterval) -> MovingPoint {
        MovingPoint { active: interval, ..self }
    }
}

impl PointSet for [MovingPoint] {
    const WIDE: bool = false;
    fn len(&self) -> usize {
        <[MovingPoint]>::len(self)
    }
    fn keys(&self) -> usize {
        2
    }
    #[inline(always)]
    fn position(&self, point: usize, key: usize) -> DVec3 {
        let point = &self[point];
        (if key == 0 { point.open } else { point.close }).as_dvec3()
    }
    #[inline(always)]
    fn active(&self, point: usize) -> TimeInterval {
        self[point].active
    }
}

/// Arrays over the points: one of positions per key, and optionally intervals and ids.
///
/// ```
/// use mbkd::{PointArrays, PointParams, PointTree};
/// let (a, b, c) = ([[0.0, 0.0, 0.0f64]], [[1.0, 0.0, 0.0]], [[1.0, 1.0, 0.0]]);
/// let set = PointArrays { keys: &[&a, &b, &c], active: &[], ids: &[77] };
/// let tree = PointTree::build(&set, &PointParams::default())?;
/// let found = tree.nearest([1.0f64, 0.5, 0.0], 0.75).unwrap();
/// assert_eq!((found.id, found.distance_squared), (77, 0.0));
/// # Ok::<(), mbkd::PointError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PointArrays<'a, P> {
    /// Positions at each key, the keys spaced evenly over the shutter.
    pub keys: &'a [&'a [P]],
    /// Active intervals of the points; empty: throughout the shutter.
    pub active: &'a [TimeInterval],
    /// The points' ids; empty: their indices.
    pub ids: &'a [u32],
}

impl<P: Position> PointSet for PointArrays<'_, P> {
    const WIDE: bool = P::WIDE;
    fn len(&self) -> usize {
        self.keys.first().map_or(0, |key| key.len())
    }
    fn keys(&self) -> usize {
        self.keys.len()
    }
    #[inline(always)]
    fn position(&self, point: usize, key: usize) -> DVec3 {
        self.keys[key][point].wide()
    }
    #[inline(always)]
    fn active(&self, point: usize) -> TimeInterval {
        self.active.get(point).copied().unwrap_or(TimeInterval::FULL)
    }
    #[inline(always)]
    fn id(&self, point: usize) -> u32 {
        self.ids.get(point).copied().unwrap_or(point as u32)
    }
    fn mismatch(&self) -> Option<(&'static str, usize, usize)> {
        let points = self.len();
        if let Some(key) = self.keys.iter().find(|key| key.len() != points) {
            return Some(("keys", points, key.len()));
        }
        let bad = |array: usize| array != 0 && array != points;
        if bad(self.active.len()) {
            return Some(("active", points, self.active.len()));
        }
        bad(self.ids.len()).then_some(("ids", points, self.ids.len()))
    }
}

/// Static points, with coordinates in columns.
///
/// ```
/// use mbkd::{PointColumns, PointParams, PointTree};
/// let set = PointColumns { x: &[0.0, 1.0], y: &[0.0, 1.0], z: &[0.0, 1.0] };
/// let tree = PointTree::build(&set, &PointParams::default())?;
/// assert_eq!(tree.nearest([0.9f32, 1.0, 1.0], 0.0).unwrap().id, 1);
/// # Ok::<(), mbkd::PointError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PointColumns<'a> {
    /// First coordinates.
    pub x: &'a [f32],
    /// Second coordinates.
    pub y: &'a [f32],
    /// Third coordinates.
    pub z: &'a [f32],
}

impl PointSet for PointColumns<'_> {
    const WIDE: bool = false;
    fn len(&self) -> usize {
        self.x.len()
    }
    #[inline(always)]
    fn position(&self, point: usize, _key: usize) -> DVec3 {
        DVec3::new(self.x[point].into(), self.y[point].into(), self.z[point].into())
    }
    fn mismatch(&self) -> Option<(&'static str, usize, usize)> {
        let points = self.x.len();
        let differs = |name, found: usize| (found != points).then_some((name, points, found));
        differs("y", self.y.len()).or(differs("z", self.z.len()))
    }
}

impl<T: Sync> PointSet for Vec<T>
where
    [T]: PointSet,
{
    const WIDE: bool = <[T] as PointSet>::WIDE;
    fn len(&self) -> usize {
        PointSet::len(&self[..])
    }
    fn keys(&self) -> usize {
        self[..].keys()
    }
    #[inline(always)]
    fn position(&self, point: usize, key: usize) -> DVec3 {
        self[..].position(point, key)
    }
    #[inline(always)]
    fn active(&self, point: usize) -> TimeInterval {
        self[..].active(point)
    }
}

impl<T: Sync, const N: usize> PointSet for [T; N]
where
    [T]: PointSet,
{
    const WIDE: bool = <[T] as PointSet>::WIDE;
    fn len(&self) -> usize {
        PointSet::len(&self[..])
    }
    fn keys(&self) -> usize {
        self[..].keys()
    }
    #[inline(always)]
    fn position(&self, point: usize, key: usize) -> DVec3 {
        self[..].position(point, key)
    }
    #[inline(always)]
    fn active(&self, point: usize) -> TimeInterval {
        self[..].active(point)
    }
}
