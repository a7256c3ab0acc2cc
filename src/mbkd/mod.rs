//! The paper's build: references are classified against split planes over time intervals, duplicated and propagated.
//!
//! Source: X. Yang et al., "k-d Tree Construction Designed for Motion Blur".

mod builder;
mod classify;
mod distribute;
mod kd_tree;
mod reference;
mod sah;
mod times;

pub(crate) use builder::build_kd;
pub(crate) use classify::classify_point;
pub(crate) use kd_tree::{KdReference, KdTree, KdView};
pub(crate) use times::BuildTimes;
