//! References to compare the trees with: brute force, and the triangle test for other structures.

mod brute_force;
mod spheres;
mod triangle_tests;

pub use brute_force::BruteForce;
pub use triangle_tests::{PreparedRay, TriangleTests};
