//! The photon map: flux by slot, and the density estimate.

use super::error::GatherError;
use super::index::{Index, TimeWeight};
use super::params::GatherParams;
use super::photon::{Flux, Photon};
use super::query::{GatherQuery, check_position};
use super::search::{PhotonSearch, nearest_in_metric};
use crate::geometry::KeyTime;
use crate::limits::{MAX_POINT_COORDINATE, is_in_range};
use crate::parallel;
use crate::point::neighbor::Neighbor;
use crate::point::queries::batch::{answered_in_order, morton_order};
use crate::point::queries::buffer::NeighborBuffer;
use crate::point::queries::images::Images;
use crate::point::search::{Keep, KeepAll};
use crate::progress::{Callback, Progress};
use glam::Vec3;

/// The answer of a gather.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gathered<F> {
    /// Flux per area, or per volume ([`GatherQuery::in_volume`]), and time (the whole shutter being 1). Infinite or NaN where
    /// weights, fluxes times weights or their sums exceed f32. (A weight is about 1 / (area · time): for a photon that exists for
    /// 1e-38 of the shutter, more than f32 holds unless the disc is larger than 1.)
    pub density: F,
    /// Radius of the disc, or of the ball, over which it was estimated: the query's, or the distance of the photon after the k
    /// nearest.
    pub radius: f32,
    /// Half width of the window: the query's, or without one the widest that the map allows.
    pub window: f32,
    /// The integral of the time kernel over that part of the window that is inside the shutter.
    pub duration: f32,
    /// How many photons were summed.
    pub count: usize,
    /// Whether the wanted number was found; false for a query by radius alone.
    pub reached: bool,
}

/// Photons on surfaces, to be gathered at a time.
///
/// The density at (x, t) is estimated as in Cammarano and Jensen, "Time Dependent Photon Mapping" (2002), section 4: Σ flux ·
/// k_s(|p − x| / r) · k_t(|s − t| / w) / (A · D), where A is the integral of the space kernel over the disc of radius r (in a
/// volume over its ball: [`GatherQuery::in_volume`]), and D that of the time kernel over the part of the window that is inside the
/// shutter. A photon that exists for a while has the weight 1 / duration instead of k_t / D.
///
/// With a number k of photons, r is the distance of the (k+1)-th nearest, which is not counted itself: for a locally
/// constant density the estimate is then unbiased (Loftsgaarden and Quesenberry, 1965). If a radius is given and
/// no more than k photons lie within it, r is that radius. If none is given and the map has no more than k photons that
/// pass, the farthest of them takes the role of the (k+1)-th. A gather that finds no photons returns zero density.
///
/// Sums are taken in order of (distance, index): they have the same bits for any structure, number of threads and
/// instruction set. Distances are those of [`PointTree`](crate::PointTree); a photon that moves with its surface from
/// `position` at `time` with `velocity` moves as the point with the ends `position - velocity * time` and
/// `position + velocity * (1 - time)`.
///
/// ```
/// use mbkd::glam::Vec3;
/// use mbkd::point::{GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap};
/// // Light that sweeps along x, one unit per shutter: 40 photons per unit of time, each of flux 1 / 40.
/// let sheet = (0..40 * 40).map(|i| {
///     let (x, z) = ((i / 40) as f32 / 40.0, (i % 40) as f32 / 40.0);
///     Photon::at_time(Vec3::new(x, 0.0, z), Vec3::Y, 1.0f32 / 1600.0, x)
/// });
/// let map = PhotonMap::build(&sheet.collect::<Vec<_>>(), &GatherParams::default())?;
/// let mut buffer = NeighborBuffer::new();
/// let at = |time| GatherQuery::new(Vec3::new(0.5, 0.0, 0.5), Vec3::Y, time).radius(0.2).window(0.1);
/// assert!(map.gather(&at(0.5), &mut buffer)?.density > 1.0);
/// assert_eq!(map.gather(&at(0.1), &mut buffer)?.density, 0.0);
/// # Ok::<(), mbkd::point::GatherError>(())
/// ```
#[derive(Clone)]
pub struct PhotonMap<F> {
    pub(super) index: Index,
    /// Flux by slot.
    flux: Vec<F>,
}

