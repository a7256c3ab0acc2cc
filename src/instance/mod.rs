//! Trees with many moving instances: [`InstanceTree`].
//!
//! A tree is built once in its own local space. An [`Instance`] places it in the world by a [`Transform`] that may move during
//! the shutter. The tree over instances is the wide tree of the rest of the crate, whose leaves hold one instance each. A ray
//! that meets the box of an instance is transformed into the instance's space and traced in the tree there; `t` keeps its
//! meaning, since directions are not normalized. Trees of instances can be instanced themselves.

// Contents: transforms as they are given (`transform`) and as queries evaluate them (`motion`), the extent of the instanced
// tree (`extent`), bounds of moving instances (`bounds`), how far rounded rays deviate (`distortion`), the primitive set for the
// build of the wide tree (`placements`), the tree (`tree`), its counts and sizes (`statistics`), its traversal by rays
// (`traversal`), public queries (`tree_queries`), closest points (`closest_point`), and the surface at a hit with the rays that
// leave it (`surface`).

mod bounds;
mod closest_point;
#[cfg(test)]
mod closest_point_tests;
mod columns;
mod distortion;
mod error;
mod extent;
mod hit;
mod motion;
mod placements;
mod statistics;
mod surface;
mod transform;
mod traversal;
mod tree;
mod tree_queries;

pub use error::InstanceError;
pub use hit::{InstanceHit, InstancePath, InstancePoint, MAX_NESTING};
pub use statistics::InstanceStatistics;
pub use transform::{Pose, Transform};
pub use tree::{Instance, InstanceOf, InstanceTree};
