//! Assigning points to leaves: divided by position, by motion, and put in the order of a complete tree.

pub(super) mod bottom_order;
pub(super) mod complete_tree;
pub(super) mod divide;
pub(super) mod double_order;
pub(super) mod fast_points;
pub(super) mod motion_groups;
pub(super) mod moving_reference;
pub(super) mod order;
pub(super) mod point_rows;
pub(super) mod rounded_order;
pub(super) mod segment_slice;
pub(super) mod selection;
pub(super) mod spread;
pub(super) mod widest_axis;
