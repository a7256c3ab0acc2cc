//! Rays that carry their own time, what they hit, and the triangle test.

mod batch_order;
mod collect;
mod filter;
mod hit;
mod interleave;
mod kd_traversal;
mod leaf;
mod observer;
mod query;
mod query_ray;
mod ray_tree;
mod triangle;
mod wide_traversal;

#[cfg(test)]
mod wide_tests;

pub(crate) use batch_order::{Space, answer_in_order, in_parallel};
pub(crate) use filter::{Everything, Filter, Visible};
pub(crate) use hit::SetHit;
pub use hit::{Hit, Intersection};
pub(crate) use interleave::{Anys, Asks, Batch, Closests};
pub use observer::{Counters, Observer};
pub(crate) use query::{AllQuery, AnyQuery, Asked, ClosestQuery, OfWide, Query};
pub use query_ray::Ray;
pub(crate) use query_ray::TreeRay;
pub use ray_tree::{Geometry, RayTree};
pub(crate) use triangle::intersect_triangle;
