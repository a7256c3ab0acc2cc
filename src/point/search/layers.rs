//! Layers: a static tree, or moving trees for successive time slices.
//!
//! A set may be divided among layers, static points separate from moving ones. A search goes through the layers one after
//! the other with the same candidates and the same bound.

use crate::point::layout::moving_tree::{MovingTree, MovingView};
use crate::point::layout::over_interval::BlockTree;
use crate::point::layout::plane_tree::{PlaneTree, PlaneView};
use crate::point::layout::slice_tree::slice_at;
use crate::point::layout::static_tree::StaticTree;
use crate::point::layout::view::LeafView;
use crate::point::search::k_nearest::KNearest;
use crate::point::search::nearest::Best;
use crate::point::search::radius::{Sink, within};
use crate::point::search::walk::walk;
use crate::point::search::{Keep, Observe, planes};
use crate::simd::Simd;
use core::ops::ControlFlow;
use glam::Vec3;

/// Points that one structure holds.
#[derive(Clone)]
pub(in crate::point) enum Layer {
    /// Static points that exist throughout the shutter.
    Static(StaticTree),
    /// One tree for each time slice, in the order of time, without a gap.
    Moving(Vec<MovingTree>),
    /// The same as k-d trees.
    Planes(Vec<PlaneTree>),
}

/// A layer at a time.
pub(in crate::point) enum LayerView<'a> {
    Static(&'a StaticTree),
    /// All references are active throughout the slice.
    Moving(MovingView<'a, false>),
    /// References have active intervals.
    Timed(MovingView<'a, true>),
    /// A k-d tree.
    Planes(PlaneView<'a>),
}

impl Layer {
    /// The layer at a time in [0, 1].
    #[inline(always)]
    pub(in crate::point) fn at(&self, time: f32) -> LayerView<'_> {
        match self {
            Layer::Static(tree) => LayerView::Static(tree),
            Layer::Moving(trees) => {
                let tree = &trees[self.slice_at(time)];
                if tree.timed() { LayerView::Timed(tree.at(time)) } else { LayerView::Moving(tree.at(time)) }
            }
            Layer::Planes(trees) => LayerView::Planes(trees[self.slice_at(time)].at(time)),
        }
    }

    /// The index of the tree that is responsible for a time in [0, 1].
    #[inline(always)]
    pub(in crate::point) fn slice_at(&self, time: f32) -> usize {
        match self {
            Layer::Static(_) => 0,
            Layer::Moving(trees) => slice_at(trees, time),
            Layer::Planes(trees) => slice_at(trees, time),
        }
    }
}

/// Layers at the time of a query, seen from its point. (f64 points have kernels of their own, which are faster when separate.)
#[derive(Clone, Copy)]
pub(in crate::point) struct QueriedLayers<'a> {
    pub(in crate::point) layers: &'a [Layer],
    pub(in crate::point) point: Vec3,
    pub(in crate::point) time: f32,
}

impl QueriedLayers<'_> {
    /// Traverses all trees, nearest boxes first.
    #[inline(always)]
    pub(in crate::point) fn walk<S: Simd, K: Keep, O: Observe>(self, s: S, search: &mut KNearest<'_, K, O>) {
        for layer in self.layers {
            match layer.at(self.time) {
                LayerView::Static(view) => walk(s, &view, &view.target(s, self.point), search),
                LayerView::Moving(view) => walk(s, &view, &view.target(s, self.point), search),
                LayerView::Timed(view) => walk(s, &view, &view.target(s, self.point), search),
                LayerView::Planes(view) => planes::walk(s, &view, self.point, search),
            }
        }
    }

    /// Searches all trees for the nearest point.
    #[inline(always)]
    pub(in crate::point) fn nearest<S: Simd, K: Keep>(self, s: S, best: &mut Best<'_, S, K>) {
        for layer in self.layers {
            match layer.at(self.time) {
                LayerView::Static(view) => best.search(s, &view, &view.target(s, self.point)),
                LayerView::Moving(view) => best.search(s, &view, &view.target(s, self.point)),
                LayerView::Timed(view) => best.search(s, &view, &view.target(s, self.point)),
                LayerView::Planes(view) => best.search_planes(s, &view, self.point),
            }
        }
    }

    /// Passes every point within the bound to the sink.
    #[inline(always)]
    pub(in crate::point) fn within<S: Simd>(self, s: S, bound: f32, sink: &mut impl Sink<S>) -> ControlFlow<()> {
        for layer in self.layers {
            match layer.at(self.time) {
                LayerView::Static(view) => within(s, &view, &view.target(s, self.point), bound, sink)?,
                LayerView::Moving(view) => within(s, &view, &view.target(s, self.point), bound, sink)?,
                LayerView::Timed(view) => within(s, &view, &view.target(s, self.point), bound, sink)?,
                LayerView::Planes(view) => planes::within(s, &view, self.point, bound, sink)?,
            }
        }
        ControlFlow::Continue(())
    }
}
