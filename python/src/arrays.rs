//! Conversion of numpy arrays to slices. Invalid arrays raise Python errors.

use mbkd::{Aabb, TimeInterval};
use numpy::ndarray::Dimension;
use numpy::{Element, PyArray, PyArray2, PyArrayMethods, PyReadonlyArray, PyReadonlyArray2, dtype};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Converts an error of the library to a `ValueError` with its message.
pub fn value_error(error: impl core::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The elements of an array, which must be contiguous.
pub fn slice<'a, T: Element, D: Dimension>(array: &'a PyReadonlyArray<'_, T, D>) -> PyResult<&'a [T]> {
    array.as_slice().map_err(value_error)
}

/// An array of `(n, 3)` positions in its original precision.
pub enum Positions<'py> {
    /// float32.
    Single(PyReadonlyArray2<'py, f32>),
    /// float64.
    Double(PyReadonlyArray2<'py, f64>),
}

/// The positions as slices.
#[derive(Clone, Copy)]
pub enum Places<'a> {
    /// float32.
    Single(&'a [[f32; 3]]),
    /// float64.
    Double(&'a [[f64; 3]]),
}

impl<'py> Positions<'py> {
    /// Takes an array without conversion.
    pub fn of(array: &Bound<'py, PyAny>) -> PyResult<Positions<'py>> {
        if let Ok(array) = array.cast::<PyArray2<f32>>() {
            return Ok(Positions::Single(array.try_readonly().map_err(value_error)?));
        }
        match array.cast::<PyArray2<f64>>() {
            Ok(array) => Ok(Positions::Double(array.try_readonly().map_err(value_error)?)),
            Err(_) => Err(PyTypeError::new_err("positions must be an array (n, 3) of float32 or float64")),
        }
    }

    /// The rows.
    pub fn places(&self) -> PyResult<Places<'_>> {
        Ok(match self {
            Positions::Single(array) => Places::Single(rows(array)?),
            Positions::Double(array) => Places::Double(rows(array)?),
        })
    }
}

impl Places<'_> {
    /// The number of positions.
    pub fn len(&self) -> usize {
        match self {
            Places::Single(rows) => rows.len(),
            Places::Double(rows) => rows.len(),
        }
    }

    /// One position, exactly.
    pub fn wide(&self, i: usize) -> [f64; 3] {
        match self {
            Places::Single(rows) => rows[i].map(f64::from),
            Places::Double(rows) => rows[i],
        }
    }
}

/// The rows of an array `(n, 3)`.
pub fn rows<'a, T: Element>(array: &'a PyReadonlyArray<'_, T, numpy::Ix2>) -> PyResult<&'a [[T; 3]]> {
    if array.as_array().ncols() != 3 {
        return Err(PyValueError::new_err(format!(
            "positions have three coordinates, not {}; give flat ones a third that is zero",
            array.as_array().ncols()
        )));
    }
    Ok(slice(array)?.as_chunks().0)
}

/// One number for each query, or one for all queries.
#[derive(Clone, Copy)]
pub struct PerQuery<'a>(&'a [f32]);

impl<'a> PerQuery<'a> {
    /// Takes an array of length 1 or `count`.
    pub fn new(values: &'a [f32], count: usize, name: &str) -> PyResult<PerQuery<'a>> {
        if values.len() != 1 && values.len() != count {
            let found = values.len();
            return Err(PyValueError::new_err(format!("{name}: {found} values for {count} queries")));
        }
        Ok(PerQuery(values))
    }

    /// Takes an array of times, which must be in the shutter.
    pub fn times(values: &'a [f32], count: usize) -> PyResult<PerQuery<'a>> {
        all_valid(values, "time", "of query", "is not in [0, 1]: the first key is at 0, the last at 1", |time| {
            (0.0..=1.0).contains(&time)
        })?;
        PerQuery::new(values, count, "time")
    }

    /// The number for a query.
    #[inline]
    pub fn of(self, query: usize) -> f32 {
        if self.0.len() == 1 { self.0[0] } else { self.0[query] }
    }
}

/// Checks numbers. The error has the first one that is not valid, and where it is, if there are several.
pub fn all_valid(values: &[f32], name: &str, place: &str, wrong: &str, valid: impl Fn(f32) -> bool) -> PyResult<()> {
    let Some(i) = values.iter().position(|value| !valid(*value)) else { return Ok(()) };
    let place = if values.len() > 1 { format!(" {place} {i}") } else { String::new() };
    Err(PyValueError::new_err(format!("the {name} {}{place} {wrong}", values[i])))
}

/// Active intervals, from rows of begin and end. `of` is what has them.
pub fn intervals(rows: &[[f32; 2]], of: &str) -> PyResult<Vec<TimeInterval>> {
    rows.iter().enumerate().map(|(i, &row)| interval_of(row, of, i)).collect()
}

/// The active interval of one of them.
pub fn interval_of([begin, end]: [f32; 2], of: &str, i: usize) -> PyResult<TimeInterval> {
    TimeInterval::new(begin, end).map_err(|error| PyValueError::new_err(format!("{of} {i}: {error}")))
}

/// The lowest and the highest corner of a box.
pub type Corners = [[f64; 3]; 2];

/// The corners of a box, if there is one.
pub fn corners(bounds: Option<Aabb>) -> Option<Corners> {
    bounds.map(|bounds| [bounds.min.to_array(), bounds.max.to_array()])
}

/// An array of zeros, allocated by numpy, which requests huge pages. An error if memory does not suffice, where
/// [`PyArray::zeros`] panics.
pub fn zeros<'py, T: Element, D: Dimension>(
    py: Python<'py>,
    shape: impl IntoPyObject<'py>,
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    Ok(py.import("numpy")?.call_method1("zeros", (shape, dtype::<T>(py)))?.cast_into()?)
}

/// A vector as an array `(rows, columns)`, without a copy.
pub fn table<T: Element>(py: Python<'_>, elements: Vec<T>, columns: usize) -> PyResult<Bound<'_, PyArray2<T>>> {
    let rows = elements.len() / columns;
    PyArray::from_vec(py, elements).reshape([rows, columns])
}
