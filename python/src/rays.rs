//! The tree of meshes: ray queries and nearest points.

use crate::arrays::{PerQuery, Places, Positions, interval_of, intervals, rows, slice, value_error};
use crate::files::{file_error, from_bytes, read, to_bytes};
use crate::threads::{long, poll_python, pool};
use crate::traced::{
    Hits, NOTHING, PointArrays, RayArrays, RaySlices, Report, all, columns, each, nearest, on_surface, positions,
};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    BuildError, BuildParams, ClosestPointQuery, Hit, Keys, MAX_COORDINATE, MovingSphere, Ray, RayTree, Shape,
    TimeInterval, TriangleMesh,
};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// The number of rays between two checks for Ctrl-C and calls of `progress`: at most a few tenths of a second.
const BLOCK: usize = 1 << 17;

/// Up to this many rays are answered on one thread.
const FEW: usize = 256;

/// A tree of triangle meshes with vertices that may move.
#[pyclass(frozen)]
pub struct Rays {
    pub tree: Arc<RayTree>,
}

/// A mesh as arrays: positions (V, 3) at its keys, vertex indices (F, 3), active interval, and mask.
type MeshArrays<'py> = (Vec<Bound<'py, PyAny>>, PyReadonlyArray2<'py, u32>, [f32; 2], u32);

/// Spheres as arrays: centers (n, 3) and radii (n,) at their keys, and active intervals (n, 2), or none if all exist throughout.
type SphereArrays<'py> =
    (Vec<PyReadonlyArray2<'py, f64>>, Vec<PyReadonlyArray1<'py, f64>>, Option<PyReadonlyArray2<'py, f32>>);

#[pymethods]
impl Rays {
    /// `meshes`: for each mesh the positions (V, 3) at its keys, the vertex indices (F, 3), the active interval and the mask.
    /// `spheres`: centers and radii at their keys, and active intervals.
    #[new]
    fn new(
        py: Python<'_>,
        meshes: Vec<MeshArrays<'_>>,
        spheres: SphereArrays<'_>,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Rays> {
        let meshes = meshes.iter().enumerate().map(mesh).collect::<PyResult<Vec<_>>>()?;
        let shapes = shapes(&spheres)?;
        let build = long(py, workers, progress.as_ref(), |control| {
            let report = |done| control.report(done);
            RayTree::of_scene_with_progress(&meshes, shapes, &BuildParams::default(), &report)
        })?;
        let tree = build.map_err(|error| match error {
            // Spheres are the only shapes here.
            BuildError::BadBounds { primitive } => PyValueError::new_err(format!(
                "sphere {primitive} is not finite, or reaches beyond {:e}; move or scale the scene",
                MAX_COORDINATE as f32
            )),
            error => value_error(error),
        })?;
        Ok(Rays { tree: Arc::new(tree) })
    }

    /// Writes the tree to a file.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.tree.save(&path)).map_err(file_error)
    }

    /// Reads a tree from a file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Rays> {
        Ok(Rays { tree: Arc::new(read(py, || RayTree::load(&path))?.map_err(file_error)?) })
    }

    /// The bytes of a file of the tree.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        to_bytes(py, |bytes| self.tree.write_to(bytes))
    }

    /// The tree from the bytes of a file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Rays> {
        Ok(Rays { tree: Arc::new(from_bytes(py, bytes, |bytes| RayTree::read_from(bytes))?) })
    }

    /// Memory of the tree and its triangles in bytes.
    #[getter]
    fn nbytes(&self) -> usize {
        let statistics = self.tree.statistics();
        statistics.bytes + statistics.primitive_bytes
    }

    /// Statistics of the tree, as text.
    fn statistics(&self) -> String {
        format!("{:#?}", self.tree.statistics())
    }

    /// The nearest hit of each ray; if there is none, t is infinite, and mesh and triangle are -1.
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
            _ => self.tree.closest_hit_masked(ray, mask),
        };
        let many = |rays: &[Ray], found: &mut Vec<Option<Hit>>| match mask {
            u32::MAX => self.tree.closest_hits(rays, found),
            _ => self.tree.closest_hits_masked(rays, mask, found),
        };
        self.in_blocks(py, rays, (workers, progress), &one, &many, |found| {
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
            _ => self.tree.any_hit_masked(ray, mask),
        };
        let many = |rays: &[Ray], found: &mut Vec<bool>| match mask {
            u32::MAX => self.tree.any_hits(rays, found),
            _ => self.tree.any_hits_masked(rays, mask, found),
        };
        self.in_blocks(py, rays, (workers, progress), &one, &many, |found| hits.extend_from_slice(found))?;
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
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, Hits<'py>)> {
        let every = |ray: &Ray, report: Report<'_, Hit>| {
            let _ = self.tree.all_hits_masked(ray, mask, report);
        };
        let along = |hit: &Hit| (hit.t, (hit.mesh, hit.primitive));
        let (index, hits) = all(py, rays.slices()?, (workers, progress.as_ref()), &every, along)?;
        Ok((index.into_pyarray(py), columns(py, &hits)))
    }

    /// The nearest points of the surface: positions (m, 3), and hits from t (their distance) to v.
    fn closest_points<'py>(
        &self,
        py: Python<'py>,
        points: PointArrays<'py>,
        mask: u32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Hits<'py>)> {
        let one = |query: &ClosestPointQuery| match mask {
            u32::MAX => self.tree.closest_point(query),
            _ => self.tree.closest_point_masked(query, mask),
        };
        let found = nearest(py, &points, self.nbytes(), (workers, progress.as_ref()), &one)?;
        let hits: Vec<Hit> = found.iter().map(|near| near.as_ref().map_or(NOTHING, on_surface)).collect();
        Ok((positions(py, found.iter().map(Option::as_ref))?, columns(py, &hits)))
    }

    /// The corners of triangles at times, (m, 3, 3); NaN if there is no such triangle.
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
            // -1 and indices out of range are no triangle.
            let name = |of: i64| u32::try_from(of).unwrap_or(u32::MAX);
            let triangle = self.tree.triangle(name(mesh.into()), name(triangle), times.of(i));
            corners.extend(triangle.into_iter().flat_map(|corner| corner.to_array()));
        }
        numpy::PyArray::from_vec(py, corners).reshape([triangle.len(), 3, 3])
    }
}

