//! The search for the k nearest with a filter, its work counted.
//!
//! Counting costs next to nothing beside a filter that is called for each block. So this one form serves whoever asks with a
//! filter and whoever only wants the work; without a filter there is a form that does not count ([`super::compiled`]).

use super::partition::{Layer, QueriedLayers};
use super::search::candidates::Candidates;
use super::search::k_nearest::KNearest;
use super::search::trees::Trees;
use super::search::{KeepLanes, NeighborWork};
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};
use glam::Vec3;

/// What is searched for, and where.
pub(super) struct CountedSearch<'a> {
    /// Layers, each at a time of its own.
    pub layers: &'a [(&'a [Layer], f32)],
    pub point: Vec3,
    pub k: usize,
    /// As in [`KNearest::within`].
    pub bound: f32,
    pub shrink: f32,
    pub keep: KeepLanes<'a>,
}

/// Searches, and counts the work. What was found is among the candidates, in no order.
pub(super) fn search_counted(simd: SimdLevel, search: &CountedSearch<'_>, candidates: &mut Candidates) -> NeighborWork {
    let CountedSearch { layers, point, k, bound, shrink, keep } = search;
    let mut work = NeighborWork::default();
    let mut search = KNearest::within(*k, *bound, *shrink, candidates, keep, &mut work);
    loop {
        for &(layers, time) in *layers {
            walk_counted(simd, QueriedLayers { layers, point: *point, time }, &mut search);
        }
        if !search.retry() {
            return work;
        }
    }
}

/// Walks through all layers, nearest boxes first: a part of a search.
pub(super) fn walk_counted(
    simd: SimdLevel,
    trees: QueriedLayers<'_>,
    search: &mut KNearest<'_, KeepLanes<'_>, NeighborWork>,
) {
    dispatch(simd, Walk { trees, search });
}

struct Walk<'a, 'b, 'c, 'k> {
    trees: QueriedLayers<'a>,
    search: &'b mut KNearest<'c, KeepLanes<'k>, NeighborWork>,
}

impl Kernel for Walk<'_, '_, '_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.trees.walk(s, self.search);
    }
}
