//! Ray trees: rays against moving geometry, each ray at its own time.
//!
//! - **Builds**: [`RayTree::build`] takes triangle meshes, [`RayTree::of_scene`] meshes, spheres and custom primitives
//!   ([`Primitive`](crate::Primitive)) together. [`BuildParams`] selects the tree.
//! - **Queries**: [`RayTree::closest_hit`], [`RayTree::any_hit`] and [`RayTree::all_hits`] answer one [`Ray`], the first two in
//!   their plural forms many. [`RayTree::closest_point`] finds the nearest surface.
//! - **The next frame**: [`RayTree::refit`].
//!
//! docs/rays.md is the guide.

// Data flows through the modules in this order; none imports from a later one (`tests/layers.rs`).
//
// | module | contents |
// |---|---|
// | `filter`, `hit`, `observer`, `guards` | what a query accepts, its answers, counted work |
// | `interaction` | the surface at a hit, and rays that leave it |
// | `kernel` | the arithmetic of one ray, against boxes and triangles |
// | `traversal` | traversals of the layouts by single rays and batches |
// | `closest_point` | the same for closest points |
// | `layout`, `queries` | the layouts, and all queries of them, compiled once in this crate |
// | `ray_tree`, `refit`, `in_file` | `RayTree`: builds and single queries, refits, files |
// | `batch_order`, `filtered_queries`, `filtered_batches`, `closest_point_queries`, `visit` | its other queries |
// | `bounds`, `surface` | boxes around all; corners, normals and points of what was hit |

mod batch_order;
mod bounds;
mod closest_point;
mod closest_point_queries;
mod filter;
mod filtered_batches;
mod filtered_queries;
mod guards;
mod hit;
mod in_file;
mod interaction;
mod kernel;
mod layout;
mod observer;
mod queries;
mod ray_tree;
mod refit;
mod surface;
mod traversal;
mod visit;

#[cfg(test)]
mod wide_tests;

pub use crate::error::{BuildError, RefitError};
pub use crate::file::FileError;
pub use crate::geometry::Ray;
pub use crate::layout::{Statistics, TreeBox, ValidationError};
pub use crate::params::{BuildParams, Division, KdParams, LazyParams, Policy, WideParams};
pub use crate::primitive::Intersection;
pub use crate::simd::SimdLevel;
pub use crate::traverse::Visitor;
pub(crate) use batch_order::{Indices, Space, answer_each, answer_in_order};
pub use closest_point::closest_search::ClosestPoint;
pub(crate) use closest_point::closest_search::closest_point_of_all;
pub(crate) use closest_point::nearest_first::{LeafSearch, NearestFirst};
pub use closest_point::point_query::ClosestPointQuery;
pub(crate) use closest_point::point_query::{PlacedQuery, QueryInTree};
pub(crate) use filter::{Everything, Filter, Offer, Visible};
pub(crate) use guards::Guards;
pub use hit::Hit;
pub(crate) use interaction::OF_COORDINATE;
pub use interaction::SurfaceInteraction;
pub(crate) use kernel::outline::{INNER_ULPS, Outline};
pub(crate) use kernel::shear::Sheared;
pub(crate) use kernel::tree_ray::TreeRay;
pub use observer::{Counters, Observer};
pub use ray_tree::RayTree;
pub use refit::Refit;
pub(crate) use traversal::object_traversal::{LeafVisitor, ObjectTraversal};
pub use visit::TreePrimitive;
