//! The tree of points and its individual queries: k nearest, radius, counts, closest approach.

use crate::arrays::{Corners, PerQuery, Places, Positions, all_valid, corners, rows, slice, table, value_error, zeros};
use crate::files::{file_error, from_bytes, read, to_bytes};
use crate::periods::{Periods, period_error, periods_of};
use crate::point_builds::{build, exist, params, places_at, rebuild};
use crate::queries::{as_given, in_waves, order};
use crate::shared::Shared;
use crate::threads::long;
use mbkd::{Neighbor, NeighborBuffer, NeighborQuery, PeriodicPoints, PointTree, TimeInterval};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// A tree of points that may move, and that may exist during a part of the shutter only.
#[pyclass(frozen)]
pub struct Points {
    pub tree: Shared<PointTree>,
    /// The lengths of the periodic axes of a box.
    pub periods: Option<Periods>,
}

/// Distances and ids, and the id of missing neighbours.
type Nearest<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>, i64);

/// Offsets and ids.
type Lists<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i32>>);

/// Distances, ids and times.
type Approaches<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>);

/// An array of one number for each query, or of one number for all queries.
type Numbers<'py> = PyReadonlyArray1<'py, f32>;

#[pymethods]
impl Points {
    /// `keys`: positions (n, 3) at times spaced evenly over the shutter, all of one precision.
    #[new]
    fn new(
        py: Python<'_>,
        keys: Vec<Bound<'_, PyAny>>,
        active: Option<PyReadonlyArray2<'_, f32>>,
        boxsize: [f64; 3],
        structure: &str,
        max_references: f32,
        precision: &str,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Points> {
        let keys = keys.iter().map(Positions::of).collect::<PyResult<Vec<_>>>()?;
        let keys = places_at(&keys)?;
        let active = exist(active.as_ref())?;
        let (params, periods) = (params(structure, max_references, precision)?, periods_of(boxsize)?);
        let tree = long(py, workers, progress.as_ref(), |control| build(&keys, &active, &params, control))??;
        periodic(&tree, periods)?;
        Ok(Points { tree: Shared::new(tree), periods })
    }

    /// Puts other points into the tree, and returns whether it kept its order, which it may where all stand still. Copies the
    /// tree if others hold it: copies, and queries of other threads.
    fn rebuild(
        &self,
        py: Python<'_>,
        keys: Vec<Bound<'_, PyAny>>,
        active: Option<PyReadonlyArray2<'_, f32>>,
        structure: &str,
        max_references: f32,
        precision: &str,
        workers: isize,
    ) -> PyResult<bool> {
        let keys = keys.iter().map(Positions::of).collect::<PyResult<Vec<_>>>()?;
        let keys = places_at(&keys)?;
        let active = exist(active.as_ref())?;
        let params = params(structure, max_references, precision)?;
        let ([points], true) = (&keys[..], active.is_empty()) else {
            // A build, which may take long.
            let tree = long(py, workers, None, |control| build(&keys, &active, &params, control))??;
            periodic(&tree, self.periods)?;
            self.tree.change(py, workers, |old| *old = Arc::new(tree))?;
            return Ok(false);
        };
        self.tree.change(py, workers, |tree| {
            if self.periods.is_none() {
                return rebuild(Arc::make_mut(tree), *points, &params);
            }
            // The old tree stays if the new points lie too far apart for the box.
            let mut next = PointTree::clone(tree);
            let kept = rebuild(&mut next, *points, &params)?;
            periodic(&next, self.periods)?;
            *tree = Arc::new(next);
            Ok(kept)
        })?
    }

    /// Numbers the points in the order of the tree, and returns the numbers that they had.
    fn take_order<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let order = self.tree.change(py, 1, |tree| {
            let order = Arc::make_mut(tree).take_order();
            order.into_iter().map(i64::from).collect::<Vec<_>>()
        })?;
        Ok(order.into_pyarray(py))
    }

    /// Another tree with the same contents, which are copied when one of the two is changed.
    fn copy(&self, py: Python<'_>) -> PyResult<Points> {
        Ok(Points { tree: self.tree.copy(py)?, periods: self.periods })
    }

