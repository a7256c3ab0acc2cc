//! Baselines that the trees are compared with.

mod brute_force;
mod spheres;
mod triangle_tests;

pub use brute_force::BruteForce;
pub use triangle_tests::{PreparedRay, TriangleTests};
