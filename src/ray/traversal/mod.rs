//! Ray traversal of the layouts: what happens at nodes and leaves, for one ray and for batches.

pub(super) mod batch;
mod candidates;
pub(super) mod collect;
pub(super) mod interleave;
pub(super) mod intersect;
pub(super) mod kd_traversal;
pub(super) mod lazy;
mod leaf;
pub(super) mod object_traversal;
pub(super) mod query;
mod ray_layout;
mod shapes;
pub(super) mod stream;
mod traverser;
mod wide_traversal;