    /// Writes the tree to a file, without the periodic box.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let tree = self.tree.get(py)?;
        py.detach(|| tree.save(&path)).map_err(file_error)
    }

    /// Reads a tree from a file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, workers: isize) -> PyResult<Points> {
        indexed(py, read(py, workers, || PointTree::load(&path))?.map_err(file_error)?, None)
    }

    /// The bytes of a file of the tree, and the lengths of the periodic box.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyBytes>, Option<Periods>)> {
        let tree = self.tree.get(py)?;
        Ok((to_bytes(py, |bytes| tree.write_to(bytes))?, self.periods))
    }

    /// The tree from the bytes of a file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8], periods: Option<Periods>) -> PyResult<Points> {
        let tree = from_bytes(py, bytes, |bytes| PointTree::read_from(bytes))?;
        periodic(&tree, periods)?;
        indexed(py, tree, periods)
    }

    /// Number of points.
    #[getter]
    fn n(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.tree.get(py)?.len())
    }

    /// Memory of the tree in bytes.
    #[getter]
    fn nbytes(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.tree.get(py)?.statistics().bytes())
    }

    /// A box around everything; none if there is nothing.
    #[getter]
    fn bounds(&self, py: Python<'_>) -> PyResult<Option<Corners>> {
        Ok(corners(self.tree.get(py)?.bounds()))
    }

    /// The contents of the tree and the reasons for its structure, as text.
    fn statistics(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("{:#?}", self.tree.get(py)?.statistics()))
    }

    /// Distances and ids `(m, k)` of the k nearest points of each query, nearest first; `inf` and n for missing neighbours; and n.
    /// More neighbours than there are points would only take memory: then there are n columns, or one of an empty tree.
    fn query<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        times: Numbers<'py>,
        k: usize,
        eps: f32,
        bound: f32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Nearest<'py>> {
        let points = Positions::of(points)?;
        let places = points.places()?;
        let times = PerQuery::times(slice(&times)?, places.len())?;
        let tree = self.tree.get(py)?;
        let missing = tree.len() as i64;
        let k = k.min(tree.len()).max(1);
        let order = order(py, places, tree.statistics().bytes())?;
        let shape = (places.len(), k);
        let (distances, ids): (Bound<'_, PyArray2<f64>>, Bound<'_, PyArray2<i64>>) =
            (zeros(py, shape)?, zeros(py, shape)?);
        let (mut d, mut i) =
            (distances.try_readwrite().map_err(value_error)?, ids.try_readwrite().map_err(value_error)?);
        let (d, i): (&mut [f64], &mut [i64]) =
            (d.as_slice_mut().map_err(value_error)?, i.as_slice_mut().map_err(value_error)?);
        // As in scipy, a point at the bound itself does not count. If the square is too small for f32, all that were found have a
        // square of 0, and the bound is more than that.
        let square = bound * bound;
        let counts = |near: &&Neighbor| near.distance_squared < square || (square == 0.0 && bound > 0.0);
        let periodic = periodic(&tree, self.periods)?;
        let run = |queries: &[u32]| {
            let mut buffer = NeighborBuffer::new();
            let mut found: Vec<Neighbor> = Vec::with_capacity(queries.len() * k);
            let mut ends = Vec::with_capacity(queries.len());
            for &query in queries {
                let (query, time) = (query as usize, times.of(query as usize));
                match &periodic {
                    None => {
                        let query = query_at(&tree, places, query, time).radius(bound).approximate(eps);
                        match k {
                            1 => found.extend(query.nearest()),
                            _ => found.extend_from_slice(query.nearest_n_into(k, &mut buffer)),
                        }
                    }
                    Some(periodic) => {
                        let query = periodic.query(places.wide(query), time).radius(bound).approximate(eps);
                        match k {
                            1 => found.extend(query.nearest()),
                            _ => found.extend_from_slice(query.nearest_n_into(k, &mut buffer)),
                        }
                    }
                }
                ends.push(found.len());
            }
            (found, ends)
        };
        in_waves(py, &order, workers, progress.as_ref(), run, |queries, (found, ends)| {
            let mut begin = 0;
            for (&query, end) in queries.iter().zip(ends) {
                let row = query as usize * k..(query as usize + 1) * k;
                let (d, i) = (&mut d[row.clone()], &mut i[row]);
                let mut next = 0;
                for near in found[begin..end].iter().filter(counts) {
                    (d[next], i[next]) = (f64::from(near.distance_squared).sqrt(), near.id.into());
                    next += 1;
                }
                d[next..].fill(f64::INFINITY);
                i[next..].fill(missing);
                begin = end;
            }
            Ok(())
        })?;
        Ok((distances, ids, missing))
    }

    /// The points within the radius of each query: offsets `(m + 1)` and ids. With `max_neighbors` a longer list is an error.
    fn within<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        radii: Numbers<'py>,
        times: Numbers<'py>,
        sorted: bool,
        max_neighbors: Option<usize>,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Lists<'py>> {
        let points = Positions::of(points)?;
        let places = points.places()?;
        let times = PerQuery::times(slice(&times)?, places.len())?;
        let radii = radii_of(slice(&radii)?, places.len())?;
        let tree = self.tree.get(py)?;
        let periodic = periodic(&tree, self.periods)?;
        let run = |queries: &[u32]| {
            let mut buffer = NeighborBuffer::new();
            let (mut ids, mut ends) = (Vec::new(), Vec::with_capacity(queries.len()));
            for &number in queries {
                let query = number as usize;
                let (time, radius, begin) = (times.of(query), radii.of(query), ids.len());
                let near = match &periodic {
                    None => query_at(&tree, places, query, time).radius(radius).collect_into(&mut buffer),
                    Some(periodic) => periodic.query(places.wide(query), time).radius(radius).collect_into(&mut buffer),
                };
                if max_neighbors.is_some_and(|most| near.len() > most) {
                    return Err(number);
                }
                ids.extend(near.iter().map(|near| near.id as i32));
                if sorted {
                    ids[begin..].sort_unstable();
                }
                ends.push(ids.len());
            }
            Ok((ids, ends))
        };
        let order = order(py, places, tree.statistics().bytes())?;
        let mut runs: Vec<(Vec<i32>, Vec<usize>)> = Vec::new();
        in_waves(py, &order, workers, progress.as_ref(), run, |_, run| {
            let too_long =
                |query| PyValueError::new_err(format!("query {query} has more neighbours than `max_neighbors` allows"));
            runs.push(run.map_err(too_long)?);
            Ok(())
        })?;
        let (offsets, ids) = py.detach(|| in_order_of_queries(&order, &runs));
        Ok((offsets.into_pyarray(py), ids.into_pyarray(py)))
    }

    /// The number of points within the radius of each query.
    fn count<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        radii: Numbers<'py>,
        times: Numbers<'py>,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let points = Positions::of(points)?;
        let places = points.places()?;
        let times = PerQuery::times(slice(&times)?, places.len())?;
        let radii = radii_of(slice(&radii)?, places.len())?;
        let tree = self.tree.get(py)?;
        let order = order(py, places, tree.statistics().bytes())?;
        let mut counts = vec![0; places.len()];
        let periodic = periodic(&tree, self.periods)?;
        let one = |query: usize| count(&tree, (places, query), &periodic, times.of(query), radii.of(query));
        let run = |queries: &[u32]| queries.iter().map(|&query| one(query as usize)).collect::<Vec<_>>();
        in_waves(py, &order, workers, progress.as_ref(), run, |queries, run| {
            queries.iter().zip(run).for_each(|(&query, count)| counts[query as usize] = count);
            Ok(())
        })?;
        Ok(counts.into_pyarray(py))
    }

    /// For each radius, the number of pairs of a point of this tree and one of the other tree within that distance at a time.
    fn count_pairs(
        &self,
        py: Python<'_>,
        other: &Points,
        radii: Vec<f32>,
        time: f32,
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Vec<i64>> {
        if self.periods != other.periods {
            return Err(PyValueError::new_err("the two trees have different periodic boxes"));
        }
        let (tree, other) = (self.tree.get(py)?, other.tree.get(py)?);
        let periodic = periodic(&other, self.periods)?;
        PerQuery::times(&[time], 1)?;
        all_valid(&radii, "radius", "at index", NO_RADIUS, is_radius)?;
        // In the order of the tree.
        let places: Vec<[f64; 3]> =
            py.detach(|| tree.points_at(time).into_iter().map(|point| point.position.to_array()).collect());
        let (places, order) = (Places::Double(&places), as_given(places.len())?);
        let mut sums = vec![0; radii.len()];
        let run = |queries: &[u32]| {
            let mut counts = vec![0; radii.len()];
            for &query in queries {
                let place = (places, query as usize);
                counts
                    .iter_mut()
                    .zip(&radii)
                    .for_each(|(sum, &radius)| *sum += count(&other, place, &periodic, time, radius));
            }
            counts
        };
        in_waves(py, &order, workers, progress.as_ref(), run, |_, of_run| {
            sums.iter_mut().zip(of_run).for_each(|(sum, of_run)| *sum += of_run);
            Ok(())
        })?;
        Ok(sums)
    }

    /// The positions of all points at a time, `(n, 3)`; NaN for points that do not exist then.
    fn positions<'py>(&self, py: Python<'py>, time: f32) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PerQuery::times(&[time], 1)?;
        let tree = self.tree.get(py)?;
        let positions = py.detach(|| {
            let mut positions = vec![[f64::NAN; 3]; tree.len()];
            tree.points_at(time).into_iter().for_each(|point| positions[point.id as usize] = point.position.to_array());
            positions
        });
        table(py, positions.into_flattened(), 3)
    }

    /// The points that come nearest to queries that move from `from` to `to` between two times: distances, ids, times.
    fn closest_approach<'py>(
        &self,
        py: Python<'py>,
        from: PyReadonlyArray2<'py, f64>,
        to: PyReadonlyArray2<'py, f64>,
        between: [f32; 2],
        workers: isize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Approaches<'py>> {
        let (from, to) = (rows(&from)?, rows(&to)?);
        if from.len() != to.len() {
            return Err(PyValueError::new_err(format!("{} ends of {} ways", to.len(), from.len())));
        }
        let interval = TimeInterval::new(between[0], between[1]).map_err(value_error)?;
        let tree = self.tree.get(py)?;
        let periodic = periodic(&tree, self.periods)?;
        let order = as_given(from.len())?;
        let (mut d, mut i) = (vec![f64::INFINITY; from.len()], vec![tree.len() as i64; from.len()]);
        let mut t = vec![f64::NAN; from.len()];
        let run = |queries: &[u32]| {
            let one = |&query: &u32| {
                let (from, to) = (from[query as usize], to[query as usize]);
                match &periodic {
                    None => tree.closest_approach(from, to, interval),
                    Some(periodic) => periodic.closest_approach(from, to, interval),
                }
            };
            queries.iter().map(one).collect::<Vec<_>>()
        };
        in_waves(py, &order, workers, progress.as_ref(), run, |queries, run| {
            for (&query, near) in queries.iter().zip(run) {
                let place = query as usize;
                if let Some(near) = near {
                    (d[place], i[place], t[place]) = (near.distance.into(), near.id.into(), near.time.into());
                }
            }
            Ok(())
        })?;
        Ok((d.into_pyarray(py), i.into_pyarray(py), t.into_pyarray(py)))
    }
}

