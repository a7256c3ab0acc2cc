//! Neighbour lists: for every point of a tree all others within a radius. Particle methods need them in every step.
//!
//! Candidates are culled in three steps, from coarse to fine. Sixteen neighbouring leaves, the lanes of a bottom node,
//! traverse the tree together and collect the leaves that any of their points can reach ([`candidates`]). Of these,
//! each of the sixteen keeps the leaves that its own points can reach. Each point tests the boxes of those, and then
//! the points of the few blocks that are left ([`row`]). So boxes are compared with boxes, a point with boxes, and a
//! point with points, always sixteen at a time.
//!
//! Data flows `query` (the request) → `prepare` (groups of leaves) → `candidates` (the leaves that a group can reach) →
//! `row` (the lists of the points of a leaf, in a `list_writer`) → `worker` (a share of the groups) → `scheduling` and `make` (all
//! threads) → `neighbor_lists` (all lists in one array).
//!
//! [`bulk`] makes lists for positions that are not points of a tree. [`swept`] makes lists over an interval of time.
//!
//! Points in f64 are culled by their positions relative to the middle of the sixteen leaves, rounded to f32, and compared in f64
//! ([`coordinate`]).
//!
//! **Why no neighbour is lost.** The proof is that of [`super::layout::view`], with a box instead of the query point:
//! for `p` in `[lo, hi]` and `q` in `[lo', hi']`, consider the gap `max(lo − hi', lo' − hi, 0)`, each difference rounded
//! once. Along every axis it is at most the computed `|p − q|`, because rounding is monotone; so are squares and sums.
//! Only what is *strictly* farther than the bound is excluded. [`periodic_box`] treats periodic axes.

mod bulk;
mod candidates;
mod columns;
mod coordinate;
mod error;
mod gathered_points;
mod group;
mod list_request;
mod list_rows;
mod list_writer;
mod make;
mod neighbor_lists;
mod periodic_box;
mod prepare;
mod query;
mod radii;
mod reach;
mod reordering;
mod row;
mod row_moves;
mod scheduling;
mod swept;
mod worker;

pub use bulk::BulkQuery;
pub use error::{ListError, RadiusOf};
pub use neighbor_lists::NeighborLists;
pub use query::ListQuery;
pub use radii::Radii;
pub use swept::{Encounter, EncounterLists, SweptQuery, certified_duration};
