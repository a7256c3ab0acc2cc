//! The query of a gather.

use super::error::GatherError;
use super::kernel::Kernel;
use crate::limits::{MAX_POINT_COORDINATE, is_in_range};
use core::fmt;
use glam::Vec3;

/// A gather in preparation: position, normal, time; number of photons, radius, filters, and kernels. Give it a number of
/// photons ([`GatherQuery::nearest`]), a radius, or both.
///
/// ```
/// use mbkd::glam::Vec3;
/// use mbkd::point::{GatherQuery, Kernel};
/// let query = GatherQuery::new(Vec3::ZERO, Vec3::Z, 0.5)
///     .nearest(50)
///     .radius(0.1)
///     .window(0.02)
///     .cosine(0.7)
///     .thickness(0.01)
///     .kernels(Kernel::Epanechnikov, Kernel::Cone);
/// # let _ = query;
/// ```
#[derive(Clone, Copy)]
#[must_use = "a query does nothing until it is passed to a map"]
pub struct GatherQuery<'f> {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    pub(super) time: f32,
    pub(super) neighbors: Option<usize>,
    pub(super) radius: f32,
    pub(super) window: Option<f32>,
    pub(super) cosine: Option<f32>,
    pub(super) thickness: Option<f32>,
    pub(super) space_kernel: Kernel,
    pub(super) time_kernel: Kernel,
    pub(super) in_volume: bool,
    pub(super) filter: Option<&'f (dyn Fn(u32) -> bool + Sync)>,
}

