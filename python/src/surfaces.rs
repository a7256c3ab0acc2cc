//! The surface where rays hit it: points and normals, points at other times, and the origins of rays that leave it.

use crate::arrays::{PerQuery, rows, slice, table};
use crate::traced::{RaySlices, each_numbered};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{Hit, InstanceHit, InstancePath, MAX_NESTING, Ray, SurfaceInteraction};
use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Hits as arrays: t, mesh, triangle, u, v.
#[derive(FromPyObject)]
pub struct HitArrays<'py>(
    PyReadonlyArray1<'py, f32>,
    PyReadonlyArray1<'py, i32>,
    PyReadonlyArray1<'py, i64>,
    PyReadonlyArray1<'py, f32>,
    PyReadonlyArray1<'py, f32>,
);

/// Hits as [`HitArrays`], and their paths of instances.
#[derive(FromPyObject)]
pub struct PlacedHitArrays<'py>(HitArrays<'py>, PyReadonlyArray2<'py, i64>);

/// Points (n, 3), and unit normals (n, 3).
pub type Surfaces<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f32>>);

/// A row without an answer.
const UNKNOWN: [f64; 3] = [f64::NAN; 3];

impl HitArrays<'_> {
    /// The hits of these rays; `None` for rays that hit nothing.
    pub fn hits(&self, py: Python<'_>, rays: RaySlices<'_>) -> PyResult<Vec<Option<Hit>>> {
        let (t, mesh, triangle) = (slice(&self.0)?, slice(&self.1)?, slice(&self.2)?);
        let (u, v) = (slice(&self.3)?, slice(&self.4)?);
        let n = rays.len();
        if [t.len(), mesh.len(), triangle.len(), u.len(), v.len()] != [n; 5] {
            return Err(PyValueError::new_err(format!("{} hits of {n} rays", t.len())));
        }
        let hit = |i: usize| {
            let (mesh, primitive) = (u32::try_from(mesh[i]).ok()?, u32::try_from(triangle[i]).ok()?);
            Some(Hit { t: t[i], u: u[i], v: v[i], mesh, primitive })
        };
        Ok(py.detach(|| (0..n).map(hit).collect()))
    }
}

impl PlacedHitArrays<'_> {
    /// The hits of these rays; `None` for rays that hit nothing.
    pub fn hits(&self, py: Python<'_>, rays: RaySlices<'_>) -> PyResult<Vec<Option<InstanceHit>>> {
        let (hits, paths) = (self.0.hits(py, rays)?, slice(&self.1)?);
        if self.1.as_array().shape() != [hits.len(), MAX_NESTING] {
            return Err(PyValueError::new_err(format!("paths must have the shape ({}, {MAX_NESTING})", hits.len())));
        }
        let placed = |(hit, path): (Option<Hit>, &[i64])| Some(InstanceHit { path: path_of(path)?, hit: hit? });
        Ok(py.detach(|| hits.into_iter().zip(paths.chunks(MAX_NESTING)).map(placed).collect()))
    }
}

/// The path with these instances, and -1 after the last one; `None` if there is none.
pub fn path_of(levels: &[i64]) -> Option<InstancePath> {
    let end = levels.iter().position(|&of| of == -1).unwrap_or(levels.len());
    let (path, after) = levels.split_at(end);
    let path = path.iter().map(|&of| u32::try_from(of).ok()).collect::<Option<Vec<u32>>>()?;
    if after.iter().all(|&of| of == -1) { InstancePath::new(&path) } else { None }
}

/// The points that rays hit, and the normals there; NaN where there are none.
pub fn surfaces<'py, H: Sync>(
    py: Python<'py>,
    (rays, hits): (RaySlices<'_>, &[Option<H>]),
    workers: isize,
    interaction: &(dyn Fn(&Ray, &H) -> SurfaceInteraction + Sync),
) -> PyResult<Surfaces<'py>> {
    let (mut points, mut normals) = (Vec::with_capacity(hits.len()), Vec::with_capacity(hits.len()));
    let one = |i: usize, ray: &Ray| {
        let surface = interaction(ray, hits[i].as_ref()?);
        Some((surface.point().to_array(), surface.normal()))
    };
    each_numbered(py, rays, (workers, None), one, |surface| {
        let (point, normal) = surface.unwrap_or((UNKNOWN, Vec3::ZERO));
        points.push(point);
        normals.push(if normal == Vec3::ZERO { [f32::NAN; 3] } else { normal.to_array() });
    })?;
    Ok((table(py, points.into_flattened(), 3)?, table(py, normals.into_flattened(), 3)?))
}

/// Where the points that rays hit are at other times; NaN where that is not known.
pub fn points_at<'py, H: Sync>(
    py: Python<'py>,
    (rays, hits): (RaySlices<'_>, &[Option<H>]),
    times: &PyReadonlyArray1<'_, f32>,
    workers: isize,
    point_at: &(dyn Fn(&Ray, &H, f32) -> Option<DVec3> + Sync),
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let times = PerQuery::times(slice(times)?, rays.len())?;
    let mut points = Vec::with_capacity(hits.len());
    let one = |i: usize, ray: &Ray| {
        let point = hits[i].as_ref().and_then(|hit| point_at(ray, hit, times.of(i)));
        point.map_or(UNKNOWN, |point| point.to_array())
    };
    each_numbered(py, rays, (workers, None), one, |point| points.push(point))?;
    table(py, points.into_flattened(), 3)
}

/// The origins of rays that leave from the points that rays hit, into these directions.
pub fn secondary_origins<'py, H: Sync>(
    py: Python<'py>,
    (rays, hits): (RaySlices<'_>, &[Option<H>]),
    directions: &PyReadonlyArray2<'_, f32>,
    workers: isize,
    interaction: &(dyn Fn(&Ray, &H) -> SurfaceInteraction + Sync),
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let directions = rows(directions)?;
    if directions.len() != rays.len() {
        return Err(PyValueError::new_err(format!("{} directions for {} hits", directions.len(), rays.len())));
    }
    let mut origins = Vec::with_capacity(hits.len());
    let one = |i: usize, ray: &Ray| {
        Some(interaction(ray, hits[i].as_ref()?).secondary_ray(Vec3::from(directions[i])).origin.to_array())
    };
    each_numbered(py, rays, (workers, None), one, |origin| origins.push(origin.unwrap_or(UNKNOWN)))?;
    table(py, origins.into_flattened(), 3)
}
