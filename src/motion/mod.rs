//! What moves: times and intervals of the shutter, keys, triangle meshes, spheres, the caller's own
//! primitives, and the linear bounds that hold them.
//!
//! The shutter is the normalized time range `[0, 1]` of one build. Positions are given at `n` keys
//! spaced evenly over it (one key: nothing moves) and are linear between keys.

mod bounds;
mod box3;
mod check;
mod clip;
mod frame;
mod interval;
mod keys;
mod mesh;
mod point;
mod primitive;
mod separate;
mod sphere;
mod triangles;

pub use bounds::{Aabb, LinearBounds};
pub(crate) use box3::{Box3, Extent, KERNEL_ULPS, Line, LinearBox3, ULP};
pub use check::{PrimitiveError, check_primitive};
pub(crate) use frame::Frame;
pub use interval::TimeInterval;
pub(crate) use keys::KeyTime;
pub use mesh::{Keys, TriangleMesh};
pub use point::{MovingPoint, PointArrays, PointColumns, PointSet, Position};
pub(crate) use primitive::PrimitiveSet;
pub use primitive::{Primitive, Shapes};
pub use sphere::MovingSphere;
pub use triangles::Triangles;

/// The largest magnitude a coordinate may have. Beyond it builds return an error.
pub const MAX_COORDINATE: f64 = 1e30;
