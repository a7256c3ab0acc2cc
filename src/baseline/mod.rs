//! What the trees are compared with.

mod brute_force;

pub use brute_force::BruteForce;
