//! The closest point on any primitive of a tree, at a time.

pub(super) mod closest_search;
pub(super) mod lazy_search;
pub(super) mod nearest_first;
pub(super) mod point_query;
mod stretch;
mod triangle_bound;
