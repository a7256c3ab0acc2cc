//! Trees of moving instances.

use crate::arrays::{Corners, PerQuery, corners, intervals, slice, table, value_error};
use crate::rays::Rays;
use crate::surfaces::{PlacedHitArrays, Surfaces, path_of, points_at, secondary_origins, surfaces};
use crate::threads::long;
use crate::traced::{NOTHING, PointArrays, RayArrays, Report, all, columns, each, nearest, on_surface, positions};
use mbkd::glam::{DAffine3, DMat3, DQuat, DVec3};
use mbkd::{
    ClosestPointQuery, Hit, Instance, InstanceHit, InstanceOf, InstancePoint, InstanceTree, MAX_NESTING, Pose, Ray,
    Transform, WideParams,
};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;

/// A tree of instances.
#[pyclass(frozen)]
pub struct Instances {
    tree: Arc<InstanceTree>,
}

/// A tree that instances can place.
#[derive(FromPyObject)]
enum Placed<'py> {
    Rays(Bound<'py, Rays>),
    Instances(Bound<'py, Instances>),
}

/// Hits as [`Hits`](crate::traced::Hits), and the paths of instances, outermost first: (m, 4), -1 after the last.
type PlacedHits<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<i32>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray2<i64>>,
);

#[pymethods]
impl Instances {
    /// `which` has the index in `trees` that each of n instances places. `transforms` (K, n, m) has for each key and instance
    /// either the twelve entries of a matrix, row by row, or ten numbers of a pose: translation, quaternion x y z w, scale.
    #[new]
    fn new(
        py: Python<'_>,
        trees: Vec<Placed<'_>>,
        which: PyReadonlyArray1<'_, i64>,
        transforms: PyReadonlyArray3<'_, f64>,
        masks: PyReadonlyArray1<'_, u32>,
        active: PyReadonlyArray2<'_, f32>,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Instances> {
        let trees = trees.iter().map(|placed| placed.of(py)).collect::<PyResult<Vec<InstanceOf>>>()?;
        let (which, masks) = (slice(&which)?, slice(&masks)?);
        let active = intervals(slice(&active)?.as_chunks().0, "instance")?;
        let [_, n, numbers] = *transforms.as_array().shape() else {
            return Err(PyValueError::new_err("no transforms"));
        };
        let transforms = slice(&transforms)?;
        if [n, masks.len(), active.len()] != [which.len(); 3] {
            return Err(PyValueError::new_err("instances, transforms, masks and active intervals differ in number"));
        }
        let mut instances = Vec::with_capacity(n);
        for i in 0..n {
            let known = usize::try_from(which[i]).ok().and_then(|which| trees.get(which));
            let Some(of) = known else {
                return Err(PyValueError::new_err(format!("instance {i} is of tree {}, which is not there", which[i])));
            };
            let keys = transforms.chunks(n * numbers).map(|key| &key[i * numbers..][..numbers]);
            let transform = match numbers {
                12 => Transform::Matrices(keys.map(matrix).collect()),
                10 => Transform::Poses(keys.map(pose).collect()),
                _ => return Err(PyValueError::new_err(format!("a transform has 12 or 10 numbers, not {numbers}"))),
            };
            instances.push(Instance::new(of.clone(), transform).with_mask(masks[i]).with_active(active[i]));
        }
        let tree = long(py, workers, progress.as_ref(), |control| {
            InstanceTree::build_with_progress(instances, &WideParams::default(), &|done| control.report(done))
        })?;
        Ok(Instances { tree: Arc::new(tree.map_err(value_error)?) })
    }

    /// The number of instances in the outermost tree.
    #[getter]
    fn n(&self) -> usize {
        self.tree.len()
    }

    /// Memory in bytes; each placed tree counts once.
    #[getter]
    fn nbytes(&self) -> usize {
        let statistics = self.tree.statistics();
        statistics.tree_bytes + statistics.instance_bytes
    }

    /// A box around everything; none if there is nothing.
    #[getter]
    fn bounds(&self) -> Option<Corners> {
        corners(self.tree.bounds())
    }

    /// Statistics of the tree, as text.
    fn statistics(&self) -> String {
        format!("{:#?}", self.tree.statistics())
    }

