//! The layouts that queries walk, what they hold in numbers, and their validation.

mod kd;
mod ray_tree;
mod statistics;
mod validate;
pub(crate) mod wide;

pub(crate) use kd::{KdNode, KdReference, KdTree, KdView, MAX_NODES};
pub use ray_tree::{Geometry, RayTree};
pub(crate) use statistics::BuildTimes;
pub use statistics::Statistics;
pub use validate::ValidationError;
pub use wide::TreeBox;
