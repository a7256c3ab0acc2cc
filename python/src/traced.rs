//! Code that trees of meshes and trees of instances share: arrays of rays, places and hits, and batches of queries.

use crate::arrays::{PerQuery, Places, rows, slice, table};
use crate::queries::{as_given, in_waves, order};
use core::ops::ControlFlow;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{ClosestPoint, ClosestPointQuery, Hit, Ray};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Hits: t, mesh, triangle, u, v.
pub type Hits<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<i32>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
);

/// Rays as arrays: origins, directions, times, t_min and t_max.
#[derive(FromPyObject)]
pub struct RayArrays<'py>(
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f32>,
    PyReadonlyArray1<'py, f32>,
    PyReadonlyArray1<'py, f32>,
    PyReadonlyArray1<'py, f32>,
);

/// Rays as slices.
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

/// Places as arrays: positions (m, 3), times, greatest distances.
#[derive(FromPyObject)]
pub struct PointArrays<'py>(PyReadonlyArray2<'py, f64>, PyReadonlyArray1<'py, f32>, PyReadonlyArray1<'py, f32>);

/// The placeholder for a missing hit.
pub const NOTHING: Hit = Hit { t: f32::INFINITY, u: f32::NAN, v: f32::NAN, mesh: u32::MAX, primitive: u32::MAX };

/// The number of threads, and the caller's `progress`.
pub type How<'a> = (isize, Option<&'a Py<PyAny>>);

/// The function that is called with each hit of a ray.
pub type Report<'a, H> = &'a mut dyn FnMut(H) -> ControlFlow<()>;

/// Answers each ray; `take` gets the answers in order.
pub fn each<A: Send>(
    py: Python<'_>,
    rays: RaySlices<'_>,
    how: How<'_>,
    one: impl Fn(&Ray) -> A + Sync,
    take: impl FnMut(A) + Send,
) -> PyResult<()> {
    each_numbered(py, rays, how, |_, ray| one(ray), take)
}

/// The same, with the number of each ray.
pub fn each_numbered<A: Send>(
    py: Python<'_>,
    rays: RaySlices<'_>,
    (workers, progress): How<'_>,
    one: impl Fn(usize, &Ray) -> A + Sync,
    mut take: impl FnMut(A) + Send,
) -> PyResult<()> {
    let run = |run: &[u32]| run.iter().map(|&i| one(i as usize, &rays.ray(i as usize))).collect::<Vec<_>>();
    in_waves(py, &as_given(rays.len())?, workers, progress, run, |_, run| {
        run.into_iter().for_each(&mut take);
        Ok(())
    })
}

/// All hits of all rays and the indices of the rays. They are sorted by ray, and along each ray by t and the key from `along`.
pub fn all<H: Send, N: Ord>(
    py: Python<'_>,
    rays: RaySlices<'_>,
    how: How<'_>,
    every: &(dyn Fn(&Ray, Report<'_, H>) + Sync),
    along: impl Fn(&H) -> (f32, N) + Sync,
) -> PyResult<(Vec<i64>, Vec<H>)> {
    let one = |ray: &Ray| {
        let mut hits = Vec::new();
        every(ray, &mut |hit| {
            hits.push(hit);
            ControlFlow::Continue(())
        });
        hits.sort_unstable_by(|a, b| {
            let ((t, name), (other_t, other_name)) = (along(a), along(b));
            t.total_cmp(&other_t).then(name.cmp(&other_name))
        });
        hits
    };
    let (mut index, mut found, mut ray) = (Vec::new(), Vec::new(), 0);
    each(py, rays, how, one, |hits| {
        index.resize(index.len() + hits.len(), ray);
        found.extend(hits);
        ray += 1;
    })?;
    Ok((index, found))
}

/// Finds the nearest point to each place, in a tree of `bytes` bytes.
pub fn nearest<A: Send + Clone>(
    py: Python<'_>,
    places: &PointArrays<'_>,
    bytes: usize,
    (workers, progress): How<'_>,
    one: &(dyn Fn(&ClosestPointQuery) -> Option<A> + Sync),
) -> PyResult<Vec<Option<A>>> {
    let points = rows(&places.0)?;
    let times = PerQuery::times(slice(&places.1)?, points.len())?;
    let most = PerQuery::new(slice(&places.2)?, points.len(), "max_distance")?;
    let query =
        |i: usize| ClosestPointQuery { point: DVec3::from(points[i]), time: times.of(i), max_distance: most.of(i) };
    let order = order(py, Places::Double(points), bytes)?;
    let mut answers = vec![None; points.len()];
    let run = |queries: &[u32]| queries.iter().map(|&i| one(&query(i as usize))).collect::<Vec<_>>();
    in_waves(py, &order, workers, progress, run, |queries, run| {
        queries.iter().zip(run).for_each(|(&query, answer)| answers[query as usize] = answer);
        Ok(())
    })?;
    Ok(answers)
}

/// A nearest point in the form of a hit: t is its distance.
pub fn on_surface(near: &ClosestPoint) -> Hit {
    Hit { t: near.distance, u: near.u, v: near.v, mesh: near.mesh, primitive: near.primitive }
}

/// The positions of nearest points, (m, 3); NaN if there is none.
pub fn positions<'py, 'a>(
    py: Python<'py>,
    found: impl Iterator<Item = Option<&'a ClosestPoint>> + Send,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let positions = found.map(|near| near.map_or([f64::NAN; 3], |near| near.point.to_array()));
    table(py, py.detach(|| positions.collect::<Vec<_>>()).into_flattened(), 3)
}

/// Hits as arrays.
pub fn columns<'py>(py: Python<'py>, hits: &[Hit]) -> Hits<'py> {
    let number = |of: fn(&Hit) -> f32| py.detach(|| hits.iter().map(of).collect::<Vec<_>>()).into_pyarray(py);
    // u32::MAX becomes -1.
    let mesh = py.detach(|| hits.iter().map(|hit| hit.mesh as i32).collect::<Vec<_>>());
    let triangle = py.detach(|| hits.iter().map(|hit| i64::from(hit.primitive as i32)).collect::<Vec<_>>());
    (number(|hit| hit.t), mesh.into_pyarray(py), triangle.into_pyarray(py), number(|hit| hit.u), number(|hit| hit.v))
}
