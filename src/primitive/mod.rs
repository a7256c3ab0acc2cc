//! Moving primitives: triangle meshes, spheres, caller-defined primitives, points.

mod bent_bounds;
mod check;
mod copy_meshes;
mod custom;
mod lane_bounds;
mod merge_keys;
mod mesh;
mod points;
mod precise;
mod precise_vertices;
mod scene;
mod scene_file;
mod sphere;
mod triangles;
mod triangles_file;
mod vertex_slack;

pub(crate) use bent_bounds::{TUBE_ULPS, Window};
pub use check::{PrimitiveError, check_primitive};
pub(crate) use custom::PrimitiveSet;
pub use custom::{Intersection, Primitive, Shapes, SurfacePoint};
pub(crate) use merge_keys::kept_keys;
pub use mesh::{Keys, TriangleMesh};
pub use points::{MovingPoint, PointArrays, PointColumns, PointSet, Position};
pub use scene::{Scene, Shape};
pub(crate) use scene_file::{SceneRecord, ShapesRecord};
pub use sphere::MovingSphere;
pub(crate) use triangles::Triangles;
