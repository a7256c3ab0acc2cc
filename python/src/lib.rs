//! The compiled part of the Python package `mbkd`: flat arrays in, flat arrays out.
//!
//! The Python modules (`mbkd/*.py`) implement shapes, defaults and the conventions of scipy and trimesh, and pass C-contiguous
//! arrays. All functions here check their input, release the GIL while they work on it, and return arrays without a copy.

// Keyword arguments of Python arrive here as parameters.
#![allow(clippy::too_many_arguments)]

mod arrays;
mod files;
mod instances;
mod lists;
mod meshes;
mod parts;
mod periods;
mod photons;
mod point_builds;
mod points;
mod queries;
mod rays;
mod refit;
mod shared;
mod surfaces;
mod swept;
mod threads;
mod traced;

use pyo3::prelude::*;

/// Neighbour and ray queries at a time.
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
    use crate::refit::RefitError;
    #[pymodule_export]
    use crate::swept::{certified_duration, neighbor_lists_swept};
}
