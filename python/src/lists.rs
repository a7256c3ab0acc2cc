//! Neighbour lists of all points, as compressed rows.

use crate::arrays::{slice, table, value_error};
use crate::points::Points;
use crate::threads::on;
use mbkd::point::NeighborColumns;
use mbkd::{ListError, NeighborCsr, Radii};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::intern;
use pyo3::prelude::*;

/// Offsets, ids, the points of the rows, and if asked for distances and displacements `(m, 3)`.
type Columns<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Option<Bound<'py, PyArray1<f32>>>,
    Option<Bound<'py, PyArray2<f32>>>,
);

/// The lists of all points at a time. `radii` has one element, or one for each point; then two points are neighbours where
/// either is within the radius of the other if `larger`, and each lists what is within its own otherwise.
#[pyfunction]
pub fn neighbor_lists<'py>(
    py: Python<'py>,
    points: &Points,
    time: f32,
    radii: PyReadonlyArray1<'py, f32>,
    larger: bool,
    among: Option<&Points>,
    pairs_once: bool,
    distances: bool,
    displacements: bool,
    sorted: bool,
    by_id: bool,
    workers: isize,
) -> PyResult<Columns<'py>> {
    let radii = match slice(&radii)? {
        &[radius] => Radii::Equal(radius),
        _ if larger && among.is_some() => {
            return Err(PyValueError::new_err("the larger of two radii needs those of both sets; give one radius"));
        }
        own if larger => Radii::Larger { own, others: own },
        own => Radii::Own(own),
    };
    let lists = on(py, workers, || {
        let mut query = points.tree.neighbor_lists(time, radii);
        query = if pairs_once { query.pairs_once() } else { query };
        query = if distances { query.with_distances() } else { query };
        query = if displacements { query.with_displacements() } else { query };
        query = if sorted { query.sorted() } else { query };
        query = if by_id { query.rows_by_id() } else { query };
        if let Some(among) = among {
            query = query.among(&among.tree);
        }
        if let Some(periods) = &points.periods {
            query = query.periodic(periods.for_lists());
        }
        let mut lists = NeighborCsr::new();
        query.run(&mut lists).map(|()| NeighborColumns::from(lists))
    })?
    .map_err(value_error)?;
    columns(py, lists)
}

/// The lists at a time with a radius and a skin, and until when they hold every pair within the radius.
#[pyfunction]
pub fn neighbor_lists_with_skin<'py>(
    py: Python<'py>,
    points: &Points,
    time: f32,
    radius: f32,
    skin: f32,
    until: f32,
    workers: isize,
) -> PyResult<(Columns<'py>, f32)> {
    if points.periods.is_some() {
        return Err(PyValueError::new_err("lists with a skin are not for periodic boxes"));
    }
    let made = on(py, workers, || {
        let mut lists = NeighborCsr::new();
        let valid_until = points.tree.neighbor_lists_with_skin(time, radius, skin, until, &mut lists)?;
        Ok::<_, ListError>((NeighborColumns::from(lists), valid_until))
    })?;
    let (lists, valid_until) = made.map_err(value_error)?;
    Ok((columns(py, lists)?, valid_until))
}

/// Hands the columns over to numpy.
fn columns(py: Python<'_>, lists: NeighborColumns) -> PyResult<Columns<'_>> {
    let NeighborColumns { offsets, points, ids, mut distances_squared, displacements } = lists;
    // Signed, as numpy and scipy count; no tree here has more than 2^31 points.
    let signed = |ids: Vec<u32>| ids.into_pyarray(py).call_method1(intern!(py, "view"), (intern!(py, "int32"),));
    let offsets: Vec<i64> = offsets.into_iter().map(|end| end as i64).collect();
    distances_squared.iter_mut().for_each(|d| *d = d.sqrt());
    let asked = |column: &Vec<f32>| column.len() == ids.len();
    let distances = asked(&distances_squared).then(|| distances_squared.into_pyarray(py));
    let [x, y, z] = &displacements;
    let ways = asked(x).then(|| x.iter().zip(y).zip(z).flat_map(|((&x, &y), &z)| [x, y, z]).collect());
    let ways = ways.map(|ways| table(py, ways, 3)).transpose()?;
    Ok((offsets.into_pyarray(py), signed(ids)?, signed(points)?, distances, ways))
}
