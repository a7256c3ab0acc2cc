//! Trees in files: what comes back, what is refused, and what a file made to deceive can not do.

// Under the name that the scenes use.
extern crate mbkd as engine;

#[path = "../support/blob.rs"]
mod blob;
mod damage;
mod forged;
mod machines;
mod points;
mod rays;
mod support;

/// The procedural scenes of the member `scenes`, included as source: a dependency on it would have the library compiled once more
/// for unit tests, and could not be published.
#[allow(dead_code, unused_imports)]
#[path = "../../scenes/src/lib.rs"]
mod scene;
