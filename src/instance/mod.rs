//! Trees with many moving instances: [`InstanceTree`].
//!
//! A tree is built once in its own local space. An [`Instance`] places it in the world by a [`Transform`] that may move during
//! the shutter. Trees of instances can be instanced themselves, up to [`MAX_NESTING`] levels.
//!
//! The tree over instances is the wide tree of the rest of the crate, whose leaves hold one instance each. A ray that meets the
//! box of an instance is transformed into the instance's space and traced in the tree there; `t` keeps its meaning, since
//! directions are not normalized. docs/rays.md is the guide.

// | module | contents |
// |---|---|
// | `transform`, `motion` | transforms as they are given, and as queries evaluate them |
// | `extent`, `bounds`, `distortion` | the extent of the instanced tree, bounds of moving instances, how far rounded rays deviate |
// | `placements`, `columns` | the primitive set for the build of the wide tree; matrices by columns |
// | `tree`, `statistics` | the tree; its counts and sizes |
// | `traversal`, `tree_queries`, `closest_point` | its traversal by rays; public queries; closest points |
// | `hit`, `surface` | answers; the surface at a hit, and rays that leave it |

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
