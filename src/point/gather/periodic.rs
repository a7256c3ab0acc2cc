//! Gathers in space that repeats along some axes: periodic boxes.
//!
//! A gather finds its photons from the images of its position, the nearest image first, by the searches of open space. What it
//! makes of them is the same as there.

use super::error::GatherError;
use super::map::{Gathered, PhotonMap, batch};
use super::photon::Flux;
use super::query::GatherQuery;
use crate::point::queries::buffer::NeighborBuffer;
use crate::point::queries::images::Images;
use crate::point::queries::periodic::{PeriodError, images_in_box};
use core::fmt;

/// The photons of a map in space that repeats along some axes; made by [`PhotonMap::periodic`].
pub struct PeriodicPhotons<'a, F> {
    map: &'a PhotonMap<F>,
    images: Images,
}

impl<F: Flux> PhotonMap<F> {
    /// The photons in space that repeats along some axes, with these lengths: a periodic box, as
    /// [`PointTree::periodic`](crate::PointTree::periodic) has it.
    ///
    /// ```
    /// use mbkd::glam::Vec3;
    /// use mbkd::point::{GatherParams, GatherQuery, NeighborBuffer, Photon, PhotonMap};
    /// let photons = [0.1, 0.6].map(|x| Photon::at_time(Vec3::X * x, Vec3::Z, 1.0f32, 0.5));
    /// let map = PhotonMap::build(&photons, &GatherParams::default())?;
    /// // Across the face: the first photon is 0.15 away, the second 0.35.
    /// let query = GatherQuery::new(Vec3::X * 0.95, Vec3::Z, 0.5).radius(0.2);
    /// let across = map.periodic([Some(1.0), None, None])?.gather(&query, &mut NeighborBuffer::new())?;
    /// assert_eq!((across.count, map.gather(&query, &mut NeighborBuffer::new())?.count), (1, 0));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// A length that is not above zero or not finite; photons that are more than sixteen periods apart, or 2^40 from zero.
    pub fn periodic<L: Into<f64>>(&self, lengths: [Option<L>; 3]) -> Result<PeriodicPhotons<'_, F>, PeriodError> {
        let images = images_in_box(lengths.map(|length| length.map(Into::into)), self.index.bounds())?;
        Ok(PeriodicPhotons { map: self, images })
    }
}

impl<F: Flux> PeriodicPhotons<'_, F> {
    /// [`PhotonMap::gather`]. The position may be in any period.
    ///
    /// A photon is as far away as the nearest image of the position from which it passes all tests, and counts once. Images are
    /// moved by whole periods in f64 and rounded to f32; answers equal brute force over all of them, bit for bit. (A photon that is
    /// too far off the plane of the disc from the nearest images of all may pass from one farther out. Such images count up to the
    /// next beyond either face of the box around all photons.) A disc or ball wider than half a period overlaps itself: its density
    /// is less than that of the photons on it.
    ///
    /// Cost: that of a gather where the faces of the box around all photons are farther away than the disc reaches, otherwise that
    /// of one for each image within reach of a photon.
    ///
    /// # Errors
    /// As [`PhotonMap::gather`].
    pub fn gather(&self, query: &GatherQuery, buffer: &mut NeighborBuffer) -> Result<Gathered<F>, GatherError> {
        self.map.density((query, Some(&self.images)), buffer)
    }

    /// [`PhotonMap::gather_each`], with the photons that [`PeriodicPhotons::gather`] sums.
    ///
    /// # Errors
    /// As [`PhotonMap::gather_each`].
    pub fn gather_each(
        &self,
        query: &GatherQuery,
        buffer: &mut NeighborBuffer,
        mut visit: impl FnMut(u32, f32),
    ) -> Result<Gathered<F>, GatherError> {
        let ids = &self.map.index.ids;
        self.map.weigh((query, Some(&self.images)), buffer, |slot, weight| visit(ids[slot as usize], weight))
    }

    /// [`PhotonMap::gather_batch`], with the answers of [`PeriodicPhotons::gather`].
    ///
    /// # Errors
    /// As [`PhotonMap::gather_batch`].
    pub fn gather_batch(&self, queries: &[GatherQuery]) -> Result<Vec<Gathered<F>>, GatherError> {
        batch(queries, |query, buffer| self.gather(query, buffer))
    }
}

impl<F> fmt::Debug for PeriodicPhotons<'_, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PeriodicPhotons").field("map", self.map).field("images", &self.images).finish()
    }
}
