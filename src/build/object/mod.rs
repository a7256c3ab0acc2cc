//! Object splits: a partition of the references by binned SAH, and its optimal collapse into sixteen-way
//! nodes. The picture: a binary tree over boxes that move linearly, of which each wide node swallows the
//! part that pays.

mod binned;
mod bins;
mod collapse;
mod graft;
mod partition;
mod reference;
mod spatial;

pub(crate) use binned::{BinaryNode, BinaryTree, build_binary, mean_half_area, neighbourhoods};
pub(crate) use collapse::{Collapse, Prices, WideChild};
pub(crate) use graft::Graft;
pub(crate) use reference::Reference;
pub(crate) use spatial::{Ends, cut};
