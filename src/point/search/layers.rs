//! Layers, of which a tree consists: each has some of its points, in one structure.
//!
//! A set may be divided among layers, static points separate from moving ones. A search goes through the layers one after
//! the other with the same candidates and the same bound.

use crate::point::layout::double_tree::{DoubleTree, DoubleView};
use crate::point::layout::kd_points::{KdPoints, KdPointsView};
use crate::point::layout::moving_tree::{MovingTree, MovingView};
use crate::point::layout::over_interval::{BlockTree, BoxTree};
use crate::point::layout::slice_tree::{SliceTree, slice_at};
use crate::point::layout::static_tree::StaticTree;
use crate::point::layout::view::LeafView;
use crate::point::search::k_nearest::KNearest;
use crate::point::search::nearest::Best;
use crate::point::search::radius::{Sink, within};
use crate::point::search::walk::walk;
use crate::point::search::{Keep, Observe, kd_search};
use crate::simd::Simd;
use core::ops::ControlFlow;
use core::slice::{from_mut, from_ref};
use glam::{DVec3, Vec3};

/// Points that one structure holds. Where there are several trees, each has a time slice, in the order of time, without a gap.
#[derive(Clone)]
pub(in crate::point) enum Layer {
    /// Static points that exist throughout the shutter.
    Static(StaticTree),
    /// Trees of boxes that move.
    Moving(Vec<MovingTree>),
    /// K-d trees.
    Kd(Vec<KdPoints>),
    /// Points in f64, static or moving. All layers of a tree are of this kind, or none is.
    Double(Vec<DoubleTree>),
}

