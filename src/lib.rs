//! Spatiotemporal k-d query engine.
#![deny(unsafe_code)]

mod simd;

pub use simd::SimdLevel;
