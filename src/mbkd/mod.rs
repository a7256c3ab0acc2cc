//! The paper's build: references are classified against split planes over time intervals, duplicated and propagated.
//!
//! Source: X. Yang et al., "k-d Tree Construction Designed for Motion Blur".

mod builder;
mod classify;
mod distribute;
mod reference;
mod sah;

pub(crate) use builder::build_kd;
pub(crate) use classify::classify_point;
