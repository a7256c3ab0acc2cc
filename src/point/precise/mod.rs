//! Point trees that keep positions in f64.
//!
//! The picture to have in mind: the same pyramid of sixteen-wide nodes, but each node has a centre of its own in f64, and
//! boxes in f32 relative to it; so boxes are as fine as their contents, wherever these are. Leaves hold f64 positions. A
//! search needs only lower bounds of distances to boxes, and distances to points: [`tree`] provides both, and the
//! searches are the same as those of f32 points.
//!
//! The distance of a point is computed in f64 and rounded to f32 once; order, ties and radii use that number.

mod build;
mod fill_leaves;
mod in_file;
mod layer;
mod linear_box;
mod order;
mod over_interval;
mod query;
mod rounded_order;
mod tree;

pub(super) use in_file::PreciseRecord;
pub(super) use layer::{AtTime, PreciseLayer};
pub(super) use query::{Allowed, PreciseQuery};
pub(super) use tree::{PreciseTree, PreciseView, between};
