//! Bounds of triangles over time intervals: of one, of many at once, with two keys or more.

pub(super) mod bent_bounds;
pub(super) mod bounds_of_many;
pub(super) mod group_bounds;
pub(super) mod keys_of_vertices;
pub(super) mod shared_vertices;
pub(super) mod tubes;
pub(super) mod vertex_slack;
