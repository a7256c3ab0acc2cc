//! What the steps of a query cost, relative to each other.

use crate::tuning::wide::{LEAF_COST, PRIMITIVE_COST, STATIC_FACTOR};

/// The cost of visiting a leaf block with this many primitives, if it moves.
pub(crate) fn leaf_cost(primitives: usize) -> f32 {
    LEAF_COST + PRIMITIVE_COST * primitives as f32
}

/// The factor on the cost of a node or leaf block: those that do not move cost less.
#[inline(always)]
pub(crate) fn motion_factor(moving: bool) -> f32 {
    if moving { 1.0 } else { STATIC_FACTOR }
}