    /// The nearest hit of each ray, and its path of instances.
    fn closest_hits<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        mask: u32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<PlacedHits<'py>> {
        let mut found = Found::default();
        let one = |ray: &Ray| self.tree.closest_hit_masked(ray, mask);
        each(py, rays.slices()?, (workers, progress.as_ref()), one, |hit| found.push(hit))?;
        found.columns(py)
    }

    /// Whether each ray hits anything.
    fn any_hits<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        mask: u32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let mut hits = Vec::new();
        let one = |ray: &Ray| self.tree.any_hit_masked(ray, mask);
        each(py, rays.slices()?, (workers, progress.as_ref()), one, |hit| hits.push(hit))?;
        Ok(hits.into_pyarray(py))
    }

    /// The ray indices of all hits, and the hits, sorted by ray and along each ray.
    fn all_hits<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        mask: u32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, PlacedHits<'py>)> {
        let every = |ray: &Ray, report: Report<'_, InstanceHit>| {
            let _ = self.tree.all_hits_masked(ray, mask, report);
        };
        let along = |of: &InstanceHit| (of.hit.t, (of.path, of.hit.mesh, of.hit.primitive));
        let (index, hits) = all(py, rays.slices()?, (workers, progress.as_ref()), &every, along)?;
        let mut found = Found::default();
        py.detach(|| hits.into_iter().for_each(|hit| found.push(Some(hit))));
        Ok((index.into_pyarray(py), found.columns(py)?))
    }

    /// The nearest points of instances: positions (m, 3), and hits from t (their distance) to path.
    fn closest_points<'py>(
        &self,
        py: Python<'py>,
        points: PointArrays<'py>,
        mask: u32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, PlacedHits<'py>)> {
        let one = |query: &ClosestPointQuery| self.tree.closest_point_masked(query, mask);
        let answers = nearest(py, &points, self.nbytes(), (workers, progress.as_ref()), &one)?;
        let mut found = Found::default();
        py.detach(|| {
            for answer in &answers {
                found.push(answer.map(|InstancePoint { path, near }| InstanceHit { path, hit: on_surface(&near) }));
            }
        });
        let near = answers.iter().map(|answer| answer.as_ref().map(|of| &of.near));
        Ok((positions(py, near)?, found.columns(py)?))
    }

    /// The points (n, 3) that rays hit, and the normals (n, 3) there.
    fn surfaces<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        hits: PlacedHitArrays<'py>,
        workers: isize,
    ) -> PyResult<Surfaces<'py>> {
        let rays = rays.slices()?;
        let tree = &self.tree;
        surfaces(py, (rays, &hits.hits(py, rays)?), workers, &|ray, hit| tree.interaction(ray, hit))
    }

    /// Where the points that rays hit are at other times, (n, 3).
    fn points_at<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        hits: PlacedHitArrays<'py>,
        times: PyReadonlyArray1<'py, f32>,
        workers: isize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rays = rays.slices()?;
        let tree = &self.tree;
        points_at(py, (rays, &hits.hits(py, rays)?), &times, workers, &|ray, hit, time| tree.point_at(ray, hit, time))
    }

    /// The origins (n, 3) of rays that leave from the points that rays hit, into these directions.
    fn secondary_origins<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        hits: PlacedHitArrays<'py>,
        directions: PyReadonlyArray2<'py, f32>,
        workers: isize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rays = rays.slices()?;
        let tree = &self.tree;
        secondary_origins(py, (rays, &hits.hits(py, rays)?), &directions, workers, &|ray, hit| {
            tree.interaction(ray, hit)
        })
    }

    /// The matrices (m, 12), row by row, from the space of the tree at the end of each path to the space of this tree; NaN for
    /// invalid paths.
    fn matrices<'py>(
        &self,
        py: Python<'py>,
        paths: PyReadonlyArray2<'py, i64>,
        times: PyReadonlyArray1<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let levels = paths.as_array().ncols();
        if levels == 0 {
            return Err(PyValueError::new_err("paths have at least one level"));
        }
        let paths = slice(&paths)?;
        let count = paths.len() / levels;
        let times = PerQuery::times(slice(&times)?, count)?;
        let entries = py.detach(|| {
            let mut entries = Vec::with_capacity(12 * count);
            for (i, path) in paths.chunks(levels).enumerate() {
                match path_of(path).and_then(|path| self.tree.matrix(&path, times.of(i))) {
                    Some(of) => (0..3).for_each(|row| {
                        entries.extend(of.matrix3.row(row).to_array());
                        entries.push(of.translation[row]);
                    }),
                    None => entries.extend([f64::NAN; 12]),
                }
            }
            entries
        });
        table(py, entries, 12)
    }
}

impl Placed<'_> {
    fn of(&self, py: Python<'_>) -> PyResult<InstanceOf> {
        Ok(match self {
            Placed::Rays(rays) => InstanceOf::Tree(rays.get().tree.get(py)?),
            Placed::Instances(instances) => InstanceOf::Instances(instances.get().tree.clone()),
        })
    }
}

/// Hits with their paths; missing hits are allowed.
#[derive(Default)]
struct Found {
    paths: Vec<i64>,
    hits: Vec<Hit>,
}

impl Found {
    fn push(&mut self, hit: Option<InstanceHit>) {
        let mut path = [-1; MAX_NESTING];
        if let Some(hit) = hit {
            path.iter_mut().zip(&*hit.path).for_each(|(to, &of)| *to = of.into());
        }
        self.paths.extend(path);
        self.hits.push(hit.map_or(NOTHING, |hit| hit.hit));
    }

    fn columns(self, py: Python<'_>) -> PyResult<PlacedHits<'_>> {
        let (t, mesh, triangle, u, v) = columns(py, &self.hits);
        Ok((t, mesh, triangle, u, v, table(py, self.paths, MAX_NESTING)?))
    }
}

/// The matrix with these twelve entries, row by row.
fn matrix(entries: &[f64]) -> DAffine3 {
    let column = |i: usize| DVec3::new(entries[i], entries[4 + i], entries[8 + i]);
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

/// The pose with this translation, quaternion x y z w and scale.
fn pose(numbers: &[f64]) -> Pose {
    Pose {
        translation: DVec3::from_slice(&numbers[..3]),
        rotation: DQuat::from_slice(&numbers[3..7]),
        scale: DVec3::from_slice(&numbers[7..10]),
    }
}