impl<'f> GatherQuery<'f> {
    /// A gather at a position with a unit normal, at a time of the shutter. By default it takes photons of all normals and, if none
    /// is carried along ([`PhotonTime::Carried`](crate::point::PhotonTime::Carried)), of all times, otherwise those in the widest
    /// window that the map allows; and weights them equally.
    pub fn new(position: Vec3, normal: Vec3, time: f32) -> GatherQuery<'f> {
        GatherQuery {
            position,
            normal,
            time,
            neighbors: None,
            radius: f32::INFINITY,
            window: None,
            cosine: None,
            thickness: None,
            space_kernel: Kernel::Box,
            time_kernel: Kernel::Box,
            in_volume: false,
            filter: None,
        }
    }

    /// The `k` nearest of the photons that pass all tests. The radius of the estimate is the distance of the next one
    /// after them.
    pub fn nearest(self, k: usize) -> Self {
        GatherQuery { neighbors: Some(k), ..self }
    }

    /// No photons farther than this (squared distance at most `radius * radius`, in f32).
    pub fn radius(self, radius: f32) -> Self {
        GatherQuery { radius, ..self }
    }

    /// Half width of the window in time: photons stamped at s count if `|s - time| <= window` (in f32). If it is
    /// infinite, time is ignored. A map with photons that are carried along has a widest window:
    /// [`GatherParams::window`](crate::point::GatherParams::window).
    pub fn window(self, window: f32) -> Self {
        GatherQuery { window: Some(window), ..self }
    }

    /// Only photons whose normal has at least this cosine with the query's.
    pub fn cosine(self, least: f32) -> Self {
        GatherQuery { cosine: Some(least), ..self }
    }

    /// Only photons in a disc of this half thickness: `|(photon - position) · normal| <= most`.
    pub fn thickness(self, most: f32) -> Self {
        GatherQuery { thickness: Some(most), ..self }
    }

    /// The kernels that weight photons by distance in space and in time.
    pub fn kernels(self, space: Kernel, time: Kernel) -> Self {
        GatherQuery { space_kernel: space, time_kernel: time, ..self }
    }

    /// Estimates the density in a volume, as in smoke: flux per volume and time, over the ball of the radius instead of its disc.
    /// The normal then matters to [`GatherQuery::cosine`] and [`GatherQuery::thickness`] only. Weights are f32: those in balls with
    /// a radius of more than some 1e12 are denormal, of more than some 1e15 zero.
    ///
    /// After H. W. Jensen and P. H. Christensen, "Efficient Simulation of Light Transport in Scenes with Participating Media Using
    /// Photon Maps" (1998), section 3.
    ///
    /// ```
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap};
    /// // A cube of 20³ photons, 0.1 apart: 1000 of them in each unit of volume.
    /// let at = |i: u32| Vec3::new((i % 20) as f32, (i / 20 % 20) as f32, (i / 400) as f32) * 0.1;
    /// let photons: Vec<_> = (0..8000).map(|i| Photon::at_time(at(i), Vec3::Z, 1.0f32, 0.5)).collect();
    /// let map = PhotonMap::build(&photons, &GatherParams::default())?;
    /// let query = GatherQuery::new(Vec3::splat(1.03), Vec3::Z, 0.5).nearest(400).in_volume();
    /// let density = map.gather(&query, &mut NeighborBuffer::new())?.density;
    /// assert!((density / 1000.0 - 1.0).abs() < 0.03);
    /// # Ok::<(), mbkd::point::GatherError>(())
    /// ```
    pub fn in_volume(self) -> Self {
        GatherQuery { in_volume: true, ..self }
    }

    /// The integral of the weights in space over the disc of a radius, or over its ball.
    pub(super) fn extent(&self, radius: f32) -> f64 {
        if self.in_volume {
            self.space_kernel.over_ball(radius.into())
        } else {
            self.space_kernel.over_disc(radius.into())
        }
    }

    /// Only photons whose index among those that the map was built from the predicate returns true for. It must be
    /// pure: it may be called more than once, or never.
    pub fn filter(self, predicate: &'f (dyn Fn(u32) -> bool + Sync)) -> Self {
        GatherQuery { filter: Some(predicate), ..self }
    }

    /// An error for the first parameter that is out of range, as [`PhotonMap::gather`](super::map::PhotonMap::gather) returns it.
    ///
    /// ```
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherError, GatherQuery};
    /// let query = GatherQuery::new(Vec3::ZERO, Vec3::Z, 0.5).nearest(8);
    /// assert_eq!(query.check(), Ok(()));
    /// assert_eq!(query.radius(-1.0).check(), Err(GatherError::Radius));
    /// ```
    ///
    /// # Errors
    /// Of positions and times, windows, radii, numbers of neighbours, cutoffs and normals.
    pub fn check(&self) -> Result<(), GatherError> {
        let fine = |fine: bool, error| if fine { Ok(()) } else { Err(error) };
        check_position(self.position, self.time)?;
        self.window.map_or(Ok(()), check_window)?;
        if self.radius != f32::INFINITY {
            check_radius(self.radius)?;
        }
        fine(self.neighbors != Some(0), GatherError::NoNeighbors)?;
        fine(self.neighbors.is_some() || self.radius < f32::INFINITY, GatherError::Unbounded)?;
        fine(self.cosine.is_none_or(|c| !c.is_nan()), GatherError::Cutoff)?;
        fine(self.thickness.is_none_or(|t| t >= 0.0), GatherError::Cutoff)?;
        let used = self.cosine.is_some() || self.thickness.is_some();
        fine(!used || (self.normal.length_squared() - 1.0).abs() < 0.01, GatherError::Normal)
    }

    /// Whether photons have to be tested one by one.
    pub(super) fn has_filter(&self) -> bool {
        self.cosine.is_some() || self.thickness.is_some() || self.filter.is_some()
    }

    /// Whether a photon with this normal and position passes.
    #[inline(always)]
    pub(super) fn accepts(&self, normal: impl FnOnce() -> Vec3, position: impl FnOnce() -> Vec3) -> bool {
        self.cosine.is_none_or(|least| normal().dot(self.normal) >= least)
            && self.thickness.is_none_or(|most| (position() - self.position).dot(self.normal).abs() <= most)
    }
}

/// An error if a radius is negative, NaN or too large.
pub(super) fn check_radius(radius: f32) -> Result<(), GatherError> {
    if (0.0..=MAX_POINT_COORDINATE as f32).contains(&radius) { Ok(()) } else { Err(GatherError::Radius) }
}

/// An error unless the half width of a window is greater than 0.
pub(super) fn check_window(window: f32) -> Result<(), GatherError> {
    if window > 0.0 { Ok(()) } else { Err(GatherError::Window) }
}

/// An error if a position is too far away or a time outside the shutter.
pub(super) fn check_position(position: Vec3, time: f32) -> Result<(), GatherError> {
    if !is_in_range(position) {
        return Err(GatherError::Position);
    }
    if (0.0..=1.0).contains(&time) { Ok(()) } else { Err(GatherError::Time) }
}

impl fmt::Debug for GatherQuery<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GatherQuery")
            .field("position", &self.position)
            .field("normal", &self.normal)
            .field("time", &self.time)
            .field("neighbors", &self.neighbors)
            .field("radius", &self.radius)
            .field("window", &self.window)
            .finish_non_exhaustive()
    }
}
