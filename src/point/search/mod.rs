//! The searches, each written once for every tree that has a view at a time.
//!
//! [`k_nearest`] traverses best-first by [`walk`], [`nearest`] does so in a loop of its own; [`radius`] needs no order
//! and uses masks alone. None of them allocates; results go to buffers of the caller.

pub(super) mod candidates;
pub(super) mod counted_search;
pub(super) mod k_nearest;
pub(super) mod kd_search;
mod keep;
mod keys;
pub(super) mod layers;
mod leaf_queue;
pub(super) mod nearest;
pub(super) mod radius;
pub(super) mod sinks;
pub(super) mod sort;
mod threshold;
pub(super) mod walk;
mod work;

pub(super) use keep::{Allowed, KeepLanes};
pub use keep::{Keep, KeepAll, KeepIf};
pub use work::NeighborWork;
pub(super) use work::Observe;
