//! Reading a set of points: everything that can be wrong with it is checked here, and only here.

use crate::geometry::TimeInterval;
use crate::limits::{MAX_COORDINATE, MAX_KEYS, MAX_POINT_COORDINATE};
use crate::parallel::{self, CHUNK};
use crate::point::error::PointError;
use crate::point::layout::static_tree::StaticTree;
use crate::point::leaf_order::point_rows::PointRows;
use crate::point::leaf_order::widest_axis::include;
use crate::point::params::Precision;
use crate::primitive::{DOUBLE, PointSet, SINGLE, kept_keys};
use crate::progress::Progress;
use crate::simd::{Item, PointBlock, fill, huge_vec, prefetch};
use core::sync::atomic::{AtomicUsize, Ordering};
use glam::DVec3;

/// A set as it was read. What the build uses of positions, active intervals and ids is one copy, so that a set which contradicts
/// itself cannot make the build contradict itself. (To make it, some of them are read several times: to find the origin of f64
/// positions, the keys that are needed, and whether there are active intervals or ids at all.)
pub(in crate::point) struct Source {
    /// Number of points.
    pub(in crate::point) len: usize,
    /// Number of keys: of those given, as many as motion needs.
    pub(in crate::point) keys: usize,
    /// What positions are relative to.
    pub(in crate::point) origin: DVec3,
    /// Positions relative to the origin: those of a point at all its keys side by side, because a tree reads two of them in
    /// an order that is random in memory. Empty if all points are static and need f64: then no structure is to be chosen.
    positions: Vec<[f32; 3]>,
    /// The same in f64, as they were given; empty where f32 is enough.
    double: Vec<DVec3>,
    /// Active intervals; empty if all points exist throughout the shutter.
    active: Vec<TimeInterval>,
    /// Ids; empty where they are the indices.
    ids: Vec<u32>,
}

impl Source {
    /// Reads a set and checks everything that can be wrong with it.
    pub(in crate::point) fn read<P: PointSet + ?Sized>(points: &P, precision: Precision) -> Result<Source, PointError> {
        let (len, keys) = sizes(points)?;
        Source::of(points, (len, keys), false, precision)
    }

    /// The same; `not_plain` if it is known that active intervals or ids have to be read.
    fn of<P: PointSet + ?Sized>(
        points: &P,
        (len, keys): (usize, usize),
        not_plain: bool,
        precision: Precision,
    ) -> Result<Source, PointError> {
        let plain = !not_plain && is_plain(points, len);
        let (origin, needs_double) = if P::WIDE { origin_of(points, len, keys)? } else { (DVec3::ZERO, false) };
        let reader = Reader::new(points, keys, origin);
        let (mut positions, mut double) = (Vec::new(), Vec::new());
        // Keys that a straight motion does not need are dropped before anything is copied: what is copied is small.
        let in_double = match precision {
            Precision::Automatic => needs_double,
            Precision::Single => false,
            Precision::Double => true,
        };
        let keys = if in_double {
            let keys = kept_of(len, keys, DOUBLE, |point, key| points.position(point, key).to_array());
            double = reader.copy(len, keys, |point, key| reader.read_double(point, key));
            if keys > 1 || !plain {
                positions = double.iter().map(|at| (*at - origin).as_vec3().to_array()).collect();
            }
            keys
        } else {
            let keys = kept_of(len, keys, SINGLE, |point, key| {
                reader.relative(points.position(point, key)).as_vec3().as_dvec3().to_array()
            });
            positions = reader.copy(len, keys, |point, key| reader.read(point, key));
            keys
        };
        reader.finish()?;
        let mut active = Vec::new();
        let mut ids = Vec::new();
        for point in 0..if plain { 0 } else { len } {
            let (own, id) = (points.active(point), points.id(point));
            if id == u32::MAX {
                return Err(PointError::ReservedId { point });
            }
            if active.is_empty() && own != TimeInterval::FULL {
                active = vec![TimeInterval::FULL; len];
            }
            if let Some(to) = active.get_mut(point) {
                *to = own;
            }
            if ids.is_empty() && id != point as u32 {
                ids = (0..len as u32).collect();
            }
            if let Some(to) = ids.get_mut(point) {
                *to = id;
            }
        }
        Ok(Source { len, keys, origin, positions, double, active, ids })
    }

