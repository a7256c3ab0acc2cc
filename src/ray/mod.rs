//! Ray trees: rays against moving geometry, each ray at its own time.
//!
//! [`RayTree::build`] takes triangle meshes, [`RayTree::of_scene`] meshes, spheres and the caller's own primitives
//! ([`Primitive`](crate::Primitive)) together, and [`RayTree::of_primitives`] primitives of one type; [`BuildParams`] selects the
//! tree. [`RayTree::closest_hit`], [`RayTree::any_hit`] and [`RayTree::all_hits`] answer one [`Ray`], their plural forms many.

mod batch;
mod batch_order;
mod candidates;
mod closest_point;
mod closest_point_queries;
mod collect;
mod compiled;
mod erased_shapes;
mod filter;
mod filtered_batches;
mod hit;
mod in_file;
mod interleave;
mod intersect;
mod kd_traversal;
mod lazy;
mod lazy_closest_point;
mod leaf;
mod nearest_first;
mod observer;
mod outline;
mod point_query;
mod query;
mod ray_layout;
mod ray_traversal;
mod ray_tree;
mod refit;
mod shear;
mod slabs;
mod stream;
mod traverser;
mod tree_ray;
mod triangle;
mod visit;
mod wide_traversal;

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
pub use closest_point::ClosestPoint;
pub(crate) use closest_point::closest_point_of_all;
pub(crate) use compiled::Guards;
pub(crate) use filter::{Everything, Filter, Visible};
pub use hit::Hit;
pub(crate) use nearest_first::{Leaves, NearestFirst};
pub use observer::{Counters, Observer};
pub(crate) use outline::{INNER_ULPS, Outline};
pub use point_query::ClosestPointQuery;
pub(crate) use point_query::{PlacedQuery, Query};
pub(crate) use ray_traversal::{LeafVisitor, RayTraversal};
pub use ray_tree::{Geometry, RayTree};
pub use refit::Refit;
pub(crate) use shear::Sheared;
pub(crate) use tree_ray::TreeRay;
pub use visit::TreePrimitive;
