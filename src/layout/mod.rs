//! The wide layout: its nodes and leaf blocks, and how they are written. Statistics and validation of all
//! ray trees (wide, lazy, k-d).
//!
//! The wide tree has sixteen-way nodes with boxes that move linearly, and leaf blocks of up to sixteen primitives, all
//! in one arena. The picture to have in mind: a node is twelve rows of sixteen floats (lower and upper faces at time 0,
//! and their velocities) and a row of references to its children; one SIMD step tests a ray against all sixteen boxes
//! at the ray's own time. Static nodes have no velocity rows. A leaf block holds its triangles' corners in rows too, at
//! both ends of their motion, and is tested in one step; if triangles share vertices it holds each vertex once. A time
//! node selects one child by the ray's time, and may stand anywhere in the tree; its children may share leaf blocks.
//!
//! - `build` writes a draft (`crate::time`) in the format of `wide_node` and of the leaf blocks (`leaf`). Of a lazy tree the
//!   nodes near the root are written at once, and each subtree below them when a query first enters it.
//! - Then the tree is indexed in one pass (`leaf_index.rs`): corners are stored in leaf blocks only, and those of a single
//!   triangle are found there (`corners.rs`).
//! - `refit` gives a tree new positions; `check` checks finished trees, and those that were read from files.

mod block_intervals;
mod block_masks;
mod build;
mod check;
mod corners;
mod leaf;
mod leaf_index;
mod near;
mod node_boxes;
mod refit;
mod root_bounds;
mod statistics;
mod tree_box;
mod wide_file;
mod wide_node;
mod wide_tree;

pub(crate) use build::lazy_tree::LazyTree;
pub use check::validation_error::ValidationError;
pub(crate) use leaf::keyed::{KeyedLeaf, KeyedRows};
pub(crate) use leaf::lanes::{Between, CornerLanes, sphere_row};
pub(crate) use leaf::list_boxes::ListBoxes;
pub(crate) use leaf::source::WideSource;
pub(crate) use leaf::spheres::{SPHERE_ROWS, SphereLeaf};
pub(crate) use refit::built_place::BuiltPlace;
pub(crate) use refit::plan::RefitPlan;
pub(crate) use refit::refit_tree::Moved;
pub use statistics::Statistics;
pub(crate) use statistics::{Bytes, counted};
pub use tree_box::TreeBox;
pub(crate) use wide_node::{
    CORNER_ROWS, ChildRef, Kind, NODE_ROWS, STATIC_NODE_ROWS, VERTEX_ROWS, block_sizes, inverse_extent, shared_count,
};
pub(crate) use wide_tree::{BlockMasks, WideTree};
