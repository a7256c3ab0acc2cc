//! Moving geometry: [`TriangleMesh`], [`MovingSphere`], custom [`Primitive`]s, points ([`MovingPoint`], [`PointSet`]), and their
//! bounds and time intervals.

pub use crate::geometry::{Aabb, LinearBounds, TimeInterval};
pub use crate::limits::{MAX_COORDINATE, MAX_POINT_COORDINATE};
pub use crate::primitive::{
    Intersection, Keys, MovingPoint, MovingSphere, PointArrays, PointColumns, PointSet, Position, Primitive,
    PrimitiveError, Shape, SurfacePoint, TriangleMesh, check_primitive,
};
