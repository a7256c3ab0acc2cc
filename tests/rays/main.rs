//! Rays against brute force: properties, scenes, bad input, metamorphic relations, counted work.

// Under the name that the scenes use.
extern crate mbkd as engine;

mod accuracy;
mod active;
mod bad_input;
mod batches;
mod brute_force;
mod clones;
mod closest_point;
mod common;
mod custom_shapes;
mod far_rays;
mod golden;
mod hairball;
mod hidden_instances;
mod instance_calls;
mod instances;
mod keys;
mod lazy;
mod local_rays;
mod masked_shapes;
mod metamorphic;
mod mixed;
mod paddings;
mod precise;
mod progress;
mod refit;
mod refit_moved;
mod refit_split;
mod scenes;
mod secondary_rays;
mod spheres;
mod unused_vertices;
mod visitors;
mod watertight;

/// The procedural scenes of the member `scenes`, included as source: a dependency on it would have the library compiled once more
/// for unit tests, and could not be published.
#[allow(dead_code, unused_imports)]
#[path = "../../scenes/src/lib.rs"]
mod scene;
