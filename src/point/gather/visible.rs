//! The inverse of a gather: a tree over visible points, in which photons find the points they contribute to.
//!
//! The picture to have in mind: each visible point is a ball in space at a time, with a radius of its own. The boxes of
//! the tree are around the balls, so a photon enters a box only if it lies in it, and its window reaches the times in
//! it. When radii shrink between passes the order of the tree is kept and its boxes are refitted.
//!
//! **Why no point is missed.** A photon contributes if `(dx·dx + dy·dy) + dz·dz <= r·r`, each step rounded once.
//! Rounding is monotone, so each rounded square alone is at most the rounded r·r: with u = 2^-24, |dx| is at most
//! r (1 + 2u) if nothing underflows and p − x at most that times (1 + u). The boxes are around balls grown by 8u of their
//! radius, rounded once. Their ends are rounded to nearest, which is monotone: the photon's coordinate is a float and not
//! beyond the end, so it is not beyond the rounded end. Squares that underflow add at most 2^-75 to |dx|: if r is less than
//! that, r·r is 0 and dx·dx at most 2^-150; otherwise dx·dx exceeds r·r by at most 2^-149, which is 2r·2^-75 at most. The
//! square of a gap of 2^-75 is 0, so such a photon is in the box too.

use super::error::GatherError;
use super::params::GatherParams;
use super::query::{check_position, check_radius, check_window};
use super::span_order::{Item, Queries, RADIUS, TIME};
use super::span_tree::{Span, SpanBlock, SpanNode, SpanTree, around};
use super::span_view::{Measure, SpanView};
use crate::parallel;
use crate::point::layout::view::{LeafView, Target, outside, rows, squared};
use crate::point::queries::batch::morton_order;
use crate::point::queries::buffer::NeighborBuffer;
use crate::point::search::KeepAll;
use crate::point::search::candidates::Candidates;
use crate::point::search::radius::within;
use crate::point::search::sinks::Gather;
use crate::progress::{Callback, Progress};
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch};
use core::ops::ControlFlow;
use glam::Vec3;

/// A point that a camera sees at a time, and the radius within which photons contribute to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisiblePoint {
    /// Its position.
    pub position: Vec3,
    /// The time of the camera's ray, in the shutter.
    pub time: f32,
    /// Photons count up to this distance (squared distance at most `radius * radius`, in f32).
    pub radius: f32,
}

/// Sixteen visible points in rows.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct VisibleBlock {
    at: [Lanes<f32>; 3],
    time: Lanes<f32>,
    radius: Lanes<f32>,
    id: Lanes<u32>,
}

impl SpanBlock for VisibleBlock {
    const EMPTY: VisibleBlock = VisibleBlock {
        at: [[f32::INFINITY; LANES]; 3],
        time: [f32::MAX; LANES],
        radius: [0.0; LANES],
        id: [u32::MAX; LANES],
    };

    fn span(&self) -> Span {
        around((0..LANES).filter(|&lane| self.id[lane] != u32::MAX).map(|lane| {
            let (time, reach) = (self.time[lane], self.radius[lane] * (1.0 + GROWN));
            let lo = [0, 1, 2].map(|axis| self.at[axis][lane] - reach);
            let hi = [0, 1, 2].map(|axis| self.at[axis][lane] + reach);
            [[lo[0], lo[1], lo[2], time], [hi[0], hi[1], hi[2], time]]
        }))
    }

    #[inline(always)]
    fn ids(&self) -> &Lanes<u32> {
        &self.id
    }
}

/// The padding of balls relative to their radius: 2^-21.
const GROWN: f32 = 1.0 / 2_097_152.0;

/// Visible points, to be found by photons.
///
/// ```
/// use mbkd::glam::Vec3;
/// use mbkd::point::{GatherParams, NeighborBuffer, VisiblePoint, VisiblePoints};
/// let seen = [0.2, 0.8].map(|time| VisiblePoint { position: Vec3::ZERO, time, radius: 0.5 });
/// let mut points = VisiblePoints::build(&seen, &GatherParams::default())?;
/// // How many photons each point has got.
/// let mut counts = [0; 2];
/// let photons = [(Vec3::X * 0.4, 0.25f32), (Vec3::X * 0.1, 0.75)];
/// points.scatter(&photons, |p| *p, 0.1, &mut counts, |count, _, _| *count += 1)?;
/// assert_eq!(counts, [1, 1]);
/// points.set_radii(&[0.3, 0.3])?;
/// points.scatter(&photons, |p| *p, 0.1, &mut counts, |count, _, _| *count += 1)?;
/// assert_eq!(counts, [1, 2]);
/// # Ok::<(), mbkd::point::GatherError>(())
/// ```
#[derive(Clone)]
pub struct VisiblePoints {
    tree: SpanTree<VisibleBlock>,
    simd: SimdLevel,
}

