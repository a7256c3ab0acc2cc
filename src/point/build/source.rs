//! Reading a set of points: everything that can be wrong with it is checked here, and only here.

use crate::geometry::TimeInterval;
use crate::limits::{MAX_KEYS, MAX_POINT_COORDINATE};
use crate::parallel::{self, CHUNK};
use crate::point::error::PointError;
use crate::point::layout::static_tree::StaticTree;
use crate::point::leaf_order::moving_reference::{MovingReference, TimeSlice};
use crate::point::leaf_order::point_rows::PointRows;
use crate::primitive::{DOUBLE, PointSet, SINGLE, kept_keys};
use crate::progress::Progress;
use crate::simd::{Item, PointBlock, huge_vec, prefetch};
use core::sync::atomic::{AtomicUsize, Ordering};
use glam::DVec3;

/// A set as it was read: each position, active interval and id once, so that a set which contradicts itself can not make the build
/// contradict itself.
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
    exact: Vec<DVec3>,
    /// Active intervals; empty if all points exist throughout the shutter.
    active: Vec<TimeInterval>,
    /// Ids; empty where they are the indices.
    ids: Vec<u32>,
}

impl Source {
    /// Reads a set and checks everything that can be wrong with it. If it is said to `round_to_f32`, f64 positions are
    /// dropped.
    pub(in crate::point) fn read<P: PointSet + ?Sized>(points: &P, round_to_f32: bool) -> Result<Source, PointError> {
        let (len, keys) = sizes(points)?;
        Source::of(points, (len, keys), false, round_to_f32)
    }

