//! The layers of a tree as lists see them: points in f32 and in f64 alike.

use crate::point::layout::moving_tree::MovingView;
use crate::point::layout::static_tree::StaticTree;
use crate::point::precise::{AtTime, PreciseLayer, PreciseView};
use crate::point::search::layers::{Layer, LayerView};
use crate::point::tree::PointTree;
use glam::DVec3;

/// A layer of a tree.
#[derive(Clone, Copy)]
pub(super) enum ListLayer<'a> {
    Single(&'a Layer),
    /// Of points in f64.
    Double(&'a PreciseLayer),
}

/// A layer at a time, with positions relative to one place.
pub(super) enum ListView<'a> {
    Static(&'a StaticTree),
    Moving(MovingView<'a, false>),
    Timed(MovingView<'a, true>),
    StaticDouble(PreciseView<'a, false>),
    MovingDouble(PreciseView<'a, true>),
}

impl<'a> ListLayer<'a> {
    /// All layers of a tree.
    pub(super) fn all(tree: &'a PointTree) -> impl Iterator<Item = ListLayer<'a>> {
        tree.layers.iter().map(ListLayer::Single).chain(tree.precise.iter().map(ListLayer::Double))
    }

    /// One of them.
    #[inline(always)]
    pub(super) fn of(tree: &'a PointTree, number: usize) -> ListLayer<'a> {
        match tree.precise.get(number) {
            Some(layer) => ListLayer::Double(layer),
            None => ListLayer::Single(&tree.layers[number]),
        }
    }

    /// The layer at a time. Positions in f64 are relative to `center`; those in f32 are as they are stored, relative to the origin
    /// of the tree.
    #[inline(always)]
    pub(super) fn at(self, center: DVec3, time: f32) -> ListView<'a> {
        match self {
            ListLayer::Single(layer) => match layer.at(time) {
                LayerView::Static(view) => ListView::Static(view),
                LayerView::Moving(view) => ListView::Moving(view),
                LayerView::Timed(view) => ListView::Timed(view),
                LayerView::Planes(_) => {
                    unreachable!("`PointTree::box_tree_at` puts them into boxes before lists are made")
                }
            },
            ListLayer::Double(layer) => match layer.at(center, time) {
                AtTime::Static(view) => ListView::StaticDouble(view),
                AtTime::Moving(view) => ListView::MovingDouble(view),
            },
        }
    }

    /// The place that positions behind a node are best measured from; of no account for f32.
    #[inline(always)]
    pub(super) fn center(self, node: usize, time: f32) -> DVec3 {
        match self {
            ListLayer::Single(_) => DVec3::ZERO,
            ListLayer::Double(layer) => layer.tree_at(time).center(node, time),
        }
    }
}

/// Does the same with a view of any kind.
macro_rules! with_view {
    ($list_view:expr, $view:ident => $do:expr) => {
        match $list_view {
            ListView::Static($view) => $do,
            ListView::Moving($view) => $do,
            ListView::Timed($view) => $do,
            ListView::StaticDouble($view) => $do,
            ListView::MovingDouble($view) => $do,
        }
    };
}

pub(super) use with_view;
