//! Exact neighbours of a point at a time, among points that move or live for a while.
//!
//! The picture to have in mind: a pyramid of 16-wide nodes over leaves of sixteen points. One vector
//! instruction tests sixteen boxes or sixteen points. Where points move, boxes move with them, linearly
//! in time; where points cross each other's cells, the paper's rule (cut them where they cross, with
//! time intervals) or a split of the shutter keeps the boxes tight. A set that stands still has a tree
//! without any of that.
//!
//! Data flows `primitive` (input) → `order` and `select` (who lies in which leaf) → `static_tree`
//! or `moving_tree` (layouts) → `snapshot` (a layout at a time) → `search` (the searches) → `query`
//! (what callers see).
//!
//! Sources: X. Yang et al., "k-d Tree Construction Designed for Motion Blur" for the cutting of what
//! crosses planes; the rest is ours and measured by `evidence/benches/neighbor_tables.rs` (docs/neighbors.md).

mod approach;
mod batch;
mod build;
mod byte_boxes;
mod choose;
mod error;
mod iter;
mod linear_bounds;
mod moving_reference;
mod moving_tree;
mod order;
mod partition;
mod plane_splits;
mod query;
mod search;
mod select;
mod snapshot;
mod static_tree;
mod stats;
mod tree;

pub use approach::Approach;
pub use batch::NeighborLists;
pub use error::PointError;
pub use iter::WithinIter;
pub use query::{NeighborBuffer, NeighborQuery};
pub use search::{KeepAll, KeepIf, NeighborWork};
pub use stats::{PointLayerKind, PointLayerStats, PointStats};
pub use tree::{MAX_POINT_COORDINATE, PointParams, PointStructure, PointTree};

/// A point that a query found.
#[derive(Clone, Copy, PartialEq, Debug)]
#[repr(C)]
pub struct Neighbor {
    /// The point's id: its index unless ids were given.
    pub id: u32,
    /// The squared distance, computed in f32 as `(dx·dx + dy·dy) + dz·dz`.
    pub distance_squared: f32,
}

impl Neighbor {
    /// The distance.
    pub fn distance(self) -> f32 {
        self.distance_squared.sqrt()
    }
}