/// The approximate fraction of a build that reading the points takes.
const READING: f64 = 0.1;

/// The greatest number of photons that one thread processes at a time.
const CHUNK: usize = 4096;

/// About how many hits are kept at once.
const MOST_HITS: usize = 1 << 22;

/// How many photons a thread processes at a time after so many at a time had some hits together: as many as would have the limited
/// number of hits, if the next have as many each.
fn next_chunk(chunk: usize, hits: usize) -> usize {
    let next = chunk as u64 * MOST_HITS as u64 / hits.max(1) as u64;
    next.clamp(1, 8 * chunk as u64).min(CHUNK as u64) as usize
}

/// A photon that found a point.
#[derive(Clone, Copy)]
struct Hit {
    point: u32,
    photon: u32,
    distance_squared: f32,
}

impl VisiblePoints {
    /// Builds the tree: O(n log n) time, about 27 bytes per point.
    ///
    /// # Errors
    /// Positions, times and radii that are not finite or out of range, with the index of the point; parameters out of range.
    pub fn build(points: &[VisiblePoint], params: &GatherParams) -> Result<VisiblePoints, GatherError> {
        VisiblePoints::build_reporting(points, params, &Progress::new(None))
    }

    /// [`VisiblePoints::build`] that calls `progress` with the finished fraction, as
    /// [`PointTree::build_with_progress`](crate::PointTree::build_with_progress) does, and is cancelled when that returns `Break`.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherError, GatherParams, VisiblePoint, VisiblePoints};
    /// let seen: Vec<_> = (0..50_000).map(|i| VisiblePoint { position: Vec3::X * i as f32, time: 0.5, radius: 2.0 }).collect();
    /// let stop = |done: f32| if done > 0.5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    /// let points = VisiblePoints::build_with_progress(&seen, &GatherParams::default(), &stop);
    /// assert_eq!(points.err(), Some(GatherError::Cancelled));
    /// ```
    ///
    /// # Errors
    /// As [`VisiblePoints::build`]; [`GatherError::Cancelled`] if `progress` broke.
    pub fn build_with_progress(
        points: &[VisiblePoint],
        params: &GatherParams,
        progress: Callback<'_>,
    ) -> Result<VisiblePoints, GatherError> {
        VisiblePoints::build_reporting(points, params, &Progress::new(Some(progress)))
    }

