//! The bounding volume hierarchy: object splits by binned SAH, reinsertion of subtrees, and the optimal collapse of the binary
//! tree into sixteen-way nodes. The picture: a binary tree over boxes that move linearly, of which each wide node absorbs the
//! levels that make it cheapest.

mod binning;
mod builder;
mod coarse_tree;
mod collapse;
mod costs;
mod join_leaves;
mod neighbourhoods;
mod partition;
mod presplit;
mod reference;
mod reinsertion;
mod replace_subtree;
mod visits;

pub(crate) use builder::{BinaryNode, BinaryTree, LeafKind, build_binary};
pub(crate) use coarse_tree::coarse_tree;
pub(crate) use collapse::{Collapse, WideChild};
pub(crate) use costs::{leaf_cost, motion_factor};
pub(crate) use join_leaves::join_leaves;
pub(crate) use neighbourhoods::neighbourhoods;
pub(crate) use presplit::presplit;
pub(crate) use reference::Reference;
pub(crate) use reinsertion::reinsert;
pub(crate) use replace_subtree::ReplacedSubtree;
pub(crate) use visits::{SurfaceDensity, mean_half_area};
