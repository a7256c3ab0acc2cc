//! Exact neighbour queries at a time, among points that may move and may exist for a part of the shutter only.
//!
//! The picture to have in mind: a pyramid of 16-wide nodes over leaves of sixteen points. One vector
//! instruction tests sixteen boxes or sixteen points. If points move, boxes move with them, linearly
//! in time; if points cross each other's cells, splitting the shutter keeps the boxes tight. A static set
//! has a tree without any of that. The alternative is the paper's k-d tree, in whose leaves points have time intervals.
//!
//! Data flows `primitive` (input) → `source` (reading and checking) → `order` and `select` (assigning points to leaves)
//! → `static_tree` or `moving_tree`, or `crate::mbkd` → `plane_tree` (layouts) → `snapshot`, `moving_view` (a layout at
//! a time) → `search` (the searches) → `query` (the interface).
//!
//! Sources: X. Yang et al., "k-d Tree Construction Designed for Motion Blur" for the k-d tree; the rest is new here and
//! measured by `evidence/benches/neighbor_tables.rs` (docs/neighbors.md).

mod approach;
mod automatic;
mod batch;
mod bottom_order;
mod build;
mod compiled;
mod complete_tree;
mod counted_search;
mod divide;
mod error;
mod fast_points;
mod fill_leaves;
mod fill_moving_leaves;
mod gather;
mod in_file;
mod iter;
mod layers;
mod linear_bounds;
mod linear_face;
mod lists;
mod motion_groups;
mod moving_file;
mod moving_leaf;
mod moving_reference;
mod moving_tree;
mod moving_view;
mod neighbor;
mod order;
mod over_interval;
mod pair_approach;
mod persistent_points;
mod plane_file;
mod plane_tree;
mod point_rows;
mod precise;
mod query;
mod rebuild;
mod sample;
mod search;
mod select;
mod slice_tree;
mod snapshot;
mod source;
mod spread;
mod static_file;
mod static_tree;
mod statistics;
mod tree;
mod tree_queries;
mod trials;
mod visit;
mod widest_axis;

pub use crate::file::FileError;
pub use crate::primitive::{MovingPoint, PointArrays, PointColumns, PointSet, Position};
pub use approach::Approach;
pub use batch::NeighborLists;
pub use error::PointError;
pub use gather::{
    Flux, GatherError, GatherParams, GatherQuery, GatherScratch, Gathered, Kernel, Photon, PhotonMap, PhotonTime,
    VisiblePoint, VisiblePoints,
};
pub use iter::WithinIter;
pub use lists::{BulkQuery, Encounter, EncounterLists, ListError, ListQuery, NeighborCsr, Radii, certified_duration};
pub use neighbor::Neighbor;
pub use query::{NeighborBuffer, NeighborQuery};
pub use search::{KeepAll, KeepIf, NeighborWork};
pub use statistics::{PointLayerKind, PointLayerStatistics, PointStatistics};
pub use tree::{PointParams, PointStructure, PointTree};
pub use visit::TreePoint;
