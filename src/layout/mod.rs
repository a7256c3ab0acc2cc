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
//! Of a lazy tree (`lazy_tree`) the nodes near the root are written at once, and each subtree below them when a query
//! first enters it.
//!
//! A draft (`crate::time`) is written (`wide_builder`, `write`) in the format of `wide_node` and the leaf blocks, and
//! assembled (`assemble`). Then the tree is indexed in one pass (`leaf_index`): corners are stored in leaf blocks
//! only, and those of a single triangle are found there (`corners`).

mod assemble;
mod block_masks;
mod budget;
mod built_place;
mod corners;
mod kd_check;
mod kd_validate;
mod key_rows;
mod keyed_leaf;
mod lazy_tree;
mod lazy_validate;
mod leaf_ids;
mod leaf_index;
mod leaf_lanes;
mod leaf_measure;
mod leaf_rewrite;
mod left_out;
mod list_boxes;
mod needed_segments;
mod node_boxes;
mod refit;
mod refit_parts;
mod refit_plan;
mod root_bounds;
mod shared_blocks;
mod sphere_leaf;
mod statistics;
mod tree_box;
mod triangle_leaf;
mod validation_error;
mod wide_builder;
mod wide_check;
mod wide_file;
mod wide_node;
mod wide_source;
mod wide_tree;
mod wide_validate;
mod write;

pub(crate) use built_place::BuiltPlace;
pub(crate) use keyed_leaf::{KeyedLeaf, KeyedRows};
pub(crate) use lazy_tree::LazyTree;
pub(crate) use leaf_lanes::{Between, CornerLanes, sphere_row};
pub(crate) use list_boxes::ListBoxes;
pub(crate) use refit::Moved;
pub(crate) use refit_plan::RefitPlan;
pub(crate) use sphere_leaf::{SPHERE_ROWS, SphereLeaf};
pub use statistics::Statistics;
pub(crate) use statistics::{Bytes, counted};
pub use tree_box::TreeBox;
pub use validation_error::ValidationError;
pub(crate) use wide_node::{
    CORNER_ROWS, ChildRef, Kind, NODE_ROWS, STATIC_NODE_ROWS, VERTEX_ROWS, block_sizes, inverse_extent, shared_count,
};
pub(crate) use wide_source::WideSource;
pub(crate) use wide_tree::{BlockMasks, WideTree};