    /// Static points that are kept in f64, whatever they are; their positions are in order.
    pub(in crate::point) fn of_static_in_f64(double: Vec<DVec3>, origin: DVec3) -> Source {
        let (len, positions, active, ids) = (double.len(), Vec::new(), Vec::new(), Vec::new());
        Source { len, keys: 1, origin, positions, double, active, ids }
    }

    /// Position of a point at a key as the trees hold it.
    #[inline(always)]
    pub(in crate::point) fn at(&self, point: usize, key: usize) -> [f32; 3] {
        self.positions[point * self.keys + key]
    }

    /// Positions of all points that have one key.
    pub(in crate::point) fn of_only_key(&self) -> &[[f32; 3]] {
        debug_assert_eq!(self.keys, 1);
        &self.positions
    }

    /// Prefetches the positions of a point at a key and the next, if there is such a point; a hint.
    #[inline(always)]
    pub(in crate::point) fn prefetch(&self, point: usize, key: usize) {
        let first = point * self.keys + key;
        if let Some([at, next]) = self.positions.get(first..first + 2) {
            prefetch(at);
            // It may be in the next cache line.
            prefetch(&next[2]);
        }
    }

    /// Prefetches the active interval of a point; a hint.
    #[inline(always)]
    pub(in crate::point) fn prefetch_active(&self, point: usize) {
        if let Some(active) = self.active.get(point) {
            prefetch(active);
        }
    }

    /// Whether all points exist throughout the shutter.
    pub(in crate::point) fn all_persist(&self) -> bool {
        self.active.is_empty()
    }

    /// Whether all points exist throughout the shutter, and ids are indices.
    pub(in crate::point) fn is_plain(&self) -> bool {
        self.active.is_empty() && self.ids.is_empty()
    }

    /// Whether the ids are the indices.
    pub(in crate::point) fn ids_are_indices(&self) -> bool {
        self.ids.is_empty()
    }

    /// Position of a point at a key as it was given, in sets that need f64.
    #[inline(always)]
    pub(in crate::point) fn double(&self, point: usize, key: usize) -> DVec3 {
        self.double[point * self.keys + key]
    }

    /// Prefetches what [`Source::double`] reads at a key and the next; a hint.
    #[inline(always)]
    pub(in crate::point) fn prefetch_double(&self, point: usize, key: usize) {
        if let Some(at) = self.double.get(point * self.keys + key..) {
            at.iter().take(2).for_each(|at| prefetch(&at.z));
        }
    }

    /// Whether the set needs f64.
    pub(in crate::point) fn is_double(&self) -> bool {
        !self.double.is_empty()
    }

    /// The active interval of a point.
    pub(in crate::point) fn active(&self, point: usize) -> TimeInterval {
        self.active.get(point).copied().unwrap_or(TimeInterval::FULL)
    }

    /// The id that answers carry for a point.
    #[inline(always)]
    pub(in crate::point) fn id(&self, point: usize) -> u32 {
        self.ids.get(point).copied().unwrap_or(point as u32)
    }

    /// Whether it is known without looking at any point that none moves or has an active interval.
    pub(in crate::point) fn all_static(&self) -> bool {
        self.keys <= 1 && self.active.is_empty()
    }

    /// Whether a point neither moves nor has an active interval.
    fn is_static(&self, point: usize) -> bool {
        if self.active(point) != TimeInterval::FULL {
            return false;
        }
        if self.is_double() {
            let first = self.double(point, 0);
            return (1..self.keys).all(|key| self.double(point, key) == first);
        }
        let all = &self.positions[point * self.keys..][..self.keys];
        all.iter().all(|at| *at == all[0])
    }

    /// Which points are static.
    pub(in crate::point) fn static_points(&self) -> Vec<bool> {
        // The most common case, in a loop without branches.
        if self.keys == 2 && self.all_persist() && !self.is_double() {
            let (pairs, _) = self.positions.as_chunks();
            return pairs.iter().map(|[[a, b, c], [d, e, f]]| (a == d) & (b == e) & (c == f)).collect();
        }
        (0..self.len).map(|point| self.is_static(point)).collect()
    }

