//! Leaf blocks: one file for each kind, and what all kinds have in common.

pub(super) mod ids;
pub(super) mod key_rows;
pub(super) mod keyed;
pub(super) mod lanes;
pub(super) mod list_boxes;
pub(super) mod needed_segments;
pub(super) mod source;
pub(super) mod spheres;
pub(super) mod triangles;
