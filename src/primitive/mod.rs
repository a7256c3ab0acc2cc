//! Moving primitives: triangle meshes, spheres, caller-defined primitives, points.

mod bent_bounds;
mod check;
mod copy_meshes;
mod custom;
mod group_bounds;
mod lane_bounds;
mod merge_keys;
mod mesh;
mod points;
mod precise;
mod precise_vertices;
mod scene;
mod scene_file;
mod shared_vertices;
mod sphere;
mod triangles;
mod triangles_file;
mod tubes;
mod vertex_slack;
mod window;

pub use check::{PrimitiveError, check_primitive};
pub(crate) use custom::PrimitiveSet;
pub use custom::{Intersection, Primitive, Shapes, SurfacePoint};
pub(crate) use merge_keys::kept_keys;
pub use mesh::{Keys, TriangleMesh};
pub use points::{MovingPoint, PointArrays, PointColumns, PointSet, Position};
pub use scene::{Scene, Shape};
pub(crate) use scene_file::{SceneRecord, ShapesRecord};
pub(crate) use shared_vertices::Shared;
pub use sphere::MovingSphere;
pub(crate) use triangles::Triangles;
pub(crate) use tubes::{Faces, RowsOfKeys, at_corners, bounds_of_faces};
pub(crate) use window::{Intervals, Window};
