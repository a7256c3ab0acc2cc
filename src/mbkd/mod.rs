//! The paper's build: references are classified against split planes over time intervals, duplicated and propagated.
//!
//! Source: X. Yang et al., "k-d Tree Construction Designed for Motion Blur".

mod builder;
mod classify;
mod partition;
mod primitives;
mod reference;
mod sah;
mod trajectories;

pub(crate) use primitives::build_kd;
pub(crate) use trajectories::{PointReference, Trajectories, Trajectory, build_kd_over_points};

#[cfg(test)]
mod tests;
