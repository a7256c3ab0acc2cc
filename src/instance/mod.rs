//! Trees placed many times, moving: [`InstanceTree`].
//!
//! The picture: a tree is built once in a space of its own. An [`Instance`] places it in the world by a [`Transform`] that
//! may move during the shutter. The tree over instances is the wide tree of the rest of the crate, whose
//! leaves hold one instance each; a ray that meets the box of an instance is brought into the instance's space and asked of
//! the tree there, and `t` keeps its meaning on the way, since directions are not normalized. A tree of instances can be
//! placed in turn.
//!
//! What is where: transforms as they are given (`transform`) and as queries evaluate them (`motion`), where what is placed lies (`extent`), boxes that hold what
//! they move (`bounds`), how far they let rounded rays stray (`distortion`), which rays pass by what is placed (`outline`), the set that the build of the
//! wide tree sees (`placements`), the tree (`tree`), the way of a ray through it (`query`) and what callers ask (`tree_queries`),
//! nearest points (`closest_point`).

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
