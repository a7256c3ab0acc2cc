//! The k-nearest search with a filter and counted work.
//!
//! The cost of counting is negligible compared with a filter that is called for each block. So this one form serves queries with a
//! filter and those for the work alone; queries without a filter have a form that does not count
//! ([`crate::point::queries::compiled`]).

use super::layers::{Layer, QueriedLayers, SingleLayers};
use crate::point::search::candidates::Candidates;
use crate::point::search::k_nearest::KNearest;
use crate::point::search::{KeepLanes, NeighborWork};
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};
use glam::Vec3;

/// A search, and the layers to be searched.
pub(in crate::point) struct CountedSearch<'a> {
    pub layers: &'a [&'a [Layer]],
    pub point: Vec3,
    pub time: f32,
    pub k: usize,
    /// As in [`KNearest::within`].
    pub bound: f32,
    pub shrink: f32,
    pub keep: KeepLanes<'a>,
}

/// Searches, and counts the work. The points found are among the candidates, in no particular order.
pub(in crate::point) fn search_counted(
    simd: SimdLevel,
    search: &CountedSearch<'_>,
    candidates: &mut Candidates,
) -> NeighborWork {
    let CountedSearch { layers, point, time, k, bound, shrink, keep } = search;
    let mut work = NeighborWork::default();
    let mut search = KNearest::within(*k, *bound, *shrink, candidates, keep, &mut work);
    loop {
        for layers in *layers {
            walk_counted(simd, SingleLayers { layers, point: *point, time: *time }, &mut search);
        }
        if !search.retry() {
            return work;
        }
    }
}

/// Traverses all layers once, nearest boxes first: a part of a search.
pub(in crate::point) fn walk_counted(
    simd: SimdLevel,
    layers: SingleLayers<'_>,
    search: &mut KNearest<'_, KeepLanes<'_>, NeighborWork>,
) {
    dispatch(simd, CountedTraversal { layers, search });
}

struct CountedTraversal<'a, 'b, 'c, 'k> {
    layers: SingleLayers<'a>,
    search: &'b mut KNearest<'c, KeepLanes<'k>, NeighborWork>,
}

impl Kernel for CountedTraversal<'_, '_, '_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.layers.walk(s, self.search);
    }
}
