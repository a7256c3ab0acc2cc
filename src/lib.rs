//! Spatiotemporal k-d query engine.
#![deny(unsafe_code)]
#![allow(dead_code)] // while the pieces land

mod build;
mod error;
mod motion;
mod neighbor;
mod ray;
mod simd;

pub use error::{BuildError, IntervalError};
pub use glam;
pub use motion::{Aabb, Keys, LinearBounds, MAX_COORDINATE, Primitive, TimeInterval, TriangleMesh};
pub use motion::{MovingPoint, PointArrays, PointColumns, PointSet, Position};
pub use neighbor::{
    KeepAll, KeepIf, MAX_POINT_COORDINATE, Neighbor, NeighborBuffer, NeighborQuery, NeighborWork, PointError,
    PointLayerKind, PointLayerStats, PointParams, PointStats, PointStructure, PointTree, WithinIter,
};
pub use ray::{Hit, Intersection, Ray};
pub use simd::SimdLevel;
