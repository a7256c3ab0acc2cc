//! Rays that carry their own time, what they hit, and the triangle test.

mod hit;
mod query_ray;
mod triangle;

pub(crate) use hit::SetHit;
pub use hit::{Hit, Intersection};
pub use query_ray::Ray;
pub(crate) use query_ray::TreeRay;
pub(crate) use triangle::{Sheared, intersect_triangle};
