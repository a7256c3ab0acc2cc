//! Refitting a wide tree: new positions, the same structure.

pub(super) mod built_place;
pub(super) mod leaf_measure;
pub(super) mod leaf_rewrite;
pub(super) mod parts;
pub(super) mod plan;
pub(super) mod refit_tree;
pub(super) mod shared_blocks;
