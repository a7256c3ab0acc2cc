//! Neighbour lists: for every point of a tree all others within a radius, as particle methods ask for them in every
//! step.
//!
//! The picture to have in mind: three sieves. Sixteen neighbouring leaves, the lanes of a bottom node, walk through the
//! tree together and [`gather`] the leaves that any of their points can reach. Each of the sixteen keeps of those what
//! its own points can reach, and each point tests the boxes of these, and then the points of the few blocks that are
//! left ([`row`]). Boxes are compared with boxes, a point with boxes, a point with points: sixteen at a time throughout.
//!
//! Data flows `query` (what is asked) → `prepare` (groups of leaves) → `gather` (candidates of a group) → `row` (the list
//! of a point) → `worker` (a share of the groups) → `in_turn` and `run` (all threads) → `csr` (all lists, one behind the other).
//!
//! [`bulk`] makes lists for places that are not points of a tree, [`swept`] makes lists over an interval of time, and
//! [`double`] makes those of points in f64, a search for each.
//!
//! **Why no neighbour is lost.** The proof is that of [`super::snapshot`], with a box in the place of the query point:
//! for `p` in `[lo, hi]` and `q` in `[lo', hi']` the gap `max(lo − hi', lo' − hi, 0)`, each difference rounded once, is
//! along every axis at most the computed `|p − q|`, because rounding is monotone; so are squares and sums. What is
//! *strictly* farther than the bound is left out. With periodic axes, [`torus`] says what is added.

mod bulk;
mod by_id;
mod columns;
mod csr;
mod double;
mod error;
mod gather;
mod group;
mod in_turn;
mod prepare;
mod query;
mod question;
mod radii;
mod reach;
mod row;
mod run;
mod swept;
mod torus;
mod worker;

pub use bulk::BulkQuery;
pub use csr::NeighborCsr;
pub use error::ListError;
pub use query::ListQuery;
pub use radii::Radii;
pub use swept::{Encounter, EncounterLists, certified_duration};
