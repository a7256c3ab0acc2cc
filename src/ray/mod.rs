//! Rays that carry their own time, what they hit, and the triangle test.

mod filter;
mod hit;
pub(crate) mod kd;
mod observer;
mod query_ray;
mod triangle;

pub(crate) use filter::{Everything, Filter, Visible};
pub(crate) use hit::SetHit;
pub use hit::{Hit, Intersection};
pub use observer::{Counters, Observer};
pub use query_ray::Ray;
pub(crate) use query_ray::TreeRay;
pub(crate) use triangle::{Sheared, hit_slack, intersect_triangle};
