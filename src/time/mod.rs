//! Time slices: which subtrees get a temporal split, into how many slices, and the draft of a tree over one slice.

mod draft;
mod drafting;
mod existence;
mod regions;
mod shared_leaves;
mod slice_bounds;
mod time_slice;
mod treelets;
mod trials;

pub(crate) use draft::Draft;
pub(crate) use drafting::{DraftParams, WhenToReinsert, draft_sample, draft_tree};
pub(crate) use existence::{any_changes, any_is_left_out, held_in, share_of_slices};
pub(crate) use regions::{Region, regions};
pub(crate) use shared_leaves::SharedLeaves;
pub(crate) use time_slice::{TimeSlice, time_slice};
