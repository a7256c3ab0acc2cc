//! Encounters of points during an interval, as compressed sparse rows.

use crate::arrays::value_error;
use crate::points::Points;
use crate::threads::on;
use mbkd::{Encounter, TimeInterval};
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Offsets and ids by point, and for each encounter its begin, its end, the time of closest approach, and the distance then.
type Encounters<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i32>>, [Bound<'py, PyArray1<f32>>; 4]);

/// The points that come within the radius of each point between two times. Row i belongs to point i and is sorted by id.
#[pyfunction]
pub fn neighbor_lists_swept<'py>(
    py: Python<'py>,
    points: &Points,
    between: [f32; 2],
    radius: f32,
    workers: isize,
) -> PyResult<Encounters<'py>> {
    if points.periods.is_some() {
        return Err(PyValueError::new_err("swept lists are not for periodic boxes"));
    }
    let interval = TimeInterval::new(between[0], between[1]).map_err(value_error)?;
    let found = on(py, workers, || {
        let lists = points.tree.neighbor_lists_swept(interval, radius)?;
        let mut rows: Vec<&[Encounter]> = vec![&[]; points.tree.len()];
        lists.iter().for_each(|(id, row)| rows[id as usize] = row);
        let (mut offsets, mut ids) = (Vec::with_capacity(rows.len() + 1), Vec::with_capacity(lists.encounters().len()));
        let mut columns = [const { Vec::new() }; 4];
        offsets.push(0);
        let mut sorted = Vec::new();
        for row in rows {
            sorted.clear();
            sorted.extend_from_slice(row);
            sorted.sort_unstable_by_key(|encounter| encounter.id);
            for e in &sorted {
                ids.push(e.id as i32);
                let values = [e.enter, e.leave, e.closest, e.distance_squared.sqrt()];
                columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
            }
            offsets.push(ids.len() as i64);
        }
        Ok::<_, mbkd::ListError>((offsets, ids, columns))
    })?;
    let (offsets, ids, columns) = found.map_err(value_error)?;
    Ok((offsets.into_pyarray(py), ids.into_pyarray(py), columns.map(|column| column.into_pyarray(py))))
}

/// The duration for which lists with a skin contain every pair within the radius, if no point is ever faster than `speed`.
#[pyfunction]
#[pyo3(text_signature = "(radius, skin, speed)")]
pub fn certified_duration(radius: f32, skin: f32, speed: f32) -> f32 {
    mbkd::certified_duration(radius, skin, speed)
}
