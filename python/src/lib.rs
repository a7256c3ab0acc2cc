//! The compiled part of the Python package `mbkd`: flat arrays in, flat arrays out.
//!
//! Shapes, defaults and the conventions of scipy and trimesh are the business of the package around it (`mbkd/*.py`),
//! which hands over C-contiguous arrays. Everything here checks its input, lets go of Python's lock while it works, and
//! returns arrays without copying them once more.

// What has names in Python comes here as parameters.
#![allow(clippy::too_many_arguments)]

mod arrays;
mod files;
mod images;
mod instances;
mod lists;
mod photons;
mod points;
mod queries;
mod rays;
mod swept;
mod threads;
mod traced;

use pyo3::prelude::*;

/// Neighbours and rays at a time.
#[pymodule]
mod _mbkd {
    #[pymodule_export]
    use crate::instances::Instances;
    #[pymodule_export]
    use crate::lists::{neighbor_lists, neighbor_lists_with_skin};
    #[pymodule_export]
    use crate::photons::Photons;
    #[pymodule_export]
    use crate::points::Points;
    #[pymodule_export]
    use crate::rays::Rays;
    #[pymodule_export]
    use crate::swept::{certified_duration, neighbor_lists_swept};
}
