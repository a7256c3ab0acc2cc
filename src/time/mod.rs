//! Time slices: which subtrees get a temporal split, into how many slices, and the draft of a tree over one slice.

mod choose;
mod draft;
mod existence;
mod slices;
mod treelets;
mod trials;

pub(crate) use choose::{Region, regions};
pub(crate) use draft::{
    COST_MODEL, Draft, DraftParams, Reinsertion, TimeSlice, draft_sample, draft_tree, prefetch_blocks, time_slice,
};
pub(crate) use existence::{any_changes, held_in, share_of_slices};
pub(crate) use slices::SharedLeaves;
pub(crate) use trials::primitives;