/// Tests of a query beyond distance and window.
struct Accept<'a> {
    index: &'a Index,
    query: &'a GatherQuery<'a>,
    window: f32,
    at: KeyTime,
}

impl Keep for Accept<'_> {
    const FILTERS: bool = true;
    #[inline]
    fn keep(&self, slot: u32) -> bool {
        let Accept { index, query, window, at } = *self;
        if !index.in_window(slot, query.time, window) {
            return false;
        }
        query.accepts(|| index.normal(slot), || index.position(slot, at))
            && query.filter.is_none_or(|filter| filter(index.ids[slot as usize]))
    }
}

/// The disc of a density estimate.
struct Disc {
    radius: f32,
    squared: f32,
    count: usize,
    reached: bool,
}

impl GatherQuery<'_> {
    /// The squared distance up to which photons count.
    fn bound(&self) -> f32 {
        (self.radius * self.radius).min(f32::MAX)
    }

    /// How many photons are looked for: one more than wanted, whose distance is the radius of the disc.
    fn most(&self) -> Option<usize> {
        self.neighbors.map(|k| k.saturating_add(1))
    }

    /// The disc, given what was found, in order.
    fn disc(&self, found: &[Neighbor]) -> Disc {
        let (radius, bound) = (self.radius, self.bound());
        let Some(k) = self.neighbors else {
            return Disc { radius, squared: bound, count: found.len(), reached: false };
        };
        let outermost = if found.len() > k || radius == f32::INFINITY { found.last() } else { None };
        match outermost {
            Some(outermost) => {
                let (squared, count) = (outermost.distance_squared, found.len() - 1);
                Disc { radius: squared.sqrt(), squared, count, reached: count >= k }
            }
            None => Disc { radius, squared: bound, count: found.len(), reached: found.len() >= k },
        }
    }
}

impl<F: Flux> PhotonMap<F> {
    /// Builds the map of photons: O(n log n) time; about 50 bytes per photon with a time stamp and a flux of 12 bytes.
    ///
    /// An empty map gives zero density.
    ///
    /// # Errors
    /// Coordinates, normals and fluxes that are not finite, coordinates that are too large and times outside the shutter, each
    /// with the index of the photon; parameters out of range.
    pub fn build(photons: &[Photon<F>], params: &GatherParams) -> Result<PhotonMap<F>, GatherError> {
        PhotonMap::build_reporting(photons, params, &Progress::new(None))
    }

    /// [`PhotonMap::build`] that calls `progress` with the finished fraction, as
    /// [`PointTree::build_with_progress`](crate::PointTree::build_with_progress) does, and is cancelled when that returns `Break`.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherError, GatherParams, Photon, PhotonMap};
    /// let photons: Vec<_> = (0..50_000).map(|i| Photon::at_time(Vec3::X * i as f32, Vec3::Y, 1.0f32, 0.5)).collect();
    /// let stop = |done: f32| if done > 0.5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    /// let map = PhotonMap::build_with_progress(&photons, &GatherParams::default(), &stop);
    /// assert_eq!(map.err(), Some(GatherError::Cancelled));
    /// ```
    ///
    /// # Errors
    /// As [`PhotonMap::build`]; [`GatherError::Cancelled`] if `progress` broke.
    pub fn build_with_progress(
        photons: &[Photon<F>],
        params: &GatherParams,
        progress: Callback<'_>,
    ) -> Result<PhotonMap<F>, GatherError> {
        PhotonMap::build_reporting(photons, params, &Progress::new(Some(progress)))
    }