/// A query, without regard to the periodic box.
#[inline]
fn query_at<'a>(tree: &'a PointTree, places: Places<'_>, query: usize, time: f32) -> NeighborQuery<'a> {
    match places {
        Places::Single(rows) => tree.query(rows[query], time),
        Places::Double(rows) => tree.query(rows[query], time),
    }
}

/// The space that repeats, if it does.
fn periodic(tree: &PointTree, periods: Option<Periods>) -> PyResult<Option<PeriodicPoints<'_>>> {
    periods.map(|lengths| tree.periodic(lengths)).transpose().map_err(period_error)
}

/// The number of points within the radius of a query.
fn count(
    tree: &PointTree,
    (places, query): (Places<'_>, usize),
    periodic: &Option<PeriodicPoints<'_>>,
    time: f32,
    radius: f32,
) -> i64 {
    let count = match periodic {
        None => query_at(tree, places, query, time).radius(radius).count(),
        Some(periodic) => periodic.query(places.wide(query), time).radius(radius).count(),
    };
    count as i64
}

/// What is wrong with a number that is not a radius.
const NO_RADIUS: &str = "is negative or NaN";

fn is_radius(radius: f32) -> bool {
    radius >= 0.0
}

/// Checks the radii of queries.
fn radii_of(radii: &[f32], count: usize) -> PyResult<PerQuery<'_>> {
    all_valid(radii, "radius", "of query", NO_RADIUS, is_radius)?;
    PerQuery::new(radii, count, "r")
}

