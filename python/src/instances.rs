//! Trees placed many times, moving.

use crate::arrays::{intervals, slice, value_error};
use crate::queries::in_waves;
use crate::rays::{Hits, NOTHING, RayArrays, Rays, columns};
use crate::threads::on;
use core::ops::ControlFlow;
use mbkd::glam::{DAffine3, DMat3, DQuat, DVec3};
use mbkd::{Hit, Instance, InstanceHit, InstanceOf, InstanceTree, MAX_NESTING, Pose, Ray, Transform, WideParams};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;

/// A tree over trees that are placed.
#[pyclass(frozen)]
pub struct Instances {
    tree: Arc<InstanceTree>,
}

/// What can be placed.
#[derive(FromPyObject)]
enum Placed<'py> {
    Rays(Bound<'py, Rays>),
    Instances(Bound<'py, Instances>),
}

/// Indices of instances, outermost first, for each hit: (m, 4), -1 behind the last.
type Paths<'py> = Bound<'py, PyArray2<i64>>;

#[pymethods]
impl Instances {
    /// `which` of the `trees` each of n instances places. `transforms` (K, n, m) has for each key and instance either
    /// the twelve entries of a matrix, row by row, or ten numbers of a pose: translation, quaternion x y z w, scale.
    #[new]
    fn new(
        py: Python<'_>,
        trees: Vec<Placed<'_>>,
        which: PyReadonlyArray1<'_, i64>,
        transforms: PyReadonlyArray3<'_, f64>,
        masks: PyReadonlyArray1<'_, u32>,
        lifetimes: PyReadonlyArray2<'_, f32>,
        workers: isize,
    ) -> PyResult<Instances> {
        let trees: Vec<InstanceOf> = trees.iter().map(Placed::of).collect();
        let (which, masks) = (slice(&which)?, slice(&masks)?);
        let lives = intervals(slice(&lifetimes)?.as_chunks().0)?;
        let [_, n, numbers] = *transforms.as_array().shape() else {
            return Err(PyValueError::new_err("no transforms"));
        };
        let transforms = slice(&transforms)?;
        if [n, masks.len(), lives.len()] != [which.len(); 3] {
            return Err(PyValueError::new_err("instances, transforms, masks and lifetimes differ in number"));
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
            instances.push(Instance::new(of.clone(), transform).with_mask(masks[i]).with_active(lives[i]));
        }
        let tree = on(py, workers, || InstanceTree::build(instances, &WideParams::default()))?;
        Ok(Instances { tree: Arc::new(tree.map_err(value_error)?) })
    }

    /// Number of instances of the outermost level.
    #[getter]
    fn n(&self) -> usize {
        self.tree.len()
    }

    /// Bytes of everything, each tree that is placed once.
    #[getter]
    fn nbytes(&self) -> usize {
        let statistics = self.tree.statistics();
        statistics.tree_bytes + statistics.instance_bytes
    }

    /// What the build made, in numbers.
    fn statistics(&self) -> String {
        format!("{:#?}", self.tree.statistics())
    }

    /// The nearest hit of each ray, and the instances that lead to it.
    fn closest_hits<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        mask: u32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Paths<'py>, Hits<'py>)> {
        let rays = rays.slices()?;
        let mut found = Found::default();
        let order: Vec<u32> = (0..rays.len() as u32).collect();
        let one = |ray: &Ray| self.tree.closest_hit_filtered(ray, mask, |_| true);
        let run = |queries: &[u32]| queries.iter().map(|&i| one(&rays.ray(i as usize))).collect::<Vec<_>>();
        in_waves(py, &order, workers, progress.as_ref(), run, |_, hits| {
            hits.into_iter().for_each(|hit| found.push(hit));
        })?;
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
        let rays = rays.slices()?;
        let mut hits = Vec::with_capacity(rays.len());
        let order: Vec<u32> = (0..rays.len() as u32).collect();
        let one = |ray: &Ray| self.tree.any_hit_filtered(ray, mask, |_| true);
        let run = |queries: &[u32]| queries.iter().map(|&i| one(&rays.ray(i as usize))).collect::<Vec<_>>();
        in_waves(py, &order, workers, progress.as_ref(), run, |_, run| hits.extend(run))?;
        Ok(hits.into_pyarray(py))
    }

    /// All hits of all rays, by ray and along each ray; first the rays' indices.
    fn all_hits<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        mask: u32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, Paths<'py>, Hits<'py>)> {
        let rays = rays.slices()?;
        let (mut index, mut found) = (Vec::new(), Found::default());
        let order: Vec<u32> = (0..rays.len() as u32).collect();
        let run =
            |queries: &[u32]| queries.iter().map(|&i| self.along(&rays.ray(i as usize), mask)).collect::<Vec<_>>();
        in_waves(py, &order, workers, progress.as_ref(), run, |queries, run| {
            for (&query, hits) in queries.iter().zip(run) {
                index.resize(index.len() + hits.len(), i64::from(query));
                hits.into_iter().for_each(|hit| found.push(Some(hit)));
            }
        })?;
        let (paths, hits) = found.columns(py)?;
        Ok((index.into_pyarray(py), paths, hits))
    }

    /// The matrices from the spaces of what paths lead to, to that of this tree, (m, 12), row by row; NaN where a path leads
    /// nowhere.
    fn matrices<'py>(
        &self,
        py: Python<'py>,
        paths: PyReadonlyArray2<'py, i64>,
        times: PyReadonlyArray1<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let levels = paths.as_array().ncols();
        let times = slice(&times)?;
        let paths = slice(&paths)?;
        if levels == 0 || paths.len() != times.len() * levels {
            return Err(PyValueError::new_err(format!(
                "{} times for {} paths",
                times.len(),
                paths.len() / levels.max(1)
            )));
        }
        let mut entries = Vec::with_capacity(12 * times.len());
        for (path, &time) in paths.chunks(levels).zip(times) {
            let path: Vec<u32> = path.iter().map_while(|&of| u32::try_from(of).ok()).collect();
            match self.tree.matrix(&path, time) {
                Some(of) => (0..3).for_each(|row| {
                    entries.extend(of.matrix3.row(row).to_array());
                    entries.push(of.translation[row]);
                }),
                None => entries.extend([f64::NAN; 12]),
            }
        }
        crate::arrays::table(py, entries, 12)
    }
}