    fn build_reporting(
        photons: &[Photon<F>],
        params: &GatherParams,
        progress: &Progress,
    ) -> Result<PhotonMap<F>, GatherError> {
        if let Some(photon) = photons.iter().position(|photon| !photon.flux.is_finite()) {
            return Err(GatherError::Flux.at(photon));
        }
        let index = parallel::entered(photons.len(), || Index::build(photons, params, progress))?;
        let flux = index.ids.iter().map(|&id| photons[id as usize].flux).collect();
        if progress.complete() { Err(GatherError::Cancelled) } else { Ok(PhotonMap { index, flux }) }
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.flux.len()
    }

    /// Whether there are no photons.
    pub fn is_empty(&self) -> bool {
        self.flux.is_empty()
    }

    /// Bytes allocated.
    pub fn bytes(&self) -> usize {
        self.index.bytes() + self.flux.capacity() * size_of::<F>()
    }

    /// The density of light at a position and time.
    ///
    /// # Errors
    /// A number of the query that is out of range, a window wider than the map was built for, a disc without area or ball without
    /// volume: see [`GatherError`]. It is no error if a query finds no photons.
    pub fn gather(&self, query: &GatherQuery, buffer: &mut NeighborBuffer) -> Result<Gathered<F>, GatherError> {
        self.density((query, None), buffer)
    }

