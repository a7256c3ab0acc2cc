//! Finding the photons of a gather: the searches of [`crate::point::search`] over both trees of an index.
//!
//! Searches identify photons by slot, and slots depend on the tree. Answers must not: among photons at the
//! same distance the one with the lower index comes first. Ties are rare, so they are resolved afterwards: inside the
//! answer by sorting runs of equal distances, and at its end by a search for all photons at that distance, of which there may be
//! thousands: a mirror focuses a beam on one point.

use super::index::Index;
use super::span_view::SpanView;
use super::stamped::{Scale, StampedView};
use crate::point::layout::view::LeafView;
use crate::point::neighbor::Neighbor;
use crate::point::queries::buffer::NeighborBuffer;
use crate::point::queries::compiled::append;
use crate::point::search::candidates::Candidates;
use crate::point::search::counted_search::walk_counted;
use crate::point::search::k_nearest::KNearest;
use crate::point::search::layers::SingleLayers;
use crate::point::search::radius::within;
use crate::point::search::sinks::Gather;
use crate::point::search::sort::{all_in_order, nearest_in_order};
use crate::point::search::walk::walk;
use crate::point::search::{Keep, KeepAll, KeepLanes, NeighborWork};
use crate::point::tree::PointTree;
use crate::simd::{Kernel, Simd, dispatch};
use glam::Vec3;

/// A search in an index. With `METRIC`, `scale` is the speed of the metric, otherwise half the width of the window.
pub(super) struct PhotonSearch<'a, K, const METRIC: bool> {
    pub(super) index: &'a Index,
    pub(super) point: Vec3,
    pub(super) time: f32,
    pub(super) scale: f32,
    pub(super) keep: &'a K,
}

impl<K: Keep, const METRIC: bool> PhotonSearch<'_, K, METRIC> {
    /// The `k` nearest within the bound, in order of (distance, index), as slots.
    pub(super) fn nearest(&self, k: usize, bound: f32, buffer: &mut NeighborBuffer) {
        let more = k.saturating_add(1);
        let NeighborBuffer { candidates, found, .. } = &mut *buffer;
        found.clear();
        dispatch(self.index.simd, Nearest { search: self, k: more, bound, candidates });
        nearest_in_order(self.index.simd, more, candidates, found);
        if found.len() > k {
            let next = found[k].distance_squared;
            found.truncate(k);
            if found.last().is_some_and(|last| last.distance_squared == next) {
                self.replace_last(next, buffer);
            }
        }
        self.resolve_ties(&mut buffer.found);
    }

    /// Replaces the photons at the distance of the last one by as many with the lowest indices of all at that distance.
    #[cold]
    #[inline(never)]
    fn replace_last(&self, last: f32, buffer: &mut NeighborBuffer) {
        self.gather(last, &mut buffer.candidates);
        let NeighborBuffer { candidates, found, .. } = buffer;
        let Candidates { distances, ids, count, packed, .. } = candidates;
        let at_last = distances.iter().zip(&*ids).take(*count).filter(|&(&distance, _)| distance == last);
        packed.clear();
        packed.extend(at_last.map(|(_, &slot)| u64::from(self.index.ids[slot as usize]) << 32 | u64::from(slot)));
        let nearer = found.partition_point(|n| n.distance_squared < last);
        let wanted = found.len() - nearer;
        if wanted < packed.len() {
            packed.select_nth_unstable(wanted);
        }
        for (neighbor, &key) in found[nearer..].iter_mut().zip(&*packed) {
            neighbor.id = key as u32;
        }
    }

    /// All within the bound, in order of (distance, index), as slots.
    pub(super) fn within(&self, bound: f32, buffer: &mut NeighborBuffer) {
        self.gather(bound, &mut buffer.candidates);
        let NeighborBuffer { candidates, found, .. } = buffer;
        all_in_order(self.index.simd, candidates, found);
        self.resolve_ties(found);
    }

    /// All within the bound, in any order.
    fn gather(&self, bound: f32, candidates: &mut Candidates) {
        candidates.count = 0;
        dispatch(self.index.simd, Within { search: self, bound, candidates });
        if let Some(tree) = self.others() {
            let layers = SingleLayers { layers: &tree.layers, point: self.point, time: self.time };
            let kept = |slots: &_, mask| self.keep.kept(slots, mask);
            append(self.index.simd, layers, bound, KeepLanes(&kept), candidates);
        }
    }

    /// Sorts photons at the same distance by their indices.
    fn resolve_ties(&self, found: &mut [Neighbor]) {
        let tied = |pair: &[Neighbor]| pair[0].distance_squared == pair[1].distance_squared;
        if found.windows(2).any(tied) {
            for run in found.chunk_by_mut(|a, b| a.distance_squared == b.distance_squared) {
                run.sort_unstable_by_key(|n| self.index.ids[n.id as usize]);
            }
        }
    }

    /// Photons without a stamp, which do not take part in a metric.
    #[inline(always)]
    fn others(&self) -> Option<&PointTree> {
        if METRIC { None } else { self.index.others.as_ref() }
    }

    #[inline(always)]
    fn view(&self) -> StampedView<'_, METRIC> {
        SpanView { tree: &self.index.stamped, time: self.time, measure: Scale(self.scale) }
    }
}

struct Nearest<'a, 'b, K, const METRIC: bool> {
    search: &'a PhotonSearch<'a, K, METRIC>,
    k: usize,
    bound: f32,
    candidates: &'b mut Candidates,
}

impl<K: Keep, const METRIC: bool> Kernel for Nearest<'_, '_, K, METRIC> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Nearest { search: of, k, bound, candidates } = self;
        let observe = &mut ();
        let mut search = KNearest::within(k, bound, 1.0, candidates, of.keep, observe);
        let view = of.view();
        loop {
            if of.index.stamped.count > 0 {
                walk(s, &view, &view.target(s, of.point), &mut search);
            }
            if let Some(tree) = of.others() {
                // Compiled for searches with any filter.
                let kept = |slots: &_, mask| of.keep.kept(slots, mask);
                search.with_filter(&KeepLanes(&kept), &mut NeighborWork::default(), |search| {
                    let layers = SingleLayers { layers: &tree.layers, point: of.point, time: of.time };
                    walk_counted(of.index.simd, layers, search);
                });
            }
            if !search.retry() {
                break;
            }
        }
    }
}

struct Within<'a, 'b, K, const METRIC: bool> {
    search: &'a PhotonSearch<'a, K, METRIC>,
    bound: f32,
    candidates: &'b mut Candidates,
}

impl<K: Keep, const METRIC: bool> Kernel for Within<'_, '_, K, METRIC> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Within { search: of, bound, candidates } = self;
        let view = of.view();
        let mut sink = Gather { candidates, keep: of.keep };
        // A sink that never breaks.
        let _ = within(s, &view, &view.target(s, of.point), bound, &mut sink);
    }
}

/// The `k` nearest in a metric of space and time, in order of (distance, index), as slots. Compiled here, whatever photons
/// carry.
pub(super) fn nearest_in_metric(
    index: &Index,
    (point, time): (Vec3, f32),
    speed: f32,
    k: usize,
    buffer: &mut NeighborBuffer,
) {
    PhotonSearch::<_, true> { index, point, time, scale: speed, keep: &KeepAll }.nearest(k, f32::MAX, buffer);
}
