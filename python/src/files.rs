//! Saving trees to files and to bytes.

use crate::arrays::value_error;
use crate::threads::on;
use mbkd::FileError;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::ffi::OsString;

/// Converts an error to a Python error: an `OSError` if reading or writing failed, else a `ValueError`.
pub fn file_error(error: FileError) -> PyErr {
    match os_error(&error) {
        Some(arguments) => PyOSError::new_err(arguments),
        None if matches!(error.cause(), FileError::Io(_)) => PyOSError::new_err(error.to_string()),
        None => value_error(error),
    }
}

/// The arguments of the `OSError` of a file with a name. The number selects the subclass, such as `FileNotFoundError`.
fn os_error(error: &FileError) -> Option<(i32, String, OsString)> {
    let FileError::At { path, error } = error else { return None };
    let FileError::Io(error) = &**error else { return None };
    let (number, text) = (error.raw_os_error()?, error.to_string());
    let what = text.split(" (os error").next().unwrap_or_default().to_owned();
    Some((number, what, path.as_os_str().to_owned()))
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

/// Runs the reading of a tree in a pool of this process with so many threads. (In the global pool of rayon, a forked process would
/// wait for threads that only its parent has.)
pub fn read<T: Send>(
    py: Python<'_>,
    workers: isize,
    work: impl FnOnce() -> Result<T, FileError> + Send,
) -> PyResult<Result<T, FileError>> {
    on(py, workers, work)
}

/// The result of `of`, which must consume all bytes.
pub fn from_bytes<T: Send>(
    py: Python<'_>,
    mut bytes: &[u8],
    of: impl FnOnce(&mut &[u8]) -> Result<T, FileError> + Send,
) -> PyResult<T> {
    // On one thread: several processes may get their trees at the same time.
    read(py, 1, || {
        let expected = bytes.len() as u64;
        let tree = of(&mut bytes)?;
        let found = expected - bytes.len() as u64;
        if bytes.is_empty() { Ok(tree) } else { Err(FileError::Length { expected: found, found: expected }) }
    })?
    .map_err(file_error)
}
