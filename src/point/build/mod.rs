//! From a set of points to the layers of a tree: reading and checking it, choosing a structure, and building its trees.

pub(super) mod automatic;
mod cost;
mod excess;
mod own_trees;
mod partial_layer;
mod persistent_points;
pub(super) mod plan;
mod sample;
pub(super) mod source;
mod trials;