    fn build_reporting(
        points: &[VisiblePoint],
        params: &GatherParams,
        progress: &Progress,
    ) -> Result<VisiblePoints, GatherError> {
        params.validate()?;
        if points.len() >= u32::MAX as usize {
            return Err(GatherError::TooMany { found: points.len() });
        }
        let mut items = Vec::with_capacity(points.len());
        for (number, point) in points.iter().enumerate() {
            let at = point.position;
            check_position(at, point.time).map_err(|error| error.at(number))?;
            check_radius(point.radius).map_err(|error| error.at(number))?;
            items.push(Item { at: [at.x, at.y, at.z, point.time, point.radius], index: number as u32 });
        }
        let queries = Queries { window: params.window.min(1.0), neighbors: None };
        progress.finished(READING);
        let of_tree = progress.rest(1.0);
        let tree = SpanTree::build(&mut items, &queries, &of_tree, |block: &mut VisibleBlock, lane, item, _| {
            for axis in 0..3 {
                block.at[axis][lane] = item.at[axis];
            }
            (block.time[lane], block.radius[lane], block.id[lane]) = (item.at[TIME], item.at[RADIUS], item.index);
        });
        drop(of_tree);
        if progress.complete() { Err(GatherError::Cancelled) } else { Ok(VisiblePoints { tree, simd: params.simd }) }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.tree.count
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.tree.count == 0
    }

    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
    }

    /// Sets new radii of all points, by their index, and refits the tree: O(n), a small part of a build.
    ///
    /// The order of the tree stays that of the build, so searches are fast as long as radii shrink about alike.
    ///
    /// # Errors
    /// [`GatherError::Length`] for another number of radii; [`GatherError::At`] with the index of a radius that is negative, NaN or
    /// too large. After an error nothing has changed.
    pub fn set_radii(&mut self, radii: &[f32]) -> Result<(), GatherError> {
        if radii.len() != self.len() {
            return Err(GatherError::Length { expected: self.len(), found: radii.len() });
        }
        let mut numbered = radii.iter().enumerate();
        numbered.try_for_each(|(number, &radius)| check_radius(radius).map_err(|error| error.at(number)))?;
        self.tree.change(|block| {
            for lane in 0..LANES {
                if let Some(radius) = radii.get(block.id[lane] as usize) {
                    block.radius[lane] = *radius;
                }
            }
        });
        Ok(())
    }

    /// Calls `visit(index, squared distance)` for each point that a photon contributes to: it is within the point's radius,
    /// and its time within `window` of the point's. In no particular order.
    ///
    /// ```
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherParams, NeighborBuffer, VisiblePoint, VisiblePoints};
    /// let seen = [0.0, 0.5, 3.0].map(|x| VisiblePoint { position: Vec3::X * x, time: 0.5, radius: 1.0 });
    /// let points = VisiblePoints::build(&seen, &GatherParams::default())?;
    /// let mut found = Vec::new();
    /// points.for_each(Vec3::X * 0.25, 0.45, 0.1, &mut NeighborBuffer::new(), |point, _| found.push(point))?;
    /// found.sort();
    /// assert_eq!(found, [0, 1]);
    /// # Ok::<(), mbkd::point::GatherError>(())
    /// ```
    ///
    /// # Errors
    /// A position that is not finite or too large, a time outside the shutter, a window that is not greater than 0.
    pub fn for_each(
        &self,
        position: Vec3,
        time: f32,
        window: f32,
        buffer: &mut NeighborBuffer,
        mut visit: impl FnMut(u32, f32),
    ) -> Result<(), GatherError> {
        check_position(position, time)?;
        check_window(window)?;
        let NeighborBuffer { candidates, .. } = buffer;
        self.find(position, time, window, candidates);
        candidates.pairs().for_each(|(id, distance)| visit(id, distance));
        Ok(())
    }

    /// Distributes photons to the points they contribute to: `deposit(state of the point, photon, squared distance)`, on
    /// several threads. `at` gives the position and the time of a photon; `states` has one state for each point.
    ///
    /// Each point gets its photons in an order that depends on the photons alone, so sums have the same bits for any number of
    /// threads and instruction set. On several threads about four million pairs of a point and a photon are in memory at once, 12
    /// bytes each, where photons have about as many points as those that came before them, and those of four photons for each
    /// thread at least.
    ///
    /// # Errors
    /// [`GatherError::At`] with the index of a photon whose position or time is wrong; [`GatherError::Length`] for another number
    /// of states; [`GatherError::TooMany`] beyond 2^32 photons; a window that is not greater than 0. After an error nothing was
    /// deposited.
    pub fn scatter<P: Sync, A: Send>(
        &self,
        photons: &[P],
        at: impl Fn(&P) -> (Vec3, f32) + Sync,
        window: f32,
        states: &mut [A],
        deposit: impl Fn(&mut A, &P, f32) + Sync,
    ) -> Result<(), GatherError> {
        check_window(window)?;
        if states.len() != self.len() {
            return Err(GatherError::Length { expected: self.len(), found: states.len() });
        }
        if photons.len() > u32::MAX as usize {
            return Err(GatherError::TooMany { found: photons.len() });
        }
        let mut positions = Vec::with_capacity(photons.len());
        for (number, photon) in photons.iter().enumerate() {
            let (position, time) = at(photon);
            check_position(position, time).map_err(|error| error.at(number))?;
            positions.push(position);
        }
        let order = morton_order(&positions);
        drop(positions);
        let threads = parallel::threads();
        if threads == 1 {
            let candidates = &mut Candidates::default();
            for &photon in &order {
                let (position, time) = at(&photons[photon]);
                self.find(position, time, window, candidates);
                for (id, distance) in candidates.pairs() {
                    deposit(&mut states[id as usize], &photons[photon], distance);
                }
            }
            return Ok(());
        }
        let share = states.len().div_ceil(threads).max(1);
        let (mut rest, mut chunk) = (&order[..], 1);
        while !rest.is_empty() {
            let wave;
            (wave, rest) = rest.split_at(rest.len().min(4 * threads * chunk));
            let chunks: Vec<&[usize]> = wave.chunks(chunk).collect();
            let lists = parallel::map(chunks.len(), |i| self.hits(photons, &at, window, chunks[i]));
            chunk = next_chunk(chunk, lists.iter().map(Vec::len).sum());
            let mut shares: Vec<(usize, &mut [A])> = states.chunks_mut(share).enumerate().collect();
            parallel::each(&mut shares, |(number, states)| {
                let begin = (*number * share) as u32;
                for hit in lists.iter().flatten() {
                    // For points before this share the difference wraps around to a large number.
                    if let Some(state) = states.get_mut(hit.point.wrapping_sub(begin) as usize) {
                        deposit(state, &photons[hit.photon as usize], hit.distance_squared);
                    }
                }
            });
        }
        Ok(())
    }

    /// The points that some photons contribute to.
    fn hits<P>(&self, photons: &[P], at: &impl Fn(&P) -> (Vec3, f32), window: f32, some: &[usize]) -> Vec<Hit> {
        let (mut hits, candidates) = (Vec::new(), &mut Candidates::default());
        for &photon in some {
            let (position, time) = at(&photons[photon]);
            self.find(position, time, window, candidates);
            let photon = photon as u32;
            hits.extend(candidates.pairs().map(|(point, distance_squared)| Hit { point, photon, distance_squared }));
        }
        hits
    }

    fn find(&self, position: Vec3, time: f32, window: f32, candidates: &mut Candidates) {
        candidates.count = 0;
        if !self.is_empty() {
            let view = SpanView { tree: &self.tree, time, measure: Contribution { window } };
            dispatch(self.simd, Found { view, position, candidates });
        }
    }
}