/// A tree whose ids are the indices of its points, as in all trees that are built here.
fn indexed(py: Python<'_>, tree: PointTree, periods: Option<Periods>) -> PyResult<Points> {
    let complete = py.detach(|| {
        let mut there = vec![false; tree.len()];
        // A tree for each time slice may have the same point.
        let valid = tree.ids().all(|id| there.get_mut(id as usize).map(|there| *there = true).is_some());
        valid && there.into_iter().all(|there| there)
    });
    if tree.len() > i32::MAX as usize || !complete {
        return Err(PyValueError::new_err("the ids of its points are not 0, 1, 2, ..."));
    }
    Ok(Points { tree: Shared::new(tree), periods })
}

/// Lists that were computed in another order than that of the queries.
fn in_order_of_queries(order: &[u32], runs: &[(Vec<i32>, Vec<usize>)]) -> (Vec<i64>, Vec<i32>) {
    let mut lists: Vec<&[i32]> = vec![&[]; order.len()];
    let made = runs.iter().flat_map(|(ids, ends)| {
        let begins = core::iter::once(0).chain(ends.iter().copied());
        begins.zip(ends).map(|(begin, &end)| &ids[begin..end])
    });
    order.iter().zip(made).for_each(|(&query, list)| lists[query as usize] = list);
    let mut offsets = Vec::with_capacity(order.len() + 1);
    offsets.push(0);
    let mut ids = Vec::with_capacity(lists.iter().map(|list| list.len()).sum());
    for list in lists {
        ids.extend_from_slice(list);
        offsets.push(ids.len() as i64);
    }
    (offsets, ids)
}
