//! Rays that carry their own time, what they hit, and the triangle test.

mod batch_order;
mod closest_point;
mod collect;
mod filter;
mod hit;
mod interleave;
mod intersect;
mod kd_traversal;
mod leaf;
mod observer;
mod query;
mod ray_tree;
mod traverser;
mod tree_ray;
mod triangle;
mod visit;
mod walk;
mod wide_traversal;

#[cfg(test)]
mod wide_tests;

pub use crate::geometry::Ray;
pub(crate) use batch_order::{Space, answer_in_order, in_parallel};
pub(crate) use closest_point::closest_point_of_all;
pub use closest_point::{ClosestPoint, ClosestPointQuery};
pub(crate) use filter::{Everything, Filter, Visible};
pub use hit::Hit;
pub(crate) use interleave::{Anys, Asks, Batch, Closests};
pub use observer::{Counters, Observer};
pub(crate) use query::{AllQuery, AnyQuery, Asked, ClosestQuery, OfWide, Query};
pub use ray_tree::{Geometry, RayTree};
pub(crate) use tree_ray::TreeRay;
pub use visit::TreePrimitive;