impl core::fmt::Debug for VisiblePoints {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("VisiblePoints").field("len", &self.len()).finish_non_exhaustive()
    }
}

struct Found<'a, 'b> {
    view: SpanView<'a, VisibleBlock, Contribution>,
    position: Vec3,
    candidates: &'b mut Candidates,
}

impl Kernel for Found<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Found { view, position, candidates } = self;
        let mut sink = Gather { candidates, keep: &KeepAll };
        // A sink that never breaks.
        let _: ControlFlow<()> = within(s, &view, &view.target(s, position), f32::MAX, &mut sink);
    }
}

/// The measure of a photon with half the width of its window: points that it does not contribute to are infinitely far
/// away.
#[derive(Clone, Copy)]
struct Contribution {
    window: f32,
}

impl Measure<VisibleBlock> for Contribution {
    /// Not used: there is no k-nearest search with this measure.
    const BALL: f32 = 1.0;

    #[inline(always)]
    fn distances<S: Simd>(&self, s: S, target: &Target<S>, block: &VisibleBlock) -> S::F {
        let [x, y, z] = rows(s, &block.at);
        let distance = squared::<S>(x - target.point[0], y - target.point[1], z - target.point[2]);
        let (radius, time) = (s.load(&block.radius), s.load(&block.time));
        let late = s.max(time - target.time, target.time - time);
        let hit = s.le(distance, radius * radius) & s.le(late, s.splat(self.window));
        s.select(hit, distance, s.splat(f32::INFINITY))
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: &SpanNode) -> (S::F, Mask) {
        let (lo, hi) = node.in_space(s);
        let (gap, _) = outside(s, &target.point, lo, hi);
        let (begin, end) = node.in_time(s);
        let late = s.max_with_zero(begin - target.time, target.time - end);
        let inside = s.le(gap, s.splat(0.0)) & s.le(late, s.splat(self.window));
        (s.select(inside, s.splat(0.0), s.splat(f32::INFINITY)), inside)
    }
    #[inline(always)]
    fn sizes<S: Simd>(&self, _: S, _: &Target<S>, _: &SpanNode, in_space: S::F) -> S::F {
        in_space
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_follow_the_hits_of_those_before() {
        assert_eq!(next_chunk(1, 0), 8, "they grow by eight at most");
        assert_eq!(next_chunk(512, 10), CHUNK);
        assert_eq!(next_chunk(CHUNK, MOST_HITS), CHUNK);
        assert_eq!(next_chunk(100, 10 * MOST_HITS), 10);
        assert_eq!(next_chunk(3, 1000 * MOST_HITS), 1);
    }
}
