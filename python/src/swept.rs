//! Encounters of points during an interval, as compressed sparse rows.

use crate::arrays::{slice, value_error};
use crate::lists::{list_error, radii_of, radii_of_others};
use crate::points::Points;
use crate::threads::on;
use mbkd::{Encounter, TimeInterval};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

/// Offsets and ids by point, and for each encounter its begin, its end, the time of closest approach, and the distance then.
type Encounters<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i32>>, [Bound<'py, PyArray1<f32>>; 4]);

/// The points that come within a radius of each point between two times. Row i belongs to point i and is sorted by id. `radii`,
/// `larger`, `summed` and `radii_among` are as for lists at a time.
#[pyfunction]
pub fn neighbor_lists_swept<'py>(
    py: Python<'py>,
    points: &Points,
    between: [f32; 2],
    radii: PyReadonlyArray1<'py, f32>,
    larger: bool,
    summed: bool,
    among: Option<&Points>,
    radii_among: Option<PyReadonlyArray1<'py, f32>>,
    pairs_once: bool,
    max_neighbors: Option<usize>,
    workers: isize,
) -> PyResult<Encounters<'py>> {
    let interval = TimeInterval::new(between[0], between[1]).map_err(value_error)?;
    let radii = slice(&radii)?;
    let others = radii_of_others(radii, radii_among.as_ref(), among.is_some(), larger, summed)?;
    let (tree, among) = (points.tree.get(py)?, among.map(|among| among.tree.get(py)).transpose()?);
    let radii = radii_of(radii, others, larger, summed);
    let found = on(py, workers, || {
        let query = tree.neighbor_lists_swept(interval, radii).in_order().sorted();
        let query = among.as_deref().map_or(query, |among| query.among(among));
        let query = points.periods.map_or(query, |lengths| query.periodic(lengths));
        let query = if pairs_once { query.pairs_once() } else { query };
        let lists = max_neighbors.map_or(query, |most| query.max_neighbors(most)).collect()?;
        let offsets = lists.offsets().iter().map(|&offset| offset as i64).collect::<Vec<_>>();
        let column = |of: fn(&Encounter) -> f32| lists.encounters().iter().map(of).collect::<Vec<_>>();
        let ids = lists.encounters().iter().map(|encounter| encounter.id as i32).collect::<Vec<_>>();
        let columns =
            [column(|e| e.enter), column(|e| e.leave), column(|e| e.closest), column(|e| e.distance_squared.sqrt())];
        Ok::<_, mbkd::ListError>((offsets, ids, columns))
    })?;
    let (offsets, ids, columns) = found.map_err(list_error)?;
    Ok((offsets.into_pyarray(py), ids.into_pyarray(py), columns.map(|column| column.into_pyarray(py))))
}

/// The duration for which lists with a skin contain every pair within the radius, if no point is ever faster than `speed`.
#[pyfunction]
#[pyo3(text_signature = "(radius, skin, speed)")]
pub fn certified_duration(radius: f32, skin: f32, speed: f32) -> f32 {
    mbkd::certified_duration(radius, skin, speed)
}
