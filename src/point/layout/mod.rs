//! The trees of points in memory: leaf blocks, boxes over them, and their views at a time.

pub(super) mod boxes;
pub(super) mod double_box;
pub(super) mod double_file;
mod double_over_interval;
pub(super) mod double_tree;
mod fill_leaves;
mod fill_moving_leaves;
pub(super) mod kd_file;
pub(super) mod kd_points;
pub(super) mod lane_intervals;
mod linear_bounds;
pub(super) mod linear_face;
pub(super) mod moving_file;
pub(super) mod moving_leaf;
pub(super) mod moving_tree;
mod moving_view;
pub(super) mod over_interval;
pub(super) mod shape;
pub(super) mod slice_tree;
pub(super) mod static_file;
pub(super) mod static_tree;
pub(super) mod view;