    /// The same; `not_plain` if it is known that active intervals or ids have to be read.
    fn of<P: PointSet + ?Sized>(
        points: &P,
        (len, keys): (usize, usize),
        not_plain: bool,
        round_to_f32: bool,
    ) -> Result<Source, PointError> {
        let (mut keys, origin, mut positions, mut exact) = match P::WIDE {
            true => relative(points, len, keys)?,
            false => narrow(points, len, keys)?,
        };
        let plain = !not_plain && is_plain(points, len);
        let rounded = |exact: &[DVec3]| exact.iter().map(|at| (*at - origin).as_vec3().to_array()).collect();
        if round_to_f32 && !exact.is_empty() {
            positions = rounded(&exact);
            exact = Vec::new();
        }
        if P::WIDE && exact.is_empty() {
            keys = merge_keys(&mut positions, (len, keys), SINGLE, |at| at.map(f64::from));
        } else if P::WIDE {
            keys = merge_keys(&mut exact, (len, keys), DOUBLE, |at| at.to_array());
        }
        if !exact.is_empty() && (keys > 1 || !plain) {
            positions = rounded(&exact);
        }
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
        Ok(Source { len, keys, origin, positions, exact, active, ids })
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
    pub(in crate::point) fn exact(&self, point: usize, key: usize) -> DVec3 {
        self.exact[point * self.keys + key]
    }

    /// Whether the set needs f64.
    pub(in crate::point) fn is_precise(&self) -> bool {
        !self.exact.is_empty()
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
        if self.is_precise() {
            let first = self.exact(point, 0);
            return (1..self.keys).all(|key| self.exact(point, key) == first);
        }
        let all = &self.positions[point * self.keys..][..self.keys];
        all.iter().all(|at| *at == all[0])
    }

    /// Which points are static.
    pub(in crate::point) fn static_points(&self) -> Vec<bool> {
        if self.all_static() {
            return vec![true; self.len];
        }
        // The most common case, in a loop without branches.
        if self.keys == 2 && self.all_persist() && !self.is_precise() {
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

    /// The references to some of the points during a time slice.
    pub(in crate::point) fn references(
        &self,
        slice: &TimeSlice,
        select: impl Iterator<Item = usize>,
        id: impl Fn(usize) -> u32,
    ) -> Vec<MovingReference> {
        let later = (slice.segment + 1).min(slice.keys - 1);
        // Room for all: what is not used is never touched.
        let mut references = huge_vec(select.size_hint().1.unwrap_or(0));
        references.extend(select.filter_map(|i| {
            let active = self.active(i);
            let interval = active.intersect(slice.interval)?;
            let (open, close) = (self.at(i, slice.segment), self.at(i, later));
            Some(MovingReference { open, close, interval, active, id: id(i), fast: false })
        }));
        references
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
    pub(in crate::point) fn read<P: PointSet + ?Sized>(points: &P, round_to_f32: bool) -> Result<Input, PointError> {
        let (len, keys) = sizes(points)?;
        let may_be_static = !P::WIDE && keys == 1;
        if !(may_be_static && is_plain(points, len)) {
            return Source::of(points, (len, keys), may_be_static, round_to_f32).map(Input::Other);
        }
        let (mut blocks, reader) = (StaticTree::room(len), Reader::new(points, keys));
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
    let all = parallel::chunks(len, |range| range.fold(true, |all, point| all & plain(point)));
    all.into_iter().all(|plain| plain)
}

/// Reads f32 positions and remembers the first that is wrong, so that the loop which reads is as fast as a copy.
struct Reader<'a, P: ?Sized> {
    points: &'a P,
    keys: usize,
    /// Number of the first wrong position, where those of a point are numbered one behind the other.
    wrong: AtomicUsize,
}

impl<'a, P: PointSet + ?Sized> Reader<'a, P> {
    fn new(points: &'a P, keys: usize) -> Reader<'a, P> {
        Reader { points, keys, wrong: AtomicUsize::new(usize::MAX) }
    }

    #[inline(always)]
    fn read(&self, point: usize, key: usize) -> [f32; 3] {
        let at = self.points.position(point, key);
        if !fits(at) {
            self.wrong.fetch_min(point * self.keys + key, Ordering::Relaxed);
        }
        at.as_vec3().to_array()
    }

    /// An error for the first wrong position.
    fn finish(self) -> Result<(), PointError> {
        let wrong = self.wrong.into_inner();
        if wrong == usize::MAX {
            return Ok(());
        }
        let (point, key) = (wrong / self.keys, wrong % self.keys);
        // A set that answers differently when asked again is wrong all the same.
        checked(self.points.position(point, key), point, key)?;
        Err(PointError::NonFinite { point, key })
    }
}

/// The number of keys, the origin, positions relative to it, and positions in f64 where these say more.
type Read = (usize, DVec3, Vec<[f32; 3]>, Vec<DVec3>);

/// Positions of a set of f32 ones, bit for bit, at the keys that are not on straight lines between others.
///
/// Of the others none is wrong: what is on such a line is neither NaN nor infinite, nor larger than both ends but for rounding.
fn narrow<P: PointSet + ?Sized>(points: &P, len: usize, given: usize) -> Result<Read, PointError> {
    let keys = kept_of(len, given, SINGLE, |point, key| points.position(point, key).to_array());
    let (reader, step) = (Reader::new(points, given), step(given, keys));
    let positions = if keys == 2 {
        let mut pairs = huge_vec(len);
        parallel::fill(&mut pairs, len, |point| [reader.read(point, 0), reader.read(point, step)]);
        pairs.into_flattened()
    } else {
        let mut positions = huge_vec(len * keys);
        parallel::fill(&mut positions, len * keys, |i| reader.read(i / keys, i % keys * step));
        positions
    };
    reader.finish()?;
    Ok((keys, DVec3::ZERO, positions, Vec::new()))
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

/// How many given segments between keys become one.
fn step(given: usize, kept: usize) -> usize {
    if kept > 1 { (given - 1) / (kept - 1) } else { 0 }
}

/// Positions of a set of f64 ones relative to their middle, and as they were given. Where all are f32 numbers around zero,
/// they are taken as such; otherwise relative positions are left to the caller, who may need none.
fn relative<P: PointSet + ?Sized>(points: &P, len: usize, keys: usize) -> Result<Read, PointError> {
    let mut wide = Vec::with_capacity(len * keys);
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for point in 0..len {
        for key in 0..keys {
            let at = points.position(point, key);
            if !at.is_finite() {
                return Err(PointError::NonFinite { point, key });
            }
            (lo, hi) = (lo.min(at), hi.max(at));
            wide.push(at);
        }
    }
    let single = |at: &DVec3| at.as_vec3().as_dvec3() == *at;
    // Where zero is far from the set, query points would lose more by being f32 numbers than relative to its middle.
    let around_zero = lo.cmple(DVec3::ZERO).all() && hi.cmpge(DVec3::ZERO).all();
    if wide.is_empty() || (around_zero && wide.iter().all(single)) {
        return Ok((keys, DVec3::ZERO, narrow_of(&wide, keys)?, Vec::new()));
    }
    let origin = lo * 0.5 + hi * 0.5;
    // Subtraction and rounding are monotone, so all others fit between these.
    if !(fits(lo - origin) && fits(hi - origin)) {
        wide.iter().enumerate().try_for_each(|(i, at)| checked(*at - origin, i / keys, i % keys).map(|_| ()))?;
    }
    Ok((keys, origin, Vec::new(), wide))
}

/// Drops keys on the straight lines between others, of positions that are rounded by `ulp`; returns how many are kept.
fn merge_keys<P: Copy + Sync>(
    positions: &mut Vec<P>,
    (len, keys): (usize, usize),
    ulp: f64,
    coordinates: impl Fn(P) -> [f64; 3] + Sync,
) -> usize {
    let kept = kept_of(len, keys, ulp, |point, key| coordinates(positions[point * keys + key]));
    if kept == keys {
        return keys;
    }
    let step = step(keys, kept);
    // A position is never written before it was read.
    for i in 0..kept * len {
        positions[i] = positions[i / kept * keys + i % kept * step];
    }
    positions.truncate(kept * len);
    positions.shrink_to_fit();
    kept
}

/// f64 positions that are f32 numbers.
fn narrow_of(wide: &[DVec3], keys: usize) -> Result<Vec<[f32; 3]>, PointError> {
    let position = |(i, at): (usize, &DVec3)| Ok(checked(*at, i / keys, i % keys)?.as_vec3().to_array());
    wide.iter().enumerate().map(position).collect()
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