/// A layer at a time.
pub(in crate::point) enum LayerView<'a> {
    Static(&'a StaticTree),
    /// All references are active throughout the slice.
    Moving(MovingView<'a, false>),
    /// References have active intervals.
    Timed(MovingView<'a, true>),
    Kd(KdPointsView<'a>),
    DoubleStatic(DoubleView<'a, false>),
    DoubleMoving(DoubleView<'a, true>),
}

/// Does the same with the view of a layer, whatever its boxes.
macro_rules! with_view {
    ($layer_view:expr, $view:ident => $do:expr) => {
        match $layer_view {
            LayerView::Static($view) => $do,
            LayerView::Moving($view) => $do,
            LayerView::Timed($view) => $do,
            LayerView::DoubleStatic($view) => $do,
            LayerView::DoubleMoving($view) => $do,
            LayerView::Kd(_) => unreachable!("`PointTree::box_tree_at` puts them into boxes before lists are made"),
        }
    };
}

pub(in crate::point) use with_view;

impl Layer {
    /// The layer at a time in [0, 1]. Positions in f64 are seen from `point`, those in f32 are as they are stored.
    #[inline(always)]
    pub(in crate::point) fn at(&self, point: DVec3, time: f32) -> LayerView<'_> {
        match self {
            Layer::Static(tree) => LayerView::Static(tree),
            Layer::Moving(trees) => {
                let tree = &trees[slice_at(trees, time)];
                if tree.timed() { LayerView::Timed(tree.at(time)) } else { LayerView::Moving(tree.at(time)) }
            }
            Layer::Kd(trees) => LayerView::Kd(trees[slice_at(trees, time)].at(time)),
            Layer::Double(trees) => {
                let tree = &trees[slice_at(trees, time)];
                if tree.moves() {
                    LayerView::DoubleMoving(tree.at(point, time))
                } else {
                    LayerView::DoubleStatic(tree.at(point, time))
                }
            }
        }
    }

    /// The place that positions below a node are best measured from; of no account for f32.
    #[inline(always)]
    pub(in crate::point) fn center(&self, node: usize, time: f32) -> DVec3 {
        match self {
            Layer::Double(trees) => trees[slice_at(trees, time)].center(node, time),
            _ => DVec3::ZERO,
        }
    }

    /// The tree of boxes that is responsible for a time in [0, 1].
    pub(in crate::point) fn boxes_at(&self, time: f32) -> &dyn BoxTree {
        match self {
            Layer::Static(tree) => tree,
            Layer::Moving(trees) => &trees[slice_at(trees, time)],
            Layer::Double(trees) => &trees[slice_at(trees, time)],
            Layer::Kd(_) => unreachable!("`PointTree::box_tree_at` puts them into boxes before lists are made"),
        }
    }

    /// The index of the tree that is responsible for a time in [0, 1].
    pub(in crate::point) fn slice_at(&self, time: f32) -> usize {
        match self {
            Layer::Static(_) => 0,
            Layer::Moving(trees) => slice_at(trees, time),
            Layer::Kd(trees) => slice_at(trees, time),
            Layer::Double(trees) => slice_at(trees, time),
        }
    }

    /// All trees.
    pub(in crate::point) fn trees(&self) -> Vec<&dyn SliceTree> {
        fn all<T: SliceTree>(trees: &[T]) -> Vec<&dyn SliceTree> {
            trees.iter().map(|tree| tree as &dyn SliceTree).collect()
        }
        match self {
            Layer::Static(tree) => all(from_ref(tree)),
            Layer::Moving(trees) => all(trees),
            Layer::Kd(trees) => all(trees),
            Layer::Double(trees) => all(trees),
        }
    }

    /// The same, to be changed.
    pub(in crate::point) fn trees_mut(&mut self) -> Vec<&mut dyn SliceTree> {
        fn all<T: SliceTree>(trees: &mut [T]) -> Vec<&mut dyn SliceTree> {
            trees.iter_mut().map(|tree| tree as &mut dyn SliceTree).collect()
        }
        match self {
            Layer::Static(tree) => all(from_mut(tree)),
            Layer::Moving(trees) => all(trees),
            Layer::Kd(trees) => all(trees),
            Layer::Double(trees) => all(trees),
        }
    }
}

/// Layers at the time of a query, seen from its point.
pub(in crate::point) trait QueriedLayers: Copy {
    /// Traverses all trees, nearest boxes first.
    fn walk<S: Simd, K: Keep, O: Observe>(self, s: S, search: &mut KNearest<'_, K, O>);
    /// Searches all trees for the nearest point.
    fn nearest<S: Simd, K: Keep>(self, s: S, best: &mut Best<'_, S, K>);
    /// Passes every point within the bound to the sink.
    fn within<S: Simd>(self, s: S, bound: f32, sink: &mut impl Sink<S>) -> ControlFlow<()>;
}

/// Layers of points in f32.
#[derive(Clone, Copy)]
pub(in crate::point) struct SingleLayers<'a> {
    pub(in crate::point) layers: &'a [Layer],
    pub(in crate::point) point: Vec3,
    pub(in crate::point) time: f32,
}

/// Layers of points in f64. (Kernels of their own: sharing those for f32 made these searches slower.)
#[derive(Clone, Copy)]
pub(in crate::point) struct DoubleLayers<'a> {
    pub(in crate::point) layers: &'a [Layer],
    pub(in crate::point) point: DVec3,
    pub(in crate::point) time: f32,
}

/// Does the same with the view of each layer in f32: one of boxes, or one of planes.
macro_rules! for_each_single {
    ($of:expr, $view:ident => $boxes:expr, $planes:expr) => {
        for layer in $of.layers {
            match layer.at(DVec3::ZERO, $of.time) {
                LayerView::Static($view) => $boxes,
                LayerView::Moving($view) => $boxes,
                LayerView::Timed($view) => $boxes,
                LayerView::Kd($view) => $planes,
                LayerView::DoubleStatic(_) | LayerView::DoubleMoving(_) => {}
            }
        }
    };
}

impl QueriedLayers for SingleLayers<'_> {
    #[inline(always)]
    fn walk<S: Simd, K: Keep, O: Observe>(self, s: S, search: &mut KNearest<'_, K, O>) {
        for_each_single!(self, view => walk(s, &view, &view.target(s, self.point), search),
            kd_search::walk(s, &view, self.point, search));
    }

    #[inline(always)]
    fn nearest<S: Simd, K: Keep>(self, s: S, best: &mut Best<'_, S, K>) {
        for_each_single!(self, view => best.search(s, &view, &view.target(s, self.point)),
            best.search_kd(s, &view, self.point));
    }

    #[inline(always)]
    fn within<S: Simd>(self, s: S, bound: f32, sink: &mut impl Sink<S>) -> ControlFlow<()> {
        for_each_single!(self, view => within(s, &view, &view.target(s, self.point), bound, sink)?,
            kd_search::within(s, &view, self.point, bound, sink)?);
        ControlFlow::Continue(())
    }
}

/// Does the same with the view of each layer in f64.
macro_rules! for_each_double {
    ($of:expr, $view:ident => $do:expr) => {
        for layer in $of.layers {
            match layer.at($of.point, $of.time) {
                LayerView::DoubleStatic($view) => $do,
                LayerView::DoubleMoving($view) => $do,
                _ => {}
            }
        }
    };
}

/// The views hold the query point.
impl QueriedLayers for DoubleLayers<'_> {
    #[inline(always)]
    fn walk<S: Simd, K: Keep, O: Observe>(self, s: S, search: &mut KNearest<'_, K, O>) {
        for_each_double!(self, view => walk(s, &view, &view.target(s, Vec3::ZERO), search));
    }

    #[inline(always)]
    fn nearest<S: Simd, K: Keep>(self, s: S, best: &mut Best<'_, S, K>) {
        for_each_double!(self, view => best.search(s, &view, &view.target(s, Vec3::ZERO)));
    }

    #[inline(always)]
    fn within<S: Simd>(self, s: S, bound: f32, sink: &mut impl Sink<S>) -> ControlFlow<()> {
        for_each_double!(self, view => within(s, &view, &view.target(s, Vec3::ZERO), bound, sink)?);
        ControlFlow::Continue(())
    }
}
