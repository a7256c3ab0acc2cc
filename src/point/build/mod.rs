//! From a set of points to the layers of a tree: reading and checking it, choosing a structure, and building its trees.

mod active_trees;
pub(super) mod automatic;
mod cost;
mod double_tree;
mod excess;
mod fill_double_leaves;
pub(super) mod layer_request;
mod own_trees;
mod partial_layer;
mod sample;
mod slice_points;
pub(super) mod source;
pub(super) mod static_apart;
pub(super) mod time_slices;
mod trials;
