//! Point trees that keep positions in f64.
//!
//! The picture to have in mind: the same pyramid of sixteen-wide nodes, but each node has a centre of its own in f64, and
//! boxes in f32 relative to it; so boxes are as fine as their contents, wherever these are. Leaves hold f64 positions. A
//! search needs only lower bounds of distances to boxes, and distances to points: [`tree`] provides both, and the
//! searches are the same as those of f32 points.
//!
//! The distance of a point is computed in f64 and rounded to f32 once; order, ties and radii use that number.

mod build;
mod in_file;
mod linear_box;
mod order;
mod tree;

pub(super) use in_file::PreciseRecord;
pub(super) use tree::{PreciseTree, PreciseView};

use super::search::k_nearest::KNearest;
use super::search::nearest::Best;
use super::search::radius::{Sink, within};
use super::search::trees::Trees;
use super::search::walk::walk;
use super::search::{Keep, KeptLanes, Observe};
use super::snapshot::Leaves;
use crate::simd::{LANES, Lanes, Mask, Simd};
use core::ops::ControlFlow;
use glam::{DVec3, Vec3};

/// Trees for successive parts of the shutter, without a gap; a single one if all points are static.
#[derive(Clone)]
pub(super) struct PreciseLayer {
    pub(super) parts: Vec<PreciseTree>,
}

/// A layer at a time, seen from a query point.
enum AtTime<'a> {
    Still(PreciseView<'a, false>),
    Moving(PreciseView<'a, true>),
}

impl PreciseLayer {
    /// The index of the tree that is responsible for a time in [0, 1].
    pub(super) fn part_at(&self, time: f32) -> usize {
        self.parts.partition_point(|tree| tree.part().interval.end_bound() <= time).min(self.parts.len() - 1)
    }

    /// The tree that is responsible for a time in [0, 1].
    pub(super) fn tree_at(&self, time: f32) -> &PreciseTree {
        &self.parts[self.part_at(time)]
    }

    #[inline(always)]
    fn at(&self, point: DVec3, time: f32) -> AtTime<'_> {
        let tree = self.tree_at(time);
        if tree.moves() { AtTime::Moving(tree.at(point, time)) } else { AtTime::Still(tree.at(point, time)) }
    }
}

/// A predicate on ids, if there is one. (Searches among f64 points are compiled once, here, not for each predicate.)
#[derive(Clone, Copy)]
pub(super) struct Allowed<'a>(pub(super) Option<KeptLanes<'a>>);

impl Keep for Allowed<'_> {
    const FILTERS: bool = true;
    fn keep(&self, id: u32) -> bool {
        self.kept(&[id; LANES], 1) != 0
    }
    #[inline(always)]
    fn kept(&self, ids: &Lanes<u32>, mask: Mask) -> Mask {
        // Whether there is a filter is predicted; whether there is a hit is not, and without a filter it does not matter.
        match self.0 {
            None => mask,
            Some(kept) => {
                if mask != 0 {
                    kept(ids, mask)
                } else {
                    0
                }
            }
        }
    }
}

/// Layers at the time of a query, seen from its point.
#[derive(Clone, Copy)]
pub(super) struct QueriedPreciseLayers<'a> {
    pub(super) layers: &'a [PreciseLayer],
    pub(super) point: DVec3,
    pub(super) time: f32,
}

impl Trees for QueriedPreciseLayers<'_> {
    #[inline(always)]
    fn walk<S: Simd, K: Keep, O: Observe>(self, s: S, search: &mut KNearest<'_, K, O>) {
        for layer in self.layers {
            match layer.at(self.point, self.time) {
                AtTime::Still(view) => walk(s, &view, &view.target(s, Vec3::ZERO), search),
                AtTime::Moving(view) => walk(s, &view, &view.target(s, Vec3::ZERO), search),
            }
        }
    }

    #[inline(always)]
    fn nearest<S: Simd, K: Keep>(self, s: S, best: &mut Best<'_, S, K>) {
        for layer in self.layers {
            match layer.at(self.point, self.time) {
                AtTime::Still(view) => best.search(s, &view, &view.target(s, Vec3::ZERO)),
                AtTime::Moving(view) => best.search(s, &view, &view.target(s, Vec3::ZERO)),
            }
        }
    }

    #[inline(always)]
    fn within<S: Simd>(self, s: S, bound: f32, sink: &mut impl Sink<S>) -> ControlFlow<()> {
        for layer in self.layers {
            match layer.at(self.point, self.time) {
                AtTime::Still(view) => within(s, &view, &view.target(s, Vec3::ZERO), bound, sink)?,
                AtTime::Moving(view) => within(s, &view, &view.target(s, Vec3::ZERO), bound, sink)?,
            }
        }
        ControlFlow::Continue(())
    }
}
