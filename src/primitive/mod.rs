//! Moving primitives: triangle meshes, spheres, custom primitives, points.

mod bounds;
mod check;
mod custom;
mod intersection;
mod key_window;
mod mesh;
mod points;
mod primitive_set;
mod scene;
mod scene_file;
mod shape;
mod shape_list;
mod shapes;
mod sphere;
mod sphere_primitive;
mod triangles;

pub(crate) use bounds::shared_vertices::Shared;
pub(crate) use bounds::tubes::{FaceLanes, RowsOfKeys, at_corners, bounds_of_faces};
pub use check::{PrimitiveError, check_primitive};
pub use custom::Primitive;
pub use intersection::{Intersection, SurfacePoint};
pub(crate) use key_window::{Intervals, Window};
pub(crate) use mesh::merge_keys::{DOUBLE, SINGLE, kept_keys, widest_step};
pub use mesh::triangle_mesh::{Keys, TriangleMesh};
pub use points::{MovingPoint, PointArrays, PointColumns, PointSet, Position};
pub(crate) use primitive_set::PrimitiveSet;
pub(crate) use scene::{OtherShapes, Scene};
pub(crate) use scene_file::SceneRecord;
pub use shape::Shape;
pub(crate) use shape_list::{ShapeList, no_shapes};
pub(crate) use shapes::SPHERE_KEY_BYTES;
pub use sphere::MovingSphere;
pub(crate) use sphere::SPHERE_ROUNDING;
pub(crate) use triangles::triangle_set::Triangles;
