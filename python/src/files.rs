//! Saving trees to files and to bytes.

use crate::arrays::value_error;
use mbkd::FileError;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::Path;

/// Converts an error to a Python error: an `OSError` if reading or writing failed, else a `ValueError`.
pub fn file_error(error: FileError) -> PyErr {
    match error {
        FileError::Io(error) => PyOSError::new_err(error.to_string()),
        other => value_error(other),
    }
}

/// The same for a file with a name, which an `OSError` then contains. The error number selects the subclass, such as
/// `FileNotFoundError`.
pub fn error_at(path: &Path, error: FileError) -> PyErr {
    match error {
        FileError::Io(error) => match error.raw_os_error() {
            Some(number) => {
                let text = error.to_string();
                let what = text.split(" (os error").next().unwrap_or_default().to_owned();
                PyOSError::new_err((number, what, path.as_os_str().to_owned()))
            }
            None => file_error(FileError::Io(error)),
        },
        other => value_error(format!("{}: {other}", path.display())),
    }
}

/// The bytes that `write` writes.
pub fn to_bytes<'py>(
    py: Python<'py>,
    write: impl FnOnce(&mut Vec<u8>) -> Result<(), FileError> + Send,
) -> PyResult<Bound<'py, PyBytes>> {
    let mut bytes = Vec::new();
    py.detach(|| write(&mut bytes)).map_err(file_error)?;
    Ok(PyBytes::new(py, &bytes))
}

/// The result of `read`, which must consume all bytes.
pub fn from_bytes<T: Send>(
    py: Python<'_>,
    mut bytes: &[u8],
    read: impl FnOnce(&mut &[u8]) -> Result<T, FileError> + Send,
) -> PyResult<T> {
    py.detach(|| {
        let expected = bytes.len() as u64;
        let tree = read(&mut bytes)?;
        let found = expected - bytes.len() as u64;
        if bytes.is_empty() { Ok(tree) } else { Err(FileError::Length { expected: found, found: expected }) }
    })
    .map_err(file_error)
}
