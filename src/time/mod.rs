//! Time slices: which subtrees get a temporal split, into how many slices, and the draft of a tree over one slice.

mod choose;
mod draft;
mod slices;

pub(crate) use choose::{Region, params_of_each_tree, primitives, regions};
pub(crate) use draft::{COST_MODEL, Draft, TimeSlice, draft_tree, prefetch_blocks, time_slice};
pub(crate) use slices::SharedLeaves;