    /// Visits the photons of a gather, nearest first, ties by index: `visit(index, weight)`, where the density is
    /// the sum of the fluxes times the weights. For reflectances that depend on more than the flux.
    ///
    /// The density of the answer is zero.
    ///
    /// ```
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap};
    /// let photons = [0.3, 0.1, 0.2].map(|x| Photon::at_time(Vec3::X * x, Vec3::Z, 2.0f32, 0.5));
    /// let map = PhotonMap::build(&photons, &GatherParams::default())?;
    /// let query = GatherQuery::new(Vec3::ZERO, Vec3::Z, 0.5).radius(0.25);
    /// let (mut buffer, mut visited, mut sum) = (NeighborBuffer::new(), Vec::new(), 0.0);
    /// map.gather_each(&query, &mut buffer, |photon, weight| {
    ///     visited.push(photon);
    ///     sum += photons[photon as usize].flux * weight;
    /// })?;
    /// assert_eq!(visited, [1, 2], "the nearest first");
    /// assert_eq!(sum, map.gather(&query, &mut buffer)?.density);
    /// # Ok::<(), mbkd::point::GatherError>(())
    /// ```
    ///
    /// # Errors
    /// As [`PhotonMap::gather`]; nothing is visited then.
    pub fn gather_each(
        &self,
        query: &GatherQuery,
        buffer: &mut NeighborBuffer,
        mut visit: impl FnMut(u32, f32),
    ) -> Result<Gathered<F>, GatherError> {
        self.weigh((query, None), buffer, |slot, weight| visit(self.index.ids[slot as usize], weight))
    }

    /// A batch of gathers, on several threads: the answers of [`PhotonMap::gather`], in the order of the queries.
    ///
    /// Allocates the answers and a buffer for each 512 of them.
    ///
    /// ```
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherError, GatherParams, GatherQuery, Photon, PhotonMap};
    /// let photons = [0.1, 0.2, 0.3].map(|x| Photon::at_time(Vec3::X * x, Vec3::Z, 2.0f32, 0.5));
    /// let map = PhotonMap::build(&photons, &GatherParams::default())?;
    /// let at = |x: f32| GatherQuery::new(Vec3::X * x, Vec3::Z, 0.5).radius(0.15);
    /// let counts: Vec<usize> = map.gather_batch(&[at(0.0), at(0.2), at(9.0)])?.iter().map(|found| found.count).collect();
    /// assert_eq!(counts, [1, 3, 0]);
    /// let error = map.gather_batch(&[at(0.0), at(0.2).radius(-1.0)]).unwrap_err();
    /// assert_eq!(error, GatherError::At { index: 1, error: Box::new(GatherError::Radius) });
    /// # Ok::<(), GatherError>(())
    /// ```
    ///
    /// # Errors
    /// [`GatherError::At`] with the index of a query and its error in [`PhotonMap::gather`]. Queries with invalid numbers are
    /// found before any is answered: the error is that of the first of these, and otherwise of the first that fails.
    pub fn gather_batch(&self, queries: &[GatherQuery]) -> Result<Vec<Gathered<F>>, GatherError> {
        batch(queries, |query, buffer| self.gather(query, buffer))
    }

    /// The `k` photons nearest in a metric of space and time, `|p − position|² + (speed · (s − time))²`, in order of
    /// (distance, index); all if there are fewer. For windows that adapt to the photons.
    ///
    /// The squared distance is computed in f32 as `((dx·dx + dy·dy) + dz·dz) + dt·dt` with `dt = |s − time| · speed`.
    /// ```
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherParams, NeighborBuffer, Photon, PhotonMap};
    /// let photons = [0.5, 0.7].map(|time| Photon::at_time(Vec3::X * (0.8 - time), Vec3::Y, 1.0f32, time));
    /// let map = PhotonMap::build(&photons, &GatherParams::default())?;
    /// let mut buffer = NeighborBuffer::new();
    /// let first = map.nearest_in_space_time(Vec3::ZERO, 0.5, 0.0, 1, &mut buffer)?[0].id;
    /// assert_eq!(first, 1, "time does not count");
    /// let first = map.nearest_in_space_time(Vec3::ZERO, 0.5, 10.0, 1, &mut buffer)?[0].id;
    /// assert_eq!(first, 0, "a fifth of the shutter is as far as 2");
    /// # Ok::<(), mbkd::point::GatherError>(())
    /// ```
    ///
    /// # Errors
    /// A position, time or speed that is out of range; photons without a stamp of their own in the map.
    pub fn nearest_in_space_time<'s>(
        &self,
        position: Vec3,
        time: f32,
        speed: f32,
        k: usize,
        buffer: &'s mut NeighborBuffer,
    ) -> Result<&'s [Neighbor], GatherError> {
        check_position(position, time)?;
        if !(0.0..=MAX_POINT_COORDINATE as f32).contains(&speed) {
            return Err(GatherError::Speed);
        }
        if self.index.others.is_some() {
            return Err(GatherError::NotStamped);
        }
        buffer.found.clear();
        if k > 0 {
            let index = &self.index;
            nearest_in_metric(index, (position, time), speed, k, buffer);
            buffer.found.iter_mut().for_each(|n| n.id = index.ids[n.id as usize]);
        }
        Ok(&buffer.found)
    }

    /// The answer of a query, in space that repeats if there are images of it.
    pub(super) fn density(
        &self,
        query: (&GatherQuery, Option<&Images>),
        buffer: &mut NeighborBuffer,
    ) -> Result<Gathered<F>, GatherError> {
        let mut density = F::default();
        let gathered = self.weigh(query, buffer, |slot, weight| {
            density = density + self.flux[slot as usize] * weight;
        })?;
        Ok(Gathered { density, ..gathered })
    }

    /// Finds the photons of a query and visits their slots and weights.
    pub(super) fn weigh(
        &self,
        (query, images): (&GatherQuery, Option<&Images>),
        buffer: &mut NeighborBuffer,
        mut visit: impl FnMut(u32, f32),
    ) -> Result<Gathered<F>, GatherError> {
        query.check()?;
        let index = &self.index;
        let window = query.window.unwrap_or(index.most_window);
        if window > index.most_window {
            return Err(GatherError::WindowTooWide { most: index.most_window });
        }
        match images {
            Some(images) => find_in_images(index, images, query, window, buffer),
            None => find(index, query, (window, query.bound()), buffer),
        }
        let disc = query.disc(&buffer.found);
        let duration = query.time_kernel.over_time(query.time.into(), window.into(), 0.0, 1.0) as f32;
        let per_duration = 1.0 / duration;
        let gathered = |count| Gathered {
            density: F::default(),
            radius: disc.radius,
            window,
            duration,
            count,
            reached: disc.reached,
        };
        if disc.count == 0 {
            return Ok(gathered(0));
        }
        if !per_duration.is_finite() {
            return Err(GatherError::Window);
        }
        let per_extent = (1.0 / query.extent(disc.radius)) as f32;
        if !per_extent.is_finite() {
            return Err(GatherError::NoArea);
        }
        for near in &buffer.found[..disc.count] {
            let in_time = match index.time_weight(near.id) {
                TimeWeight::Stamp(stamp) => {
                    let x = (stamp - query.time) / window;
                    query.time_kernel.weight(x * x) * per_duration
                }
                TimeWeight::Even(even) => even,
            };
            let in_space = query.space_kernel.weight(near.distance_squared / disc.squared);
            visit(near.id, in_space * in_time * per_extent);
        }
        Ok(gathered(disc.count))
    }
}

