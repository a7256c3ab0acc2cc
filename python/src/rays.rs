//! The tree of meshes: ray queries and nearest points.

use crate::arrays::{Corners, PerQuery, corners, slice};
use crate::files::{file_error, from_bytes, read, to_bytes};
use crate::meshes::{MeshArrays, SphereArrays, meshes, spheres};
use crate::parts::{Sizes, in_parts};
use crate::refit::{Done, build_error, done};
use crate::shared::Shared;
use crate::surfaces::{HitArrays, Surfaces, points_at, secondary_origins, surfaces};
use crate::threads::{long, pool};
use crate::traced::{
    Hits, NOTHING, PointArrays, RayArrays, RaySlices, Report, all, columns, each, nearest, on_surface, positions,
};
use mbkd::{BuildParams, ClosestPointQuery, Hit, Ray, RayTree};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// The number of rays in a block: of those that are answered together.
const BLOCKS: Sizes = Sizes { first: 1 << 10, most: 1 << 17 };

/// Up to this many rays are answered on one thread.
const FEW: usize = 256;

/// A tree of triangle meshes with vertices that may move.
#[pyclass(frozen)]
pub struct Rays {
    pub tree: Shared<RayTree>,
}

#[pymethods]
impl Rays {
    /// `of_meshes`: for each mesh the positions (V, 3) at its keys, the vertex indices (F, 3), and its options.
    /// `of_spheres`: centers and radii at their keys, and active intervals.
    #[new]
    fn new(
        py: Python<'_>,
        of_meshes: Vec<MeshArrays<'_>>,
        of_spheres: SphereArrays<'_>,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Rays> {
        let (meshes, spheres) = (meshes(&of_meshes)?, spheres(&of_spheres)?);
        let build = long(py, workers, progress.as_ref(), |control| {
            let report = |done| control.report(done);
            RayTree::of_scene_with_progress(&meshes, spheres, &BuildParams::default(), &report)
        })?;
        Ok(Rays { tree: Shared::new(build.map_err(build_error)?) })
    }

    /// Moves the meshes, and the spheres if there are some, to other positions. If `moved` is given, only the meshes with these
    /// indices differ from the last time. Copies the tree if others hold it: copies, instances, and queries of other threads.
    fn refit(
        &self,
        py: Python<'_>,
        to_meshes: Vec<MeshArrays<'_>>,
        to_spheres: Option<SphereArrays<'_>>,
        moved: Option<Vec<usize>>,
        workers: isize,
    ) -> PyResult<Done> {
        let meshes = meshes(&to_meshes)?;
        let spheres = to_spheres.as_ref().map(spheres).transpose()?;
        let refit = self.tree.change(py, workers, |tree| {
            let tree = Arc::make_mut(tree);
            match (spheres, moved) {
                (None, None) => tree.refit(&meshes),
                (None, Some(moved)) => tree.refit_moved(&meshes, &moved),
                (Some(spheres), None) => tree.refit_with_shapes(&meshes, spheres),
                (Some(spheres), Some(moved)) => tree.refit_moved_with_shapes(&meshes, &moved, spheres),
            }
        })?;
        done(refit)
    }

    /// Another tree with the same contents, which are copied when one of the two is refitted.
    fn copy(&self, py: Python<'_>) -> PyResult<Rays> {
        Ok(Rays { tree: self.tree.copy(py)? })
    }

