//! What the trees are compared with.

mod brute_force;
mod spheres;

pub use brute_force::BruteForce;
