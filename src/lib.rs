//! Spatiotemporal k-d query engine.
#![deny(unsafe_code)]
#![allow(dead_code)] // while the pieces land

pub mod baseline;
mod build;
mod error;
mod motion;
mod neighbor;
mod ray;
pub mod scene;
mod simd;
mod tree;

pub use build::{BuildParams, Policy};
pub use error::{BuildError, IntervalError};
pub use glam;
pub use motion::{
    Aabb, Keys, LinearBounds, MAX_COORDINATE, MovingSphere, Primitive, PrimitiveError, Shapes, TimeInterval,
    TriangleMesh, Triangles, check_primitive,
};
pub use motion::{MovingPoint, PointArrays, PointColumns, PointSet, Position};
pub use neighbor::{
    Approach, KeepAll, KeepIf, MAX_POINT_COORDINATE, Neighbor, NeighborBuffer, NeighborLists, NeighborQuery,
    NeighborWork, PointError, PointLayerKind, PointLayerStats, PointParams, PointStats, PointStructure, PointTree,
    WithinIter,
};
pub use ray::{Counters, Hit, Intersection, Observer, Ray};
pub use simd::SimdLevel;
pub use tree::{Geometry, RayTree, Statistics, ValidationError};

/// The README's example, compiled as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
mod readme {}
