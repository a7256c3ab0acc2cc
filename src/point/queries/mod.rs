//! The queries as callers make them.

pub(super) mod approach;
pub(super) mod batch;
mod bounds;
pub(super) mod buffer;
pub(super) mod compiled;
pub(super) mod images;
pub(super) mod iter;
mod pair_approach;
pub(super) mod periodic;
mod periodic_approach;
mod periodic_batch;
pub(super) mod query;
mod tree_queries;
pub(super) mod visit;
