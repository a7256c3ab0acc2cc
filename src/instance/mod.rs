//! Trees placed many times, moving: [`InstanceTree`].
//!
//! The picture: a tree is built once in a space of its own. An [`Instance`] places it in the world by a [`Transform`]
//! that may move during the shutter. The tree over instances is the wide tree of the rest of the crate, whose leaves
//! hold one instance each. A ray that meets the box of an instance is mapped into the instance's space, where the tree
//! answers it; `t` keeps its meaning, since directions are not normalized. A tree of instances can be placed in turn.
//!
//! The files: transforms as given by the caller (`transform`) and as evaluated by queries (`motion`), the extent of
//! placed trees (`extent`), linear bounds of instances (`bounds`), the effect of transforms on rounding errors
//! (`distortion`), rejection of rays in the instance's space (`outline`), the primitive set that the build of the wide
//! tree sees (`placements`), the tree (`tree`), ray traversal (`query`), the public ray queries (`tree_queries`), and
//! closest points (`closest_point`).

mod bounds;
mod closest_point;
#[cfg(test)]
mod closest_point_tests;
mod distortion;
mod error;
mod extent;
mod hit;
mod motion;
mod outline;
mod placements;
mod query;
mod transform;
mod tree;
mod tree_queries;

pub use error::InstanceError;
pub use hit::{InstanceHit, InstancePath, InstancePoint, MAX_NESTING};
pub use transform::{Pose, Transform};
pub use tree::{Instance, InstanceOf, InstanceStatistics, InstanceTree};
