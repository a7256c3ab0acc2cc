//! Errors of refits, in the words of the Python package.

use crate::arrays::value_error;
use mbkd::{BuildError, MAX_COORDINATE, Refit};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pyo3::create_exception!(
    mbkd,
    RefitError,
    PyValueError,
    "A tree cannot be refitted to these meshes: build a new one. The tree is unchanged, and answers as before."
);

/// What a refit has done: the relative cost of rays, whether the tree is worn, and numbers of nodes and of leaf blocks that were
/// written, of blocks that were kept, and of those that were not visited.
pub type Done = (f64, bool, [usize; 4]);

/// The result of a refit.
pub fn done(refit: Result<Refit, mbkd::RefitError>) -> PyResult<Done> {
    match refit {
        Ok(refit) => Ok((refit.cost, refit.is_worn(), [refit.nodes, refit.leaves, refit.kept, refit.skipped])),
        Err(error) => Err(refit_error(error)),
    }
}

/// Converts an error of a build of meshes and spheres.
pub fn build_error(error: BuildError) -> PyErr {
    match error {
        // Spheres are the only shapes here.
        BuildError::BadBounds { primitive } => PyValueError::new_err(format!(
            "sphere {primitive} is not finite, or reaches beyond {:e}; move or scale the scene",
            MAX_COORDINATE as f32
        )),
        error => value_error(error),
    }
}

/// Converts an error of a refit. What no tree could be built of either is not [`RefitError`].
fn refit_error(error: mbkd::RefitError) -> PyErr {
    let text = match error {
        mbkd::RefitError::Input(error) => return build_error(error),
        mbkd::RefitError::NoMesh { .. } => return value_error(error),
        mbkd::RefitError::FromFile => {
            "a tree that was loaded or unpickled cannot be refitted: build it of its meshes".into()
        }
        mbkd::RefitError::Keys { mesh, expected, found } => format!(
            "mesh {mesh} needs {found} keys after merging redundant ones, and the tree was built for {expected}: build it again \
             (with `keep_keys` all keys are kept)"
        ),
        mbkd::RefitError::ActiveShape { shape } => {
            format!("sphere {shape} exists at times at which it did not when the tree was built: build it again")
        }
        mbkd::RefitError::Shapes { expected, found } => {
            format!("the tree was built of {expected} spheres, not of {found}: build it again")
        }
        error => error.to_string(),
    };
    RefitError::new_err(text)
}