/// The number of rays of a block, which are answered together.
type Many<'a, A> = &'a (dyn Fn(&[Ray], &mut Vec<A>) + Sync);

impl Rays {
    /// Answers rays block by block: with `many`, or with `one` if there are few rays.
    fn in_blocks<A: Send>(
        &self,
        py: Python<'_>,
        rays: RaySlices<'_>,
        (workers, progress): (isize, Option<Py<PyAny>>),
        one: &(dyn Fn(&Ray) -> A + Sync),
        many: Many<'_, A>,
        mut take: impl FnMut(&[A]) + Send,
    ) -> PyResult<()> {
        if rays.len() <= FEW {
            return each(py, rays, (workers, progress.as_ref()), one, |answer| take(&[answer]));
        }
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
            poll_python(py, progress.as_ref(), end as f32 / rays.len() as f32)?;
        }
        Ok(())
    }
}

/// Makes spheres of the library from centers and radii at keys, and active intervals.
fn shapes((centers, radii, active): &SphereArrays<'_>) -> PyResult<Vec<Shape>> {
    let centers = centers.iter().map(rows).collect::<PyResult<Vec<_>>>()?;
    let radii = radii.iter().map(slice).collect::<PyResult<Vec<_>>>()?;
    let count = centers.first().map_or(0, |key| key.len());
    let active = active.as_ref().map(|active| intervals(slice(active)?.as_chunks().0, "sphere")).transpose()?;
    let lengths = centers.iter().map(|key| key.len()).chain(radii.iter().map(|key| key.len()));
    if centers.len() != radii.len() || lengths.chain(active.iter().map(Vec::len)).any(|length| length != count) {
        return Err(PyValueError::new_err("spheres have centers, radii and active intervals of different numbers"));
    }
    let shape = |i: usize| {
        let keys = centers.iter().zip(&radii).map(|(centers, radii)| (DVec3::from(centers[i]), radii[i])).collect();
        let active = active.as_ref().map_or(TimeInterval::FULL, |active| active[i]);
        Shape::from(MovingSphere::new(keys).with_active(active))
    };
    Ok((0..count).map(shape).collect())
}

/// Makes a mesh of the library from positions at keys, vertex indices, active interval and mask.
fn mesh((i, (keys, faces, active, mask)): (usize, &MeshArrays<'_>)) -> PyResult<TriangleMesh> {
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
    let active = interval_of(*active, "mesh", i)?;
    Ok(TriangleMesh::new(rows(faces)?.to_vec(), keys).with_active(active).with_mask(*mask))
}
