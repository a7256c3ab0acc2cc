//! The paper's k-d tree construction, for primitives and points alike: references are classified against split planes over
//! time intervals, duplicated and propagated.
//!
//! `classify` computes when an object is on which side of a plane, `partition` distributes references to the children,
//! `builder` is the recursion with its budgets, and every build results in a [`KdTree`]. The differences are behind
//! `reference::Moving`: `primitives` chooses planes by the surface area heuristic (`sah`) and rounds intervals outward,
//! `trajectories` splits at the median and has each point on exactly one side of a plane at every time.
//!
//! Source: X. Yang et al., "k-d Tree Construction Designed for Motion Blur".

mod build_times;
mod builder;
mod classify;
mod kd_file;
mod kd_tree;
mod links;
mod partition;
mod primitives;
mod reference;
mod sah;
mod trajectories;

pub(crate) use build_times::BuildTimes;
pub(crate) use kd_tree::{KdNode, KdReference, KdTree, KdView};
pub(crate) use links::{BadLink, check_links};
pub(crate) use primitives::build_kd;
pub(crate) use trajectories::{PointReference, Trajectories, Trajectory, build_kd_over_points};

#[cfg(test)]
mod tests;
