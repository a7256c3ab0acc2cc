//! Points within a radius as an iterator that searches a few bottom nodes at a time.

use super::compiled::{self, PreparedQuery};
use super::query::NeighborQuery;
use crate::point::layout::kd_points::KdPointsView;
use crate::point::layout::view::{LeafView, View};
use crate::point::neighbor::Neighbor;
use crate::point::search::candidates::Candidates;
use crate::point::search::kd_search::KdFront;
use crate::point::search::layers::{Layer, LayerView};
use crate::point::search::radius::{Front, search_blocks};
use crate::point::search::sinks::Gather;
use crate::point::search::{Allowed, Keep, KeepAll};
use crate::simd::{Kernel, Simd, dispatch};
use core::fmt;

/// The search pauses once it has found this many points, until they are consumed: resuming it costs more than a node.
const BATCH: usize = 64;

/// Iterator over the points within the radius of a query; made by [`NeighborQuery::iter`].
#[must_use = "an iterator does nothing until it is advanced"]
pub struct WithinIter<'a, K> {
    search: Search<'a>,
    keep: K,
}

impl<K> fmt::Debug for WithinIter<'_, K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let PreparedQuery { given, time, bound, .. } = &self.search.query;
        f.debug_struct("WithinIter")
            .field("position", given)
            .field("time", time)
            .field("radius_squared", bound)
            .finish_non_exhaustive()
    }
}

/// A search in progress, independent of the filter.
struct Search<'a> {
    query: PreparedQuery<'a, KeepAll>,
    layer: usize,
    /// The traversal of the layer, of boxes or of planes, once it has begun.
    boxes: Option<Front>,
    planes: Option<KdFront>,
    /// The points found in the last bottom nodes, and how many of them were consumed.
    candidates: Candidates,
    next: usize,
}

impl<'a, K: Keep> NeighborQuery<'a, K> {
    /// An iterator over the points within the radius, in no particular order. It searches lazily, except among
    /// points that are kept in f64, which are searched all at once.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3], [9.0; 3]], &PointParams::default())?;
    /// let far = tree.query([0.0f32; 3], 0.0).radius(2.0).iter().find(|n| n.distance() > 1.0);
    /// assert_eq!(far.map(|n| n.id), Some(1));
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn iter(self) -> WithinIter<'a, K> {
        let query = self.query.keeping(KeepAll);
        let layer = if query.bound >= 0.0 { 0 } else { query.tree.layers.len() };
        let mut candidates = Candidates::default();
        candidates.reserve(BATCH);
        if query.bound >= 0.0 && query.tree.is_double() {
            compiled::gather(&query.keeping(Allowed(None)), &mut candidates);
        }
        let search = Search { query, layer, boxes: None, planes: None, candidates, next: 0 };
        WithinIter { search, keep: self.query.keep }
    }
}

impl<K: Keep> Iterator for WithinIter<'_, K> {
    type Item = Neighbor;

    #[inline]
    fn next(&mut self) -> Option<Neighbor> {
        loop {
            let Search { candidates, next, .. } = &mut self.search;
            while *next < candidates.count {
                let (id, distance_squared) = (candidates.ids[*next], candidates.distances[*next]);
                *next += 1;
                if self.keep.keep(id) {
                    return Some(Neighbor { id, distance_squared });
                }
            }
            if !self.search.refill() {
                return None;
            }
        }
    }
}

impl Search<'_> {
    /// Continues the search until there are candidates; false at the end.
    fn refill(&mut self) -> bool {
        (self.next, self.candidates.count) = (0, 0);
        while self.candidates.count == 0 {
            let Some(layer) = self.query.tree.layers.get(self.layer) else { return false };
            if !dispatch(self.query.tree.simd, Step { search: self, layer }) {
                self.layer += 1;
                (self.boxes, self.planes) = (None, None);
            }
        }
        true
    }
}

/// Searches the next bottom nodes of a layer; false at its end.
struct Step<'i, 'l, 'a> {
    search: &'i mut Search<'a>,
    layer: &'l Layer,
}

impl Kernel for Step<'_, '_, '_> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let PreparedQuery { given, time, .. } = self.search.query;
        match self.layer.at(given, time) {
            LayerView::Static(view) => steps(s, self.search, &view),
            LayerView::Moving(view) => steps(s, self.search, &view),
            LayerView::Timed(view) => steps(s, self.search, &view),
            LayerView::Kd(view) => step_kd(s, self.search, &view),
            // They have been searched at once.
            LayerView::DoubleStatic(_) | LayerView::DoubleMoving(_) => false,
        }
    }
}

#[inline(always)]
fn steps<S: Simd, V: View>(s: S, search: &mut Search<'_>, view: &V) -> bool {
    let PreparedQuery { bound, point, .. } = search.query;
    let (target, bound) = (view.target(s, point), s.splat(bound));
    let front = search.boxes.get_or_insert_with(|| Front::begin(view));
    let mut sink = Gather { candidates: &mut search.candidates, keep: &KeepAll };
    while sink.candidates.count < BATCH {
        let Some((node, mut lanes)) = front.next(s, view, &target, bound) else { return false };
        while lanes != 0 {
            let leaf = view.first_block(node) + lanes.trailing_zeros() as usize * view.leaf_blocks();
            lanes &= lanes - 1;
            // A sink that never breaks.
            let _ = search_blocks(s, view, &target, bound, leaf..leaf + view.leaf_blocks(), &mut sink);
        }
    }
    true
}

#[inline(always)]
fn step_kd<S: Simd>(s: S, search: &mut Search<'_>, view: &KdPointsView<'_>) -> bool {
    let PreparedQuery { bound, point, .. } = search.query;
    let front = search.planes.get_or_insert_with(KdFront::begin);
    let Some(blocks) = front.next(view, point, bound, || ()) else { return false };
    let mut sink = Gather { candidates: &mut search.candidates, keep: &KeepAll };
    // A sink that never breaks.
    let _ = search_blocks(s, view, &view.target(s, point), s.splat(bound), blocks, &mut sink);
    true
}
