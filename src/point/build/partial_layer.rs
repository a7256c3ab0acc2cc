//! Layers of which one tree is built, for its searches to be counted before the others are.

use super::cost::{Visits, memory_cost, references_of};
use super::plan::{Plan, time_slices, tree};
use super::source::Source;
use crate::point::layout::moving_tree::MovingTree;
use crate::point::leaf_order::moving_reference::TimeSlice;
use crate::point::search::layers::Layer;
use crate::progress::Progress;
use crate::simd::SimdLevel;

/// A layer, and the reason for its plan.
pub(in crate::point) struct Chosen {
    pub(in crate::point) layer: Layer,
    pub(in crate::point) plan: Plan,
    /// Number of points.
    pub(in crate::point) points: usize,
    pub(in crate::point) why: String,
}

/// A layer of which one tree is built.
pub(in crate::point) struct PartialLayer<'a> {
    source: &'a Source,
    pub(in crate::point) points: &'a [u32],
    pub(in crate::point) plan: Plan,
    slices: Vec<TimeSlice>,
    /// The index of the time slice of that tree.
    at: usize,
    pub(in crate::point) tree: Layer,
}

impl<'a> PartialLayer<'a> {
    /// Builds the tree of a time slice in the middle.
    pub(in crate::point) fn new(
        source: &'a Source,
        points: &'a [u32],
        plan: Plan,
        progress: &Progress,
    ) -> PartialLayer<'a> {
        let slices = time_slices(source.keys, plan.time_slices());
        // Counted as progress once it is known whether it is used.
        let tree = tree(source, points, &slices[slices.len() / 2], &progress.subtask(0.0));
        PartialLayer::with(source, points, plan, tree)
    }

    /// The same with that tree.
    pub(in crate::point) fn with(
        source: &'a Source,
        points: &'a [u32],
        plan: Plan,
        tree: MovingTree,
    ) -> PartialLayer<'a> {
        let slices = time_slices(source.keys, plan.time_slices());
        let at = slices.len() / 2;
        PartialLayer { source, points, plan, slices, at, tree: Layer::Moving(vec![tree]) }
    }

    pub(in crate::point) fn slice(&self) -> &TimeSlice {
        &self.slices[self.at]
    }

    pub(in crate::point) fn references(&self) -> usize {
        references_of(self.source, self.points, self.plan.time_slices())
    }

    /// What searches in that tree visit.
    pub(in crate::point) fn visits(&self, simd: SimdLevel) -> Visits {
        Visits::among(self.source, self.points, &[&self.tree], self.slice(), simd)
    }

    /// The cost of those searches with that of the memory of all trees.
    pub(in crate::point) fn cost(&self, visits: Visits) -> f64 {
        visits.cost() + memory_cost(self.references())
    }

    /// Builds the other trees.
    pub(in crate::point) fn finish(self, why: String, progress: &Progress) -> Chosen {
        let share = progress.subtask(1.0 / self.slices.len() as f64);
        let mut ready = if let Layer::Moving(trees) = self.tree { trees } else { Vec::new() };
        let tree_of = |(i, slice): (usize, &TimeSlice)| match ready.pop_if(|_| i == self.at) {
            Some(tree) => {
                share.finished(1.0);
                tree
            }
            None => tree(self.source, self.points, slice, &share),
        };
        let layer = Layer::Moving(self.slices.iter().enumerate().map(tree_of).collect());
        Chosen { layer, plan: self.plan, points: self.points.len(), why }
    }
}

pub(in crate::point) fn name(plan: Plan) -> String {
    match plan {
        Plan::Boxes(1) => "one linear tree".to_string(),
        Plan::Boxes(slices) => format!("{slices} time slices"),
        Plan::Planes(_) => "one k-d tree".to_string(),
    }
}
