//! Building a wide tree: from a draft to nodes and leaf blocks in one arena, at once or lazily.

pub(super) mod assemble;
pub(super) mod budget;
pub(super) mod lazy_tree;
pub(super) mod left_out;
pub(super) mod wide_builder;
pub(super) mod write;
