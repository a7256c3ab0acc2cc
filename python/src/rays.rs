//! The tree of meshes: rays and nearest points.

use crate::arrays::{PerQuery, Places, Positions, rows, slice, table, value_error};
use crate::files::{file_error, from_bytes, to_bytes};
use crate::queries::in_waves;
use crate::threads::{long, look_after, pool};
use core::ops::ControlFlow;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, Hit, Keys, Ray, RayTree, TimeInterval, TriangleMesh};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// Rays between two looks at Python: at most a few tenths of a second.
const BLOCK: usize = 1 << 17;

/// Up to this many rays are not worth threads.
const FEW: usize = 256;

/// A tree of triangle meshes whose vertices may move.
#[pyclass(frozen)]
pub struct Rays {
    pub tree: Arc<RayTree>,
}

/// What is hit: t, mesh, triangle, u, v.
pub type Hits<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<i32>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
);

/// A mesh as arrays: positions (V, 3) at its keys, corners (F, 3), when it exists, its mask.
type MeshArrays<'py> = (Vec<Bound<'py, PyAny>>, PyReadonlyArray2<'py, u32>, [f32; 2], u32);

/// Rays as arrays: origins, directions, times, least and greatest t.
#[derive(FromPyObject)]
pub struct RayArrays<'py>(
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f32>,
    PyReadonlyArray1<'py, f32>,
    PyReadonlyArray1<'py, f32>,
    PyReadonlyArray1<'py, f32>,
);

/// The same as slices.
#[derive(Clone, Copy)]
pub struct RaySlices<'a> {
    origins: &'a [[f64; 3]],
    directions: &'a [[f32; 3]],
    times: PerQuery<'a>,
    t_min: PerQuery<'a>,
    t_max: PerQuery<'a>,
}

impl RayArrays<'_> {
    pub fn slices(&self) -> PyResult<RaySlices<'_>> {
        let (origins, directions) = (rows(&self.0)?, rows(&self.1)?);
        let n = origins.len();
        if directions.len() != n {
            return Err(PyValueError::new_err(format!("{n} origins and {} directions of rays", directions.len())));
        }
        let times = PerQuery::times(slice(&self.2)?, n)?;
        let (t_min, t_max) = (slice(&self.3)?, slice(&self.4)?);
        let (t_min, t_max) = (PerQuery::new(t_min, n, "t_min")?, PerQuery::new(t_max, n, "t_max")?);
        Ok(RaySlices { origins, directions, times, t_min, t_max })
    }
}

impl RaySlices<'_> {
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    #[inline]
    pub fn ray(&self, i: usize) -> Ray {
        Ray::new(DVec3::from(self.origins[i]), Vec3::from(self.directions[i]))
            .at_time(self.times.of(i))
            .between(self.t_min.of(i), self.t_max.of(i))
    }
}

/// What stands for no hit.
pub const NOTHING: Hit = Hit { t: f32::INFINITY, u: f32::NAN, v: f32::NAN, mesh: u32::MAX, primitive: u32::MAX };

#[pymethods]
impl Rays {
    /// `meshes`: of each mesh the positions (V, 3) at its keys, the corners (F, 3), when it exists, and its mask.
    #[new]
    fn new(py: Python<'_>, meshes: Vec<MeshArrays<'_>>, workers: isize, progress: Option<Py<PyAny>>) -> PyResult<Rays> {
        let meshes = meshes.iter().map(mesh).collect::<PyResult<Vec<_>>>()?;
        let build = long(py, workers, progress.as_ref(), |control| {
            let hear = |done| if control.at(done) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            RayTree::build_with_progress(&meshes, &BuildParams::default(), &hear)
        })?;
        Ok(Rays { tree: Arc::new(build.map_err(value_error)?) })
    }

