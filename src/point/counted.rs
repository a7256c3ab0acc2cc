//! The search for the k nearest with a filter, its work counted.
//!
//! Counting costs next to nothing beside a filter that is called for each block. So this one form serves whoever asks with a
//! filter and whoever only wants the work; without a filter there is a form that does not count ([`super::compiled`]).

use super::neighbor::Neighbor;
use super::partition::{Layer, walk_all};
use super::search::candidates::Candidates;
use super::search::k_nearest::KNearest;
use super::search::sort::few_in_order;
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

/// What came of a search.
pub(super) struct Counted {
    pub work: NeighborWork,
    /// Whether what was found is in order already; it is among the candidates in any case.
    pub in_order: bool,
}

/// Searches, and counts the work.
pub(super) fn search_counted(
    simd: SimdLevel,
    search: &CountedSearch<'_>,
    candidates: &mut Candidates,
    found: &mut Vec<Neighbor>,
) -> Counted {
    dispatch(simd, Count { search, candidates, found })
}

struct Count<'a, 'b> {
    search: &'b CountedSearch<'a>,
    candidates: &'b mut Candidates,
    found: &'b mut Vec<Neighbor>,
}

impl Kernel for Count<'_, '_> {
    type Output = Counted;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Counted {
        let Count { search: CountedSearch { layers, point, k, bound, shrink, keep }, candidates, found } = self;
        let mut work = NeighborWork::default();
        let mut search = KNearest::within(*k, *bound, *shrink, candidates, keep, &mut work);
        loop {
            for (layers, time) in *layers {
                walk_all(s, layers, (*point, *time), &mut search);
            }
            if !search.again() {
                break;
            }
        }
        let in_order = few_in_order(s, *k, candidates, found);
        Counted { work, in_order }
    }
}