    /// A static tree of `count` of the points.
    pub(in crate::point) fn static_tree(
        &self,
        count: usize,
        select: impl Iterator<Item = usize>,
        progress: &Progress,
    ) -> StaticTree {
        let item = |i: usize| Item { at: self.at(i, 0), index: i as u32 };
        StaticTree::build(count, StaticTree::rows(count, select.map(item)), |i| self.id(i as usize), progress)
    }
}

/// What a build reads a set into.
pub(in crate::point) enum Input {
    /// A set of f32 positions with one key, without active intervals and ids of its own: the number of points, and the
    /// points in rows for [`StaticTree::build`].
    Static(usize, Vec<PointBlock>),
    /// Any other set.
    Other(Source),
}

impl Input {
    /// Reads a set; see [`Source::read`].
    pub(in crate::point) fn read<P: PointSet + ?Sized>(points: &P, precision: Precision) -> Result<Input, PointError> {
        let (len, keys) = sizes(points)?;
        let may_be_static = !P::WIDE && keys == 1 && precision != Precision::Double;
        if !(may_be_static && is_plain(points, len)) {
            return Source::of(points, (len, keys), may_be_static, precision).map(Input::Other);
        }
        let (mut blocks, reader) = (StaticTree::room(len), Reader::new(points, keys, DVec3::ZERO));
        let mut chunks = PointRows::in_blocks(&mut blocks, len).chunks(CHUNK);
        parallel::each(&mut chunks, |(first, rows)| {
            rows.take((*first..len).map(|point| Item { at: reader.read(point, 0), index: point as u32 }));
        });
        reader.finish()?;
        Ok(Input::Static(len, blocks))
    }
}

/// The numbers of points and keys of a set, if a tree can have so many.
fn sizes<P: PointSet + ?Sized>(points: &P) -> Result<(usize, usize), PointError> {
    let (len, keys) = (points.len(), points.keys());
    if let Some((name, expected, found)) = points.mismatch() {
        return Err(PointError::Length { name, expected, found });
    }
    if len > 0 && keys == 0 {
        return Err(PointError::NoKeys);
    }
    if keys > MAX_KEYS {
        return Err(PointError::TooManyKeys { found: keys });
    }
    if len >= u32::MAX as usize {
        return Err(PointError::TooManyPoints { found: len });
    }
    Ok((len, keys))
}

/// Whether all points exist throughout the shutter, and ids are indices.
fn is_plain<P: PointSet + ?Sized>(points: &P, len: usize) -> bool {
    let plain = |point: usize| points.active(point) == TimeInterval::FULL && points.id(point) == point as u32;
    let mut all = parallel::parts(len, |range| range.fold(true, |all, point| all & plain(point)));
    all.all(|plain| plain)
}

/// What positions of an f64 set are relative to, and whether they say more than f32 ones would. That is the middle of all,
/// or zero where they are f32 numbers around it.
fn origin_of<P: PointSet + ?Sized>(points: &P, len: usize, keys: usize) -> Result<(DVec3, bool), PointError> {
    let ranges = parallel::parts(len, |range| {
        let (mut lo, mut hi, mut single) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], true);
        for point in range {
            for key in 0..keys {
                let at = points.position(point, key);
                if !at.is_finite() {
                    return Err(PointError::NonFinite { point, key });
                }
                include(&mut lo, &mut hi, at.to_array());
                // One number that needs f64 is enough.
                single = single && at.as_vec3().as_dvec3() == at;
            }
        }
        Ok((DVec3::from_array(lo), DVec3::from_array(hi), single))
    });
    let (mut lo, mut hi, mut single) = (DVec3::INFINITY, DVec3::NEG_INFINITY, true);
    for range in ranges {
        let (low, high, all) = range?;
        (lo, hi, single) = (lo.min(low), hi.max(high), single & all);
    }
    // Where zero is far from the set, query points would lose more by being f32 numbers than relative to its middle.
    let around_zero = lo.cmple(DVec3::ZERO).all() && hi.cmpge(DVec3::ZERO).all();
    let small = len == 0 || (around_zero && single);
    Ok(if small { (DVec3::ZERO, false) } else { (lo * 0.5 + hi * 0.5, true) })
}

