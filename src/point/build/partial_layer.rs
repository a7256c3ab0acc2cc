//! Layers of which one tree or two are built, for their searches to be counted before the others are.

use super::cost::Visits;
use super::layer_request::{ChosenLayer, LayerRequest};
use super::slice_points::points_of_slice;
use super::time_slices::{PROBABLE, moving_layer, time_slices, tree};
use crate::point::layout::moving_tree::{MovingTree, WithoutFast};
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::point::search::layers::Layer;
use crate::progress::Progress;

/// A layer of which one tree is built, or two.
pub(in crate::point) struct PartialLayer<'a> {
    pub(in crate::point) request: LayerRequest<'a>,
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
    pub(in crate::point) fn new(request: LayerRequest<'a>, per_segment: usize) -> PartialLayer<'a> {
        PartialLayer::at(request, per_segment, 0.5)
    }

    /// Builds the tree of the time slice that holds a time.
    pub(in crate::point) fn at(request: LayerRequest<'a>, per_segment: usize, time: f32) -> PartialLayer<'a> {
        let LayerRequest { source, points, progress, .. } = request;
        let slices = time_slices(source.keys, per_segment);
        let at = index_of(&slices, time);
        let existing = points_of_slice(source, points, &slices[at]);
        let progress = progress.rest(PROBABLE / slices.len() as f64);
        let WithoutFast { tree, by_motion, .. } =
            tree(source, &existing, &slices[at], None, &mut Vec::new(), &progress);
        let tree = Layer::Moving(vec![tree]);
        PartialLayer { request, per_segment, slices, at, tree, by_motion, other: None }
    }

    /// One time slice for each segment, where the tree between the keys in the middle is ready.
    pub(in crate::point) fn linear(request: LayerRequest<'a>, tree: MovingTree) -> PartialLayer<'a> {
        let slices = time_slices(request.source.keys, 1);
        let (at, tree) = (slices.len() / 2, Layer::Moving(vec![tree]));
        PartialLayer { request, per_segment: 1, slices, at, tree, by_motion: false, other: None }
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
    pub(in crate::point) fn visits(&self) -> Visits {
        Visits::among(self.request, &[&self.tree], self.slice())
    }

    /// Builds the other trees.
    pub(in crate::point) fn finish(self, why: String, progress: &Progress) -> ChosenLayer {
        let (LayerRequest { source, points, .. }, time_slices) = (self.request, self.per_segment);
        if self.slices.len() == 1 {
            return ChosenLayer { layer: self.tree, time_slices, points: points.len(), why };
        }
        let mut ready: Vec<(usize, MovingTree)> = Vec::new();
        for (at, tree) in [(self.at, self.tree)].into_iter().chain(self.other) {
            if let Layer::Moving(trees) = tree {
                ready.extend(trees.into_iter().map(|tree| (at, tree)));
            }
        }
        let layer = moving_layer(source, points, &self.slices, ready, progress);
        ChosenLayer { layer, time_slices, points: points.len(), why }
    }
}

/// The index of the time slice that holds a time.
fn index_of(slices: &[SegmentSlice], time: f32) -> usize {
    slices.partition_point(|slice| slice.interval.end_bound() <= time)
}
