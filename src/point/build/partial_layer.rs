//! Layers of which one tree or two are built, for their searches to be counted before the others are.

use super::cost::Visits;
use super::slice_points::{points_of_slice, points_of_slices};
use super::source::Source;
use super::time_slices::{PROBABLE, time_slices, tree};
use crate::point::layout::moving_tree::{MovingTree, WithoutFast};
use crate::point::leaf_order::moving_reference::SegmentSlice;
use crate::point::search::layers::Layer;
use crate::progress::Progress;
use crate::simd::SimdLevel;
use std::borrow::Cow;

/// A layer, and the reason for its number of time slices.
pub(in crate::point) struct Chosen {
    pub(in crate::point) layer: Layer,
    /// Of each segment between keys.
    pub(in crate::point) time_slices: usize,
    /// Number of points.
    pub(in crate::point) points: usize,
    pub(in crate::point) why: String,
}

/// A layer of which one tree is built, or two.
pub(in crate::point) struct PartialLayer<'a> {
    source: &'a Source,
    pub(in crate::point) points: &'a [u32],
    /// Time slices of each segment between keys, a tree for each.
    pub(in crate::point) per_segment: usize,
    slices: Vec<SegmentSlice>,
    /// The index of the time slice of that tree.
    at: usize,
    pub(in crate::point) tree: Layer,
    /// Whether that tree is known to divide points by motion as well as by position.
    pub(in crate::point) by_motion: bool,
    /// The tree of another time slice, and the index of that.
    other: Option<(usize, Layer)>,
}

impl<'a> PartialLayer<'a> {
    /// Builds the tree of a time slice in the middle.
    pub(in crate::point) fn new(
        source: &'a Source,
        points: &'a [u32],
        per_segment: usize,
        progress: &Progress,
    ) -> PartialLayer<'a> {
        PartialLayer::at(source, points, per_segment, 0.5, progress)
    }

    /// Builds the tree of the time slice that holds a time.
    pub(in crate::point) fn at(
        source: &'a Source,
        points: &'a [u32],
        per_segment: usize,
        time: f32,
        progress: &Progress,
    ) -> PartialLayer<'a> {
        let slices = time_slices(source.keys, per_segment);
        let at = index_of(&slices, time);
        let existing = points_of_slice(source, points, &slices[at]);
        let progress = progress.rest(PROBABLE / slices.len() as f64);
        let WithoutFast { tree, by_motion, .. } = tree(source, &existing, &slices[at], &mut Vec::new(), &progress);
        let tree = Layer::Moving(vec![tree]);
        PartialLayer { source, points, per_segment, slices, at, tree, by_motion, other: None }
    }

    /// One time slice for each segment, where the tree between the keys in the middle is ready.
    pub(in crate::point) fn linear(source: &'a Source, points: &'a [u32], tree: MovingTree) -> PartialLayer<'a> {
        let slices = time_slices(source.keys, 1);
        let (at, tree) = (slices.len() / 2, Layer::Moving(vec![tree]));
        PartialLayer { source, points, per_segment: 1, slices, at, tree, by_motion: false, other: None }
    }

    /// Whether the tree that is built is that of the time slice that holds a time.
    pub(in crate::point) fn holds(&self, time: f32) -> bool {
        self.at == index_of(&self.slices, time)
    }

    /// Adds the tree of another one with as many slices for the same points.
    pub(in crate::point) fn and(mut self, other: PartialLayer<'a>) -> PartialLayer<'a> {
        self.other = Some((other.at, other.tree));
        self
    }

    pub(in crate::point) fn slice(&self) -> &SegmentSlice {
        &self.slices[self.at]
    }

    /// What searches in that tree visit.
    pub(in crate::point) fn visits(&self, simd: SimdLevel) -> Visits {
        Visits::among(self.source, self.points, &[&self.tree], self.slice(), simd)
    }

    /// Builds the other trees.
    pub(in crate::point) fn finish(self, why: String, progress: &Progress) -> Chosen {
        if self.slices.len() == 1 {
            return Chosen { layer: self.tree, time_slices: self.per_segment, points: self.points.len(), why };
        }
        let mut ready: Vec<(usize, MovingTree)> = Vec::new();
        for (at, tree) in [(self.at, self.tree)].into_iter().chain(self.other) {
            if let Layer::Moving(trees) = tree {
                ready.extend(trees.into_iter().map(|tree| (at, tree)));
            }
        }
        let progress = progress.in_units(self.slices.len() - ready.len());
        let existing = points_of_slices(self.source, self.points, &self.slices);
        let mut more = Vec::new();
        let tree_of = |(i, (slice, existing)): (usize, (&SegmentSlice, Cow<[u32]>))| match ready
            .iter()
            .position(|&(at, _)| at == i)
        {
            Some(place) => ready.swap_remove(place).1,
            None => tree(self.source, &existing, slice, &mut more, &progress.subtask(1.0)).tree,
        };
        let layer = Layer::Moving(self.slices.iter().zip(existing).enumerate().map(tree_of).collect());
        Chosen { layer, time_slices: self.per_segment, points: self.points.len(), why }
    }
}

/// The index of the time slice that holds a time.
fn index_of(slices: &[SegmentSlice], time: f32) -> usize {
    slices.partition_point(|slice| slice.interval.end_bound() <= time)
}

/// What so many time slices of each segment are called.
pub(in crate::point) fn name(per_segment: usize) -> String {
    match per_segment {
        1 => "one linear tree".to_string(),
        slices => format!("{slices} time slices"),
    }
}
