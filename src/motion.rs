//! What moves and how: the shutter's time intervals, meshes, spheres, points, the caller's own primitives, and the
//! bounds that hold them.

pub use crate::geometry::{Aabb, LinearBounds, TimeInterval};
pub use crate::limits::{MAX_COORDINATE, MAX_POINT_COORDINATE};
pub use crate::primitive::{
    Intersection, Keys, MovingPoint, MovingSphere, PointArrays, PointColumns, PointSet, Position, Primitive,
    PrimitiveError, Scene, Shape, Shapes, SurfacePoint, TriangleMesh, check_primitive,
};
