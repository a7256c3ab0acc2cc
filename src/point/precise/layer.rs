//! A layer of f64 points: trees for successive time slices.

use super::tree::{PreciseTree, PreciseView};
use crate::point::layout::slice_tree::slice_at;
use glam::DVec3;

/// Trees for successive time slices, without a gap; a single one if all points are static.
#[derive(Clone)]
pub(in crate::point) struct PreciseLayer {
    pub(in crate::point) trees: Vec<PreciseTree>,
}

/// A layer at a time, seen from a query point.
pub(in crate::point) enum AtTime<'a> {
    Static(PreciseView<'a, false>),
    Moving(PreciseView<'a, true>),
}

impl PreciseLayer {
    /// The index of the tree that is responsible for a time in [0, 1].
    pub(in crate::point) fn slice_at(&self, time: f32) -> usize {
        slice_at(&self.trees, time)
    }

    /// The tree that is responsible for a time in [0, 1].
    pub(in crate::point) fn tree_at(&self, time: f32) -> &PreciseTree {
        &self.trees[self.slice_at(time)]
    }

    #[inline(always)]
    pub(in crate::point) fn at(&self, point: DVec3, time: f32) -> AtTime<'_> {
        let tree = self.tree_at(time);
        if tree.moves() { AtTime::Moving(tree.at(point, time)) } else { AtTime::Static(tree.at(point, time)) }
    }
}