/// Reads positions and remembers the first that is wrong, so that the loop which reads is as fast as a copy.
struct Reader<'a, P: ?Sized> {
    points: &'a P,
    /// Number of keys that are given.
    given: usize,
    /// What positions are relative to.
    origin: DVec3,
    /// Number of the first wrong position, where those of a point are numbered one behind the other.
    wrong: AtomicUsize,
}

impl<'a, P: PointSet + ?Sized> Reader<'a, P> {
    fn new(points: &'a P, given: usize, origin: DVec3) -> Reader<'a, P> {
        Reader { points, given, origin, wrong: AtomicUsize::new(usize::MAX) }
    }

    /// A position relative to the origin.
    #[inline(always)]
    fn relative(&self, at: DVec3) -> DVec3 {
        if P::WIDE { at - self.origin } else { at }
    }

    /// A position in f32, relative to the origin.
    #[inline(always)]
    fn read(&self, point: usize, key: usize) -> [f32; 3] {
        let at = self.points.position(point, key);
        self.note(at, point, key);
        self.relative(at).as_vec3().to_array()
    }

    /// A position as it is given.
    #[inline(always)]
    fn read_double(&self, point: usize, key: usize) -> DVec3 {
        let at = self.points.position(point, key);
        self.note(at, point, key);
        at
    }

    /// Remembers a position if it is wrong.
    #[inline(always)]
    fn note(&self, at: DVec3, point: usize, key: usize) {
        if !(fits(self.relative(at)) && (!P::WIDE || is_in_space(at))) {
            self.wrong.fetch_min(point * self.given + key, Ordering::Relaxed);
        }
    }

    /// The positions of all points at the keys that are kept, those of a point side by side.
    ///
    /// Of the others none is wrong: what is on a line between those is neither infinite, nor larger than both but for rounding.
    fn copy<T: Copy + Send>(&self, len: usize, keys: usize, read: impl Fn(usize, usize) -> T + Sync) -> Vec<T> {
        let step = if keys > 1 { (self.given - 1) / (keys - 1) } else { 0 };
        if keys == 2 {
            let mut pairs = huge_vec(len);
            fill(&mut pairs, len, |point| [read(point, 0), read(point, step)]);
            return pairs.into_flattened();
        }
        if keys == 1 {
            let mut positions = huge_vec(len);
            fill(&mut positions, len, |point| read(point, 0));
            return positions;
        }
        let mut positions = huge_vec(len * keys);
        fill(&mut positions, len * keys, |i| read(i / keys, i % keys * step));
        positions
    }

    /// An error for the first wrong position.
    fn finish(self) -> Result<(), PointError> {
        let wrong = self.wrong.load(Ordering::Relaxed);
        if wrong == usize::MAX {
            return Ok(());
        }
        let (point, key) = (wrong / self.given, wrong % self.given);
        // A set that answers differently when asked again is wrong all the same.
        let at = self.points.position(point, key);
        checked(self.relative(at), point, key)?;
        Err(if is_in_space(at) { PointError::NonFinite { point, key } } else { PointError::TooLarge { point, key } })
    }
}

/// The number of keys that are kept of the given ones. (Static points of two keys are found later, one by one.)
fn kept_of(len: usize, given: usize, ulp: f64, at: impl Fn(usize, usize) -> [f64; 3] + Sync) -> usize {
    if given <= 2 || len == 0 {
        return given;
    }
    kept_keys(given, len, ulp, |key, of, out| {
        of.zip(out.as_chunks_mut().0).for_each(|(point, out)| *out = at(point, key));
    })
}

/// Whether a position, wherever its set lies, is as near to zero as those of meshes: no number in the tree overflows.
#[inline(always)]
fn is_in_space(at: DVec3) -> bool {
    at.abs().cmple(DVec3::splat(MAX_COORDINATE)).all()
}

/// Whether a position is finite and not too large.
#[inline(always)]
fn fits(at: DVec3) -> bool {
    // Also false for NaN.
    at.abs().cmple(DVec3::splat(MAX_POINT_COORDINATE)).all()
}

/// A position, if it is finite and not too large.
#[inline(always)]
pub(in crate::point) fn checked(at: DVec3, point: usize, key: usize) -> Result<DVec3, PointError> {
    if fits(at) {
        return Ok(at);
    }
    Err(if at.is_finite() { PointError::TooLarge { point, key } } else { PointError::NonFinite { point, key } })
}
