//! Shared code of the measurements of `mbkd`: exact arithmetic, peers, timing. Never published.

pub mod ablations;
pub mod accuracy;
pub mod oracle;
pub mod pareto;
pub mod peers;
pub mod point_sets;
pub mod simple_kernels;
pub mod timing;