impl Instances {
    /// All hits of a ray in the order of t, path, mesh and triangle.
    fn along(&self, ray: &Ray, mask: u32) -> Vec<InstanceHit> {
        let mut hits = Vec::new();
        let _ = self.tree.all_hits_filtered(
            ray,
            mask,
            |_| true,
            |hit| {
                hits.push(hit);
                ControlFlow::Continue(())
            },
        );
        let name = |of: &InstanceHit| (of.path, of.hit.mesh, of.hit.primitive);
        hits.sort_unstable_by(|a, b| a.hit.t.total_cmp(&b.hit.t).then(name(a).cmp(&name(b))));
        hits
    }
}

impl Placed<'_> {
    fn of(&self) -> InstanceOf {
        match self {
            Placed::Rays(rays) => InstanceOf::Tree(rays.get().tree.clone()),
            Placed::Instances(instances) => InstanceOf::Instances(instances.get().tree.clone()),
        }
    }
}

/// Hits with their paths, of which some may be none.
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

    fn columns(self, py: Python<'_>) -> PyResult<(Paths<'_>, Hits<'_>)> {
        let hits = columns(py, &self.hits);
        Ok((crate::arrays::table(py, self.paths, MAX_NESTING)?, hits))
    }
}

/// A matrix of its twelve entries, row by row.
fn matrix(entries: &[f64]) -> DAffine3 {
    let column = |i: usize| DVec3::new(entries[i], entries[4 + i], entries[8 + i]);
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

/// A pose of translation, quaternion x y z w, scale.
fn pose(numbers: &[f64]) -> Pose {
    Pose {
        translation: DVec3::from_slice(&numbers[..3]),
        rotation: DQuat::from_slice(&numbers[3..7]),
        scale: DVec3::from_slice(&numbers[7..10]),
    }
}