    /// Writes the tree to a file.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.tree.save(path)).map_err(file_error)
    }

    /// Reads a tree from a file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Rays> {
        Ok(Rays { tree: Arc::new(py.detach(|| RayTree::load(path)).map_err(file_error)?) })
    }

    /// What would be in a file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        to_bytes(py, |bytes| self.tree.write_to(bytes))
    }

    /// The tree of what would be in a file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Rays> {
        Ok(Rays { tree: Arc::new(from_bytes(py, bytes, |bytes| RayTree::read_from(bytes))?) })
    }

    /// Bytes that the tree and its triangles take.
    #[getter]
    fn nbytes(&self) -> usize {
        let statistics = self.tree.statistics();
        statistics.bytes + statistics.primitive_bytes
    }

    /// What the build made, in numbers.
    fn statistics(&self) -> String {
        format!("{:#?}", self.tree.statistics())
    }

    /// The nearest hit of each ray; t is infinite and mesh and triangle are -1 where there is none.
    fn closest_hits<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        mask: u32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Hits<'py>> {
        let rays = rays.slices()?;
        let mut hits = Vec::with_capacity(rays.len());
        let one = |ray: &Ray| match mask {
            u32::MAX => self.tree.closest_hit(ray),
            _ => self.tree.closest_hit_filtered(ray, mask, |_| true),
        };
        let many = |rays: &[Ray], found: &mut Vec<Option<Hit>>| self.tree.closest_hits(rays, found);
        let all = (mask == u32::MAX).then_some(&many as Many<'_, Option<Hit>>);
        self.in_blocks(py, rays, (workers, progress), &one, all, |found| {
            hits.extend(found.iter().map(|hit| hit.unwrap_or(NOTHING)));
        })?;
        Ok(columns(py, &hits))
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
        let one = |ray: &Ray| match mask {
            u32::MAX => self.tree.any_hit(ray),
            _ => self.tree.any_hit_filtered(ray, mask, |_| true),
        };
        let many = |rays: &[Ray], found: &mut Vec<bool>| self.tree.any_hits(rays, found);
        let all = (mask == u32::MAX).then_some(&many as Many<'_, bool>);
        self.in_blocks(py, rays, (workers, progress), &one, all, |found| hits.extend_from_slice(found))?;
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
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, Hits<'py>)> {
        let rays = rays.slices()?;
        let (mut index, mut hits) = (Vec::new(), Vec::new());
        let order: Vec<u32> = (0..rays.len() as u32).collect();
        let run = |queries: &[u32]| {
            let (mut hits, mut ends) = (Vec::new(), Vec::with_capacity(queries.len()));
            for &query in queries {
                let begin = hits.len();
                let _ = self.tree.all_hits_filtered(
                    &rays.ray(query as usize),
                    mask,
                    |_| true,
                    |hit| {
                        hits.push(hit);
                        ControlFlow::Continue(())
                    },
                );
                let along =
                    |a: &Hit, b: &Hit| a.t.total_cmp(&b.t).then((a.mesh, a.primitive).cmp(&(b.mesh, b.primitive)));
                hits[begin..].sort_unstable_by(along);
                ends.push(hits.len());
            }
            (hits, ends)
        };
        in_waves(py, &order, workers, progress.as_ref(), run, |queries, (found, ends): (Vec<Hit>, Vec<usize>)| {
            let begins = core::iter::once(0).chain(ends.iter().copied());
            for ((&query, begin), &end) in queries.iter().zip(begins).zip(&ends) {
                index.resize(index.len() + end - begin, i64::from(query));
            }
            hits.extend(found);
        })?;
        Ok((index.into_pyarray(py), columns(py, &hits)))
    }

    /// The nearest points of the surface: positions (m, 3), and t (their distance) to v as of hits.
    fn closest_points<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        times: PyReadonlyArray1<'py, f32>,
        most: PyReadonlyArray1<'py, f32>,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Hits<'py>)> {
        let points = rows(&points)?;
        let times = PerQuery::times(slice(&times)?, points.len())?;
        let most = PerQuery::new(slice(&most)?, points.len(), "max_distance")?;
        let (mut positions, mut hits) = (vec![f64::NAN; 3 * points.len()], vec![NOTHING; points.len()]);
        let order = crate::queries::order(py, Places::Double(points), self.nbytes());
        let run = |queries: &[u32]| {
            let one = |&query: &u32| {
                let i = query as usize;
                self.tree.closest_point(DVec3::from(points[i]), times.of(i), most.of(i))
            };
            queries.iter().map(one).collect::<Vec<_>>()
        };
        in_waves(py, &order, workers, progress.as_ref(), run, |queries, run| {
            for (&query, near) in queries.iter().zip(run) {
                let Some(near) = near else { continue };
                let i = query as usize;
                positions[3 * i..3 * i + 3].copy_from_slice(&near.point.to_array());
                let (mesh, primitive) = (near.mesh, near.primitive);
                hits[i] = Hit { t: near.distance, u: near.u, v: near.v, mesh, primitive };
            }
        })?;
        Ok((table(py, positions, 3)?, columns(py, &hits)))
    }

    /// The corners of triangles at times, (m, 3, 3); NaN where there is no such triangle.
    fn triangles<'py>(
        &self,
        py: Python<'py>,
        mesh: PyReadonlyArray1<'py, i32>,
        triangle: PyReadonlyArray1<'py, i64>,
        times: PyReadonlyArray1<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (mesh, triangle) = (slice(&mesh)?, slice(&triangle)?);
        if mesh.len() != triangle.len() {
            return Err(PyValueError::new_err(format!("{} meshes for {} triangles", mesh.len(), triangle.len())));
        }
        let times = PerQuery::times(slice(&times)?, triangle.len())?;
        let mut corners = Vec::with_capacity(9 * triangle.len());
        for (i, (&mesh, &triangle)) in mesh.iter().zip(triangle).enumerate() {
            // -1 and what no tree has are names of nothing.
            let name = |of: i64| u32::try_from(of).unwrap_or(u32::MAX);
            let triangle = self.tree.triangle(name(mesh.into()), name(triangle), times.of(i));
            corners.extend(triangle.into_iter().flat_map(|corner| corner.to_array()));
        }
        numpy::PyArray::from_vec(py, corners).reshape([triangle.len(), 3, 3])
    }
}

