//! Density estimates over photons at a time.

use crate::arrays::{PerQuery, rows, slice, table, value_error};
use crate::parts::{Sizes, in_parts};
use crate::periods::{Periods, period_error, periods_of};
use crate::threads::{long, pool};
use mbkd::glam::Vec3;
use mbkd::point::{GatherError, GatherParams, GatherQuery, Gathered, Kernel, Photon, PhotonMap};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The numbers of gathers between two checks for Ctrl-C.
const BLOCKS: Sizes = Sizes { first: 1 << 8, most: 1 << 15 };

/// A map of photons with time stamps.
#[pyclass(frozen)]
pub struct Photons {
    map: PhotonMap<Vec3>,
    periods: Option<Periods>,
}

/// Density (m, 3), radius, and number of photons.
type Answers<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<i64>>);

#[pymethods]
impl Photons {
    #[new]
    fn new(
        py: Python<'_>,
        positions: PyReadonlyArray2<'_, f32>,
        normals: PyReadonlyArray2<'_, f32>,
        flux: PyReadonlyArray2<'_, f32>,
        times: PyReadonlyArray1<'_, f32>,
        window: f32,
        neighbors: u32,
        boxsize: [f64; 3],
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Photons> {
        let (positions, normals, flux) = (rows(&positions)?, rows(&normals)?, rows(&flux)?);
        let (times, periods) = (slice(&times)?, periods_of(boxsize)?);
        if [normals.len(), flux.len(), times.len()] != [positions.len(); 3] {
            return Err(PyValueError::new_err("positions, normals, fluxes and times must be equally many"));
        }
        let photon = |i: usize| {
            let [position, normal, flux] = [positions[i], normals[i], flux[i]].map(Vec3::from);
            Photon::at_time(position, normal, flux, times[i])
        };
        let map = long(py, workers, progress.as_ref(), |control| {
            let photons: Vec<Photon<Vec3>> = (0..positions.len()).map(photon).collect();
            let params = GatherParams { window, neighbors, ..GatherParams::default() };
            PhotonMap::build_with_progress(&photons, &params, &|done| control.report(done))
        })?;
        let map = map.map_err(value_error)?;
        if let Some(lengths) = periods {
            map.periodic(lengths).map_err(period_error)?;
        }
        Ok(Photons { map, periods })
    }

    /// The number of photons.
    #[getter]
    fn n(&self) -> usize {
        self.map.len()
    }

    /// Memory of the map in bytes.
    #[getter]
    fn nbytes(&self) -> usize {
        self.map.bytes()
    }

    /// The density of light at positions and times.
    fn gather<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArray2<'py, f32>,
        normals: PyReadonlyArray2<'py, f32>,
        times: PyReadonlyArray1<'py, f32>,
        k: Option<usize>,
        radius: f32,
        window: f32,
        cosine: Option<f32>,
        thickness: Option<f32>,
        volume: bool,
        kernels: [String; 2],
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Answers<'py>> {
        let (positions, normals) = (rows(&positions)?, rows(&normals)?);
        if normals.len() != positions.len() {
            return Err(PyValueError::new_err(format!("{} normals for {} places", normals.len(), positions.len())));
        }
        let times = PerQuery::times(slice(&times)?, positions.len())?;
        let (space, clock) = (kernel(&kernels[0])?, kernel(&kernels[1])?);
        let query = |i: usize| {
            let at = GatherQuery::new(Vec3::from(positions[i]), Vec3::from(normals[i]), times.of(i));
            let mut query = at.radius(radius).window(window).kernels(space, clock);
            query = k.map_or(query, |k| query.nearest(k));
            query = if volume { query.in_volume() } else { query };
            query = cosine.map_or(query, |cosine| query.cosine(cosine));
            thickness.map_or(query, |thickness| query.thickness(thickness))
        };
        let pool = pool(workers)?;
        let periodic = self.periods.map(|lengths| self.map.periodic(lengths)).transpose().map_err(period_error)?;
        let answers_to = |queries: &[GatherQuery<'_>]| match &periodic {
            Some(photons) => photons.gather_batch(queries),
            None => self.map.gather_batch(queries),
        };
        // All of them before any is answered, so that the error does not depend on the division into parts.
        let at = |index: usize| move |error: GatherError| GatherError::At { index, error: Box::new(error) };
        py.detach(|| (0..positions.len()).try_for_each(|i| query(i).check().map_err(at(i)))).map_err(value_error)?;
        let mut answers: Vec<Gathered<Vec3>> = Vec::with_capacity(positions.len());
        in_parts(py, positions.len(), BLOCKS, progress.as_ref(), |part| {
            let queries: Vec<GatherQuery<'_>> = part.clone().map(query).collect();
            // Indices in errors are those of all queries.
            let block = pool.install(|| answers_to(&queries)).map_err(|error| match error {
                GatherError::At { index, error } => GatherError::At { index: part.start + index, error },
                other => other,
            });
            answers.extend(block.map_err(value_error)?);
            Ok(())
        })?;
        let (density, radius, count) = py.detach(|| {
            let density = answers.iter().map(|answer| answer.density.to_array()).collect::<Vec<_>>();
            let radius = answers.iter().map(|answer| answer.radius).collect::<Vec<_>>();
            (density, radius, answers.iter().map(|answer| answer.count as i64).collect::<Vec<_>>())
        });
        Ok((table(py, density.into_flattened(), 3)?, radius.into_pyarray(py), count.into_pyarray(py)))
    }
}

/// The kernel with this name.
fn kernel(name: &str) -> PyResult<Kernel> {
    Ok(match name {
        "box" => Kernel::Box,
        "cone" => Kernel::Cone,
        "epanechnikov" => Kernel::Epanechnikov,
        "gaussian" => Kernel::Gaussian,
        _ => {
            let names = "'box', 'cone', 'epanechnikov' or 'gaussian'";
            return Err(PyValueError::new_err(format!("a kernel is {names}, not '{name}'")));
        }
    })
}
