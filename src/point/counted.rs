//! The work of a search for the k nearest, counted.
//!
//! Compiled once, with a filter: nobody waits for it.

use super::partition::{Layer, walk_all};
use super::search::candidates::Candidates;
use super::search::k_nearest::KNearest;
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

/// Counts the work of a search.
pub(super) fn count_work(simd: SimdLevel, search: &CountedSearch<'_>, candidates: &mut Candidates) -> NeighborWork {
    dispatch(simd, Count { search, candidates })
}

struct Count<'a, 'b> {
    search: &'b CountedSearch<'a>,
    candidates: &'b mut Candidates,
}

impl Kernel for Count<'_, '_> {
    type Output = NeighborWork;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> NeighborWork {
        let CountedSearch { layers, point, k, bound, shrink, keep } = self.search;
        let mut work = NeighborWork::default();
        let mut search = KNearest::within(*k, *bound, *shrink, self.candidates, keep, &mut work);
        loop {
            for (layers, time) in *layers {
                walk_all(s, layers, (*point, *time), &mut search);
            }
            if !search.again() {
                break;
            }
        }
        work
    }
}
