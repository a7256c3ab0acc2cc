//! Time slices: which parts of a tree divide the shutter, into how many slices, and the draft of a tree over one.

mod choose;
mod draft;
mod slices;

pub(crate) use choose::{Region, params_of_copies, primitives, regions};
pub(crate) use draft::{PRICES, Plan, expect, part_of_shutter, plan_tree};
pub(crate) use slices::Segments;
