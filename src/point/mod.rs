//! Exact neighbour queries at a time, among points that may move and may exist for a part of the shutter only.
//!
//! - [`PointTree`] answers single queries and batches (docs/neighbors.md), and makes neighbour lists of whole sets, at a time or
//!   over an interval (docs/particles.md).
//! - [`PhotonMap`] gathers photons in space and time, [`VisiblePoints`] does the inverse (docs/gather.md).
//!
//! The picture to have in mind: a pyramid of sixteen-way nodes over leaves of sixteen points. One vector instruction tests
//! sixteen boxes or sixteen points. If points move, boxes move with them, linearly in time; if points cross each other's cells,
//! splitting the shutter keeps the boxes tight. A static set has a tree without any of that. The alternative is the k-d tree of
//! X. Yang et al., "k-d Tree Construction Designed for Motion Blur", in whose leaves points have time intervals.

// Data flows through the folders in this order; none imports from a later one (`tests/layers.rs`).
//
// | module | contents |
// |---|---|
// | `leaf_order` | assigning points to leaves |
// | `layout` | the trees in memory, and their views at a time |
// | `search` | the searches, each written once for all trees |
// | `build` | reading and checking a set, choosing a structure, building it |
// | `params`, `error`, `neighbor` | what callers pass to a tree and get from it |
// | `tree`, `statistics`, `rebuild`, `in_file` | `PointTree`: builds, statistics, rebuilds, files |
// | `queries` | the queries of a tree, single and in batches |
// | `lists` | neighbour lists of whole sets |
// | `gather` | photons |

mod build;
mod error;
mod gather;
mod in_file;
mod layout;
mod leaf_order;
mod lists;
mod neighbor;
mod params;
mod queries;
mod rebuild;
mod search;
mod statistics;
mod tree;

pub use crate::file::FileError;
pub use crate::primitive::{MovingPoint, PointArrays, PointColumns, PointSet, Position};
pub use error::PointError;
pub use gather::{
    Flux, GatherError, GatherParams, GatherQuery, Gathered, Kernel, PeriodicPhotons, Photon, PhotonMap, PhotonTime,
    VisiblePoint, VisiblePoints,
};
pub use lists::{
    BulkQuery, Encounter, EncounterLists, ListError, ListQuery, NeighborLists, Radii, RadiusOf, SweptQuery,
    certified_duration,
};
pub use neighbor::Neighbor;
pub use params::{PointParams, PointStructure, Precision};
pub use queries::approach::Approach;
pub use queries::batch::NeighborBatch;
pub use queries::buffer::NeighborBuffer;
pub use queries::iter::WithinIter;
pub use queries::periodic::{PeriodError, PeriodicPoints, PeriodicQuery};
pub use queries::query::NeighborQuery;
pub use queries::visit::TreePoint;
pub use search::{Keep, KeepAll, KeepIf, NeighborWork};
pub use statistics::{PointLayerKind, PointLayerStatistics, PointStatistics};
pub use tree::PointTree;
