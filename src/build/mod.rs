//! From references to trees: classification against split planes, costs, and the builders.

mod classify;
mod distribute;
mod kd;
pub(crate) mod object;
mod params;
mod progress;
mod reference;
mod sah;

pub(crate) use classify::{Plane, classify, classify_point};
pub(crate) use kd::build_kd;
pub(crate) use params::DEPTH_LIMIT;
pub use params::{BuildParams, Policy};
pub(crate) use progress::{Callback, Progress};
