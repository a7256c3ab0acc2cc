//! Periodic boxes of points and photons.

use crate::arrays::value_error;
use mbkd::PeriodError;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The lengths of the periodic axes.
pub type Periods = [Option<f64>; 3];

/// The lengths of the periodic axes; `None` if there are none.
pub fn periods_of(boxsize: [f64; 3]) -> PyResult<Option<Periods>> {
    if let Some(length) = boxsize.iter().find(|length| !(**length >= 0.0 && length.is_finite())) {
        return Err(PyValueError::new_err(format!(
            "boxsize must be positive, or 0 or infinite for axes that are not periodic, not {length}"
        )));
    }
    let periods = boxsize.map(|length| (length > 0.0).then_some(length));
    Ok(periods.iter().any(Option::is_some).then_some(periods))
}

/// What Python says of points that a periodic box cannot hold.
pub fn period_error(error: PeriodError) -> PyErr {
    match error {
        PeriodError::Extent { axis } => PyValueError::new_err(format!(
            "points are more than sixteen periods of the periodic box apart along axis {axis}"
        )),
        error => value_error(error),
    }
}