    /// Writes the tree to a file.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let tree = self.tree.get(py)?;
        py.detach(|| tree.save(&path)).map_err(file_error)
    }

    /// Reads a tree from a file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, workers: isize) -> PyResult<Rays> {
        Ok(Rays { tree: Shared::new(read(py, workers, || RayTree::load(&path))?.map_err(file_error)?) })
    }

    /// The bytes of a file of the tree.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let tree = self.tree.get(py)?;
        to_bytes(py, |bytes| tree.write_to(bytes))
    }

    /// The tree from the bytes of a file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Rays> {
        Ok(Rays { tree: Shared::new(from_bytes(py, bytes, |bytes| RayTree::read_from(bytes))?) })
    }

    /// Memory of the tree and its triangles in bytes.
    #[getter]
    fn nbytes(&self, py: Python<'_>) -> PyResult<usize> {
        let tree = self.tree.get(py)?;
        Ok(bytes_of(&tree))
    }

    /// A box around everything; none if there is nothing.
    #[getter]
    fn bounds(&self, py: Python<'_>) -> PyResult<Option<Corners>> {
        Ok(corners(self.tree.get(py)?.bounds()))
    }

    /// Statistics of the tree, as text.
    fn statistics(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("{:#?}", self.tree.get(py)?.statistics()))
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
        let (rays, tree) = (rays.slices()?, self.tree.get(py)?);
        let mut hits = Vec::with_capacity(rays.len());
        let one = |ray: &Ray| tree.closest_hit_masked(ray, mask);
        let many = |rays: &[Ray], found: &mut Vec<Option<Hit>>| tree.closest_hits_masked(rays, mask, found);
        in_blocks(py, rays, (workers, progress), &one, &many, |found| {
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
        let (rays, tree) = (rays.slices()?, self.tree.get(py)?);
        let mut hits = Vec::with_capacity(rays.len());
        let one = |ray: &Ray| tree.any_hit_masked(ray, mask);
        let many = |rays: &[Ray], found: &mut Vec<bool>| tree.any_hits_masked(rays, mask, found);
        in_blocks(py, rays, (workers, progress), &one, &many, |found| hits.extend_from_slice(found))?;
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
        let tree = self.tree.get(py)?;
        let every = |ray: &Ray, report: Report<'_, Hit>| {
            let _ = tree.all_hits_masked(ray, mask, report);
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
        let tree = self.tree.get(py)?;
        let one = |query: &ClosestPointQuery| tree.closest_point_masked(query, mask);
        let found = nearest(py, &points, bytes_of(&tree), (workers, progress.as_ref()), &one)?;
        let hits: Vec<Hit> = py.detach(|| found.iter().map(|near| near.as_ref().map_or(NOTHING, on_surface)).collect());
        Ok((positions(py, found.iter().map(Option::as_ref))?, columns(py, &hits)))
    }

    /// The points (n, 3) that rays hit, and the normals (n, 3) there.
    fn surfaces<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        hits: HitArrays<'py>,
        workers: isize,
    ) -> PyResult<Surfaces<'py>> {
        let rays = rays.slices()?;
        let tree = self.tree.get(py)?;
        surfaces(py, (rays, &hits.hits(py, rays)?), workers, &|ray, hit| tree.interaction(ray, hit))
    }

    /// Where the points that rays hit are at other times, (n, 3).
    fn points_at<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        hits: HitArrays<'py>,
        times: PyReadonlyArray1<'py, f32>,
        workers: isize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rays = rays.slices()?;
        let tree = self.tree.get(py)?;
        points_at(py, (rays, &hits.hits(py, rays)?), &times, workers, &|ray, hit, time| tree.point_at(ray, hit, time))
    }

    /// The origins (n, 3) of rays that leave from the points that rays hit, into these directions.
    fn secondary_origins<'py>(
        &self,
        py: Python<'py>,
        rays: RayArrays<'py>,
        hits: HitArrays<'py>,
        directions: PyReadonlyArray2<'py, f32>,
        workers: isize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rays = rays.slices()?;
        let tree = self.tree.get(py)?;
        secondary_origins(py, (rays, &hits.hits(py, rays)?), &directions, workers, &|ray, hit| {
            tree.interaction(ray, hit)
        })
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
        let tree = self.tree.get(py)?;
        // -1 and indices out of range are no triangle.
        let name = |of: i64| u32::try_from(of).unwrap_or(u32::MAX);
        let corners = py.detach(|| {
            let corners_of = |i: usize| {
                let corners = tree.triangle(name(mesh[i].into()), name(triangle[i]), times.of(i));
                corners.map(|corner| corner.to_array())
            };
            (0..triangle.len()).map(corners_of).collect::<Vec<_>>()
        });
        numpy::PyArray::from_vec(py, corners.into_flattened().into_flattened()).reshape([triangle.len(), 3, 3])
    }
}

/// Answers the rays of a block.
type Many<'a, A> = &'a (dyn Fn(&[Ray], &mut Vec<A>) + Sync);

/// Answers rays block by block: with `many`, or with `one` if there are few rays.
fn in_blocks<A: Send>(
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
    in_parts(py, rays.len(), BLOCKS, progress.as_ref(), |part| {
        block.clear();
        block.extend(part.map(|i| rays.ray(i)));
        pool.install(|| many(&block, &mut answers));
        take(&answers);
        Ok(())
    })
}

/// The memory of a tree and its primitives.
fn bytes_of(tree: &RayTree) -> usize {
    let statistics = tree.statistics();
    statistics.bytes + statistics.primitive_bytes
}
