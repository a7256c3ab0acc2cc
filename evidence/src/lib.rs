//! Shared code of the measurements of `mbkd`: exact arithmetic, peers, timing. Never published.

pub mod ablations;
pub mod accuracy;
mod options;
pub mod oracle;
pub mod pareto;
pub mod peers;
pub mod point_sets;
pub mod scene_rays;
pub mod simple_kernels;
pub mod timing;
pub mod triangles;
pub mod turns;

pub use options::options;