/// How many rays are answered together.
type Many<'a, A> = &'a (dyn Fn(&[Ray], &mut Vec<A>) + Sync);

impl Rays {
    /// Answers rays block by block: with `many` where there is one and rays are many, else with `one`.
    fn in_blocks<A: Send>(
        &self,
        py: Python<'_>,
        rays: RaySlices<'_>,
        (workers, progress): (isize, Option<Py<PyAny>>),
        one: &(dyn Fn(&Ray) -> A + Sync),
        many: Option<Many<'_, A>>,
        mut take: impl FnMut(&[A]) + Send,
    ) -> PyResult<()> {
        let many = many.filter(|_| rays.len() > FEW);
        let Some(many) = many else {
            let order: Vec<u32> = (0..rays.len() as u32).collect();
            let run = |queries: &[u32]| queries.iter().map(|&i| one(&rays.ray(i as usize))).collect::<Vec<_>>();
            return in_waves(py, &order, workers, progress.as_ref(), run, |_, run| take(&run));
        };
        let pool = pool(workers)?;
        let (mut block, mut answers) = (Vec::new(), Vec::new());
        for begin in (0..rays.len()).step_by(BLOCK) {
            let end = rays.len().min(begin + BLOCK);
            py.detach(|| {
                block.clear();
                block.extend((begin..end).map(|i| rays.ray(i)));
                pool.install(|| many(&block, &mut answers));
                take(&answers);
            });
            look_after(py, progress.as_ref(), end as f32 / rays.len() as f32)?;
        }
        Ok(())
    }
}

/// A mesh of the library: positions at keys, corners, when it exists, mask.
fn mesh((keys, faces, active, mask): &MeshArrays<'_>) -> PyResult<TriangleMesh> {
    let keys = keys.iter().map(Positions::of).collect::<PyResult<Vec<_>>>()?;
    let keys = keys.iter().map(Positions::places).collect::<PyResult<Vec<_>>>()?;
    let keys: Keys = match keys.first() {
        Some(Places::Double(_)) => {
            let wide = |key: &Places<'_>| (0..key.len()).map(|i| DVec3::from(key.wide(i))).collect();
            keys.iter().map(wide).collect::<Vec<Vec<DVec3>>>().into()
        }
        _ => {
            let single = |key: &Places<'_>| match key {
                Places::Single(rows) => Ok(rows.iter().map(|&p| Vec3::from(p)).collect()),
                Places::Double(_) => Err(PyValueError::new_err("all keys must have one precision")),
            };
            keys.iter().map(single).collect::<PyResult<Vec<Vec<Vec3>>>>()?.into()
        }
    };
    let active = TimeInterval::new(active[0], active[1]).map_err(value_error)?;
    Ok(TriangleMesh::new(rows(faces)?.to_vec(), keys).with_active(active).with_mask(*mask))
}

/// Hits as arrays.
pub fn columns<'py>(py: Python<'py>, hits: &[Hit]) -> Hits<'py> {
    // u32::MAX becomes -1.
    let triangle = |hit: &Hit| i64::from(hit.primitive as i32);
    (
        hits.iter().map(|hit| hit.t).collect::<Vec<_>>().into_pyarray(py),
        hits.iter().map(|hit| hit.mesh as i32).collect::<Vec<_>>().into_pyarray(py),
        hits.iter().map(triangle).collect::<Vec<_>>().into_pyarray(py),
        hits.iter().map(|hit| hit.u).collect::<Vec<_>>().into_pyarray(py),
        hits.iter().map(|hit| hit.v).collect::<Vec<_>>().into_pyarray(py),
    )
}
