//! Spatiotemporal k-d query engine.
#![deny(unsafe_code)]
#![allow(dead_code)] // while the pieces land

mod build;
mod error;
mod motion;
mod ray;
pub mod scene;
mod simd;
mod tree;

pub use error::{BuildError, IntervalError};
pub use glam;
pub use motion::{Aabb, Keys, LinearBounds, MAX_COORDINATE, Primitive, TimeInterval, TriangleMesh};
pub use ray::{Hit, Intersection, Ray};
pub use simd::SimdLevel;