impl<F> core::fmt::Debug for PhotonMap<F> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("PhotonMap").field("len", &self.flux.len()).finish_non_exhaustive()
    }
}

/// The answers of a batch, in the order of its queries.
pub(super) fn batch<F: Flux>(
    queries: &[GatherQuery],
    gather: impl Fn(&GatherQuery, &mut NeighborBuffer) -> Result<Gathered<F>, GatherError> + Sync,
) -> Result<Vec<Gathered<F>>, GatherError> {
    let mut numbered = queries.iter().enumerate();
    numbered.try_for_each(|(number, query)| query.check().map_err(|error| error.at(number)))?;
    let positions: Vec<Vec3> = queries.iter().map(|query| query.position).collect();
    let answers = answered_in_order(&morton_order(&positions), |indices| {
        let mut buffer = NeighborBuffer::new();
        indices.iter().map(|&index| Some(gather(&queries[index], &mut buffer))).collect()
    });
    let answers = answers.into_iter().flatten().enumerate();
    answers.map(|(number, answer)| answer.map_err(|error| error.at(number))).collect()
}

/// Finds the photons of a query in a window and within a squared distance, in order, into the buffer.
fn find(index: &Index, query: &GatherQuery, (window, bound): (f32, f32), buffer: &mut NeighborBuffer) {
    // The window of photons that move with their surface is tested by the filter only.
    if query.has_filter() || index.carried {
        let accept = Accept { index, query, window, at: KeyTime::new(query.time, 2) };
        find_kept(index, query, (window, bound), &accept, buffer);
    } else {
        find_kept(index, query, (window, bound), &KeepAll, buffer);
    }
}

fn find_kept(
    index: &Index,
    query: &GatherQuery,
    (window, bound): (f32, f32),
    keep: &impl Keep,
    buffer: &mut NeighborBuffer,
) {
    let GatherQuery { position, time, .. } = *query;
    let search = PhotonSearch::<_, false> { index, point: position, time, scale: window, keep };
    match query.most() {
        Some(most) => search.nearest(most, bound, buffer),
        None => search.within(bound, buffer),
    }
}

/// Finds the photons of a query where space repeats: each one once, where it is nearest.
fn find_in_images(index: &Index, images: &Images, query: &GatherQuery, window: f32, buffer: &mut NeighborBuffer) {
    let most = query.most().unwrap_or(usize::MAX);
    let (mut all, mut places) = (core::mem::take(&mut buffer.of_image), core::mem::take(&mut buffer.images));
    all.clear();
    images.in_order(query.position.as_dvec3(), query.bound(), &mut places, |place, bound| {
        let position = place.as_vec3();
        if is_in_range(position) {
            find(index, &GatherQuery { position, ..*query }, (window, bound), buffer);
            if all.is_empty() {
                core::mem::swap(&mut all, &mut buffer.found);
            } else {
                all.append(&mut buffer.found);
                all.sort_unstable_by_key(|near| (near.id, near.distance_squared.to_bits()));
                all.dedup_by_key(|near| near.id);
                all.sort_unstable_by_key(|near| (near.distance_squared.to_bits(), index.ids[near.id as usize]));
                all.truncate(most);
            }
        }
        all.get(most - 1).map(|last| last.distance_squared)
    });
    (buffer.of_image, buffer.images) = (core::mem::replace(&mut buffer.found, all), places);
}
