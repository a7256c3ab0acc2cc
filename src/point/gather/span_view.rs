//! The view of a tree over space and time: one traversal for all distance measures.

use super::span_tree::{SpanBlock, SpanNode, SpanTree};
use crate::point::layout::shape::Shape;
use crate::point::layout::view::{LeafView, Target, View, diagonal};
use crate::simd::{Lanes, Mask, Simd, prefetch};
use glam::Vec3;

/// Distances of items and boxes from a query: infinite if they do not count.
pub(super) trait Measure<B>: Copy {
    /// See [`View::BALL`].
    const BALL: f32;
    /// Squared distances to the items of a block.
    fn distances<S: Simd>(&self, s: S, target: &Target<S>, block: &B) -> S::F;
    /// Squared distances to boxes, and which of them hold the query.
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: &SpanNode) -> (S::F, Mask);
    /// The effective squared diagonals of boxes, given those in space.
    fn sizes<S: Simd>(&self, s: S, target: &Target<S>, node: &SpanNode, in_space: S::F) -> S::F;
}

/// The tree at a time, with a distance measure.
#[derive(Clone, Copy)]
pub(super) struct SpanView<'a, B, L> {
    pub(super) tree: &'a SpanTree<B>,
    pub(super) time: f32,
    pub(super) measure: L,
}

impl<B: SpanBlock, L: Measure<B>> LeafView for SpanView<'_, B, L> {
    #[inline(always)]
    fn leaf_blocks(&self) -> usize {
        1
    }
    #[inline(always)]
    fn target<S: Simd>(&self, s: S, q: Vec3) -> Target<S> {
        Target { time: s.splat(self.time), ..Target::static_point(s, q) }
    }
    #[inline(always)]
    fn point_distances<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> S::F {
        self.measure.distances(s, target, &self.tree.blocks[block])
    }
    #[inline(always)]
    fn prefetch_leaf(&self, block: usize) {
        if let Some(block) = self.tree.blocks.get(block) {
            prefetch(block);
        }
    }
    #[inline(always)]
    fn leaf_bytes(&self) -> usize {
        size_of_val(&self.tree.blocks[..])
    }
    #[inline(always)]
    fn ids(&self, block: usize) -> &Lanes<u32> {
        self.tree.blocks[block].ids()
    }
}

impl<B: SpanBlock, L: Measure<B>> View for SpanView<'_, B, L> {
    const BALL: f32 = L::BALL;

    #[inline(always)]
    fn shape(&self) -> &Shape {
        &self.tree.shape
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> (S::F, Mask) {
        self.measure.boxes(s, target, &self.tree.nodes[node])
    }
    #[inline(always)]
    fn box_sizes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> S::F {
        let node = &self.tree.nodes[node];
        let (lo, hi) = node.in_space(s);
        self.measure.sizes(s, target, node, diagonal::<S>(lo, hi))
    }
    #[inline(always)]
    fn prefetch_node(&self, node: usize) {
        prefetch(&self.tree.nodes[node]);
    }
}
