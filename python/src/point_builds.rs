//! Builds of point trees, from the arguments that they have in Python.

use crate::arrays::{Places, Positions, intervals, slice, value_error};
use crate::threads::Control;
use mbkd::{PointArrays, PointError, PointParams, PointStructure, PointTree, Precision, TimeInterval};
use numpy::PyReadonlyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The positions at each key.
pub fn places_at<'a>(keys: &'a [Positions<'_>]) -> PyResult<Vec<Places<'a>>> {
    let keys = keys.iter().map(Positions::places).collect::<PyResult<Vec<_>>>()?;
    if keys.iter().any(|key| key.len() > i32::MAX as usize) {
        return Err(PyValueError::new_err("more than 2^31 - 1 points"));
    }
    Ok(keys)
}

/// When each point exists; empty if all exist throughout.
pub fn exist(active: Option<&PyReadonlyArray2<'_, f32>>) -> PyResult<Vec<TimeInterval>> {
    active.map_or(Ok(Vec::new()), |rows| intervals(slice(rows)?.as_chunks().0, "point"))
}

/// The parameters with these names and numbers.
pub fn params(structure: &str, max_references: f32, precision: &str) -> PyResult<PointParams> {
    let (structure, precision) = (named(structure)?, kept(precision)?);
    Ok(PointParams { structure, max_references, precision, ..PointParams::default() })
}

/// The structure with this name.
fn named(structure: &str) -> PyResult<PointStructure> {
    match (structure, structure.strip_prefix("time_slices:").map(str::parse)) {
        ("automatic", _) => Ok(PointStructure::Automatic),
        ("linear", _) => Ok(PointStructure::Linear),
        ("kd", _) => Ok(PointStructure::Kd),
        (_, Some(Ok(slices))) => Ok(PointStructure::TimeSlices(slices)),
        _ => Err(PyValueError::new_err(format!(
            "structure must be 'automatic', 'linear', 'kd' or 'time_slices:N', not '{structure}'"
        ))),
    }
}

/// The precision with this name.
fn kept(precision: &str) -> PyResult<Precision> {
    match precision {
        "automatic" => Ok(Precision::Automatic),
        "float32" => Ok(Precision::Single),
        "float64" => Ok(Precision::Double),
        _ => Err(PyValueError::new_err(format!(
            "precision must be 'automatic', 'float32' or 'float64', not '{precision}'"
        ))),
    }
}

/// Builds a tree of positions at keys, all of one precision.
pub fn build(
    keys: &[Places<'_>],
    active: &[TimeInterval],
    params: &PointParams,
    control: &Control,
) -> PyResult<PointTree> {
    let hear = |done| control.report(done);
    let single: Option<Vec<&[[f32; 3]]>> =
        keys.iter().map(|key| if let Places::Single(rows) = key { Some(*rows) } else { None }).collect();
    let double: Option<Vec<&[[f64; 3]]>> =
        keys.iter().map(|key| if let Places::Double(rows) = key { Some(*rows) } else { None }).collect();
    match (single, double) {
        (Some(keys), _) => {
            PointTree::build_with_progress(&PointArrays { keys: &keys, active, ids: &[] }, params, &hear)
        }
        (_, Some(keys)) => {
            PointTree::build_with_progress(&PointArrays { keys: &keys, active, ids: &[] }, params, &hear)
        }
        _ => return Err(PyValueError::new_err("all keys must have one precision")),
    }
    .map_err(|error| point_error(error, params))
}

/// Rebuilds a tree of positions at one key, and returns whether it kept its order.
pub fn rebuild(tree: &mut PointTree, points: Places<'_>, params: &PointParams) -> PyResult<bool> {
    let rebuilt = match points {
        Places::Single(rows) => tree.rebuild(rows, params),
        Places::Double(rows) => tree.rebuild(rows, params),
    };
    rebuilt.map_err(|error| point_error(error, params))
}

/// Converts an error to the words of the arguments here.
fn point_error(error: PointError, params: &PointParams) -> PyErr {
    match (error, params.structure) {
        (PointError::Parameter { name: "structure", .. }, PointStructure::TimeSlices(_)) => {
            PyValueError::new_err("structure must have from 1 to 1024 time slices")
        }
        (PointError::Parameter { name: "structure", .. }, _) => PyValueError::new_err(
            "structure='kd' needs positions in float32; give float32 positions, or precision='float32'",
        ),
        (error, _) => value_error(error),
    }
}
