//! From references to trees: classification against split planes, costs, and the builders.

mod classify;
pub(crate) mod object;

pub(crate) use classify::{Plane, Sides, classify, classify_point};
