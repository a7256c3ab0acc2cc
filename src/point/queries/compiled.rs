//! The queries as plain functions, compiled once in this crate.
//!
//! A search is compiled for each instruction set and each kind of tree. If callers instantiated it, every crate that
//! queries a tree would compile all of that again, once for each of its filters. So a caller's filter is called through
//! `dyn`, once for each block with a point that is near enough, and each query is compiled in two forms: without and with
//! a filter. For SSE2 only the latter is compiled; queries without a filter pass one that accepts everything. Among points in f64,
//! one form serves both; only the search for the nearest point waits for what it finds, so that even testing whether there is a
//! filter would be noticed.

use crate::point::neighbor::Neighbor;
use crate::point::search::candidates::Candidates;
use crate::point::search::counted_search::{CountedSearch, search_counted};
use crate::point::search::k_nearest::KNearest;
use crate::point::search::layers::{DoubleLayers, QueriedLayers, SingleLayers};
use crate::point::search::nearest::Best;
use crate::point::search::sinks::{Count, Gather, Visit, VisitSome};
use crate::point::search::sort::{all_in_order, few_in_order, nearest_in_order};
use crate::point::search::{Allowed, Keep, KeepAll, KeepLanes, NeighborWork, Observe};
use crate::point::tree::PointTree;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch, dispatch_or};
use core::ops::ControlFlow;
use glam::{DVec3, Vec3};

/// A query of a tree: point, time, bounds and filter.
#[derive(Clone, Copy)]
pub(in crate::point) struct PreparedQuery<'a, K> {
    pub tree: &'a PointTree,
    /// The point, relative to the tree's origin.
    pub point: Vec3,
    /// The point as the caller gave it.
    pub given: DVec3,
    pub time: f32,
    /// Squared distance up to which points count; negative if none do.
    pub bound: f32,
    /// Factor on the bound for boxes: 1, or less if answers may be approximate.
    pub shrink: f32,
    pub keep: K,
}

/// A query with or without a filter.
pub(in crate::point) type CompiledQuery<'a, 'k> = PreparedQuery<'a, Allowed<'k>>;

impl<'a, K> PreparedQuery<'a, K> {
    /// The same query with another filter.
    #[inline(always)]
    pub(in crate::point) fn keeping<L>(&self, keep: L) -> PreparedQuery<'a, L> {
        let PreparedQuery { tree, point, given, time, bound, shrink, keep: _ } = *self;
        PreparedQuery { tree, point, given, time, bound, shrink, keep }
    }

    /// The layers of points in f32.
    #[inline(always)]
    fn layers(&self) -> SingleLayers<'a> {
        SingleLayers { layers: &self.tree.layers, point: self.point, time: self.time }
    }

    /// The layers of points in f64.
    #[inline(always)]
    fn double_layers(&self) -> DoubleLayers<'a> {
        DoubleLayers { layers: &self.tree.layers, point: self.given, time: self.time }
    }

    #[inline(always)]
    fn limits(&self) -> Limits {
        Limits { bound: self.bound, shrink: self.shrink }
    }
}

/// The bounds of a query. (Kernels take these by value: copies of a whole query cost more than small searches can bear.)
#[derive(Clone, Copy)]
struct Limits {
    bound: f32,
    shrink: f32,
}

/// Runs a kernel among points in f64, beside the code for those in f32.
#[cold]
#[inline(never)]
fn in_double<K: Kernel>(simd: SimdLevel, kernel: K) -> K::Output {
    dispatch(simd, kernel)
}

/// The nearest point.
pub(in crate::point) fn nearest(query: &CompiledQuery<'_, '_>) -> Option<Neighbor> {
    let (simd, limits) = (query.tree.simd, query.limits());
    let found = match (query.tree.is_double(), query.keep.0) {
        (false, None) => {
            let search = Nearest { layers: query.layers(), limits, keep: KeepAll };
            dispatch_or(simd, search, |Nearest { layers, limits, .. }| {
                dispatch(simd, Nearest { layers, limits, keep: KeepLanes::ALL })
            })
        }
        (false, Some(kept)) => dispatch(simd, Nearest { layers: query.layers(), limits, keep: KeepLanes(kept) }),
        (true, None) => in_double(simd, Nearest { layers: query.double_layers(), limits, keep: KeepAll }),
        (true, Some(kept)) => in_double(simd, Nearest { layers: query.double_layers(), limits, keep: KeepLanes(kept) }),
    };
    found.map(|(id, distance_squared)| Neighbor { id, distance_squared })
}

/// The `k` nearest points in order, into an empty list.
pub(in crate::point) fn nearest_n(
    query: &CompiledQuery<'_, '_>,
    k: usize,
    candidates: &mut Candidates,
    found: &mut Vec<Neighbor>,
) {
    if k == 1 {
        // Found without a list of candidates.
        return found.extend(nearest(query));
    }
    let (simd, limits) = (query.tree.simd, query.limits());
    let in_order = match (query.tree.is_double(), query.keep.0) {
        (false, None) => {
            let (layers, observe) = (query.layers(), &mut ());
            let search = NearestN { layers, limits, keep: KeepAll, k, candidates: &mut *candidates, found, observe };
            dispatch_or(simd, search, |search| {
                filtered(query, KeepLanes::ALL, k, search.candidates);
                false
            })
        }
        (false, Some(kept)) => {
            filtered(query, KeepLanes(kept), k, candidates);
            false
        }
        (true, _) => nearest_n_in_double(query, k, candidates, found).0,
    };
    if !in_order {
        nearest_in_order(simd, k, candidates, found);
    }
}

/// The same with a filter, not yet in order.
fn filtered(query: &CompiledQuery<'_, '_>, keep: KeepLanes<'_>, k: usize, candidates: &mut Candidates) -> NeighborWork {
    let &PreparedQuery { tree, point, time, bound, shrink, .. } = query;
    let search = CountedSearch { layers: &[&tree.layers], point, time, k, bound, shrink, keep };
    search_counted(tree.simd, &search, candidates)
}

/// The same among points in f64: whether they are in order, and the work.
fn nearest_n_in_double(
    query: &CompiledQuery<'_, '_>,
    k: usize,
    candidates: &mut Candidates,
    found: &mut Vec<Neighbor>,
) -> (bool, NeighborWork) {
    let (layers, limits, keep) = (query.double_layers(), query.limits(), query.keep);
    let mut work = NeighborWork::default();
    let search = NearestN { layers, limits, keep, k, candidates, found, observe: &mut work };
    (in_double(query.tree.simd, search), work)
}

/// The work of finding the `k` nearest.
pub(in crate::point) fn work(query: &CompiledQuery<'_, '_>, k: usize) -> NeighborWork {
    let mut candidates = Candidates::default();
    if query.tree.is_double() {
        return nearest_n_in_double(query, k, &mut candidates, &mut Vec::new()).1;
    }
    filtered(query, query.keep.0.map_or(KeepLanes::ALL, KeepLanes), k, &mut candidates)
}

/// Gathers all points within the radius.
pub(in crate::point) fn gather(query: &CompiledQuery<'_, '_>, candidates: &mut Candidates) {
    candidates.count = 0;
    let (simd, bound) = (query.tree.simd, query.bound);
    match (query.tree.is_double(), query.keep) {
        (false, Allowed(None)) => {
            let search = Collecting { layers: query.layers(), bound, keep: KeepAll, candidates };
            dispatch_or(simd, search, |Collecting { layers, candidates, .. }| {
                append(simd, layers, bound, KeepLanes::ALL, candidates);
            });
        }
        (false, Allowed(Some(kept))) => append(simd, query.layers(), bound, KeepLanes(kept), candidates),
        (true, keep) => in_double(simd, Collecting { layers: query.double_layers(), bound, keep, candidates }),
    }
}

/// Appends all points within a bound that pass a filter to candidates.
pub(in crate::point) fn append(
    simd: SimdLevel,
    layers: SingleLayers<'_>,
    bound: f32,
    keep: KeepLanes<'_>,
    candidates: &mut Candidates,
) {
    dispatch(simd, Collecting { layers, bound, keep, candidates });
}

/// All points within the radius in any order, into an empty list.
pub(in crate::point) fn collect(query: &CompiledQuery<'_, '_>, candidates: &mut Candidates, found: &mut Vec<Neighbor>) {
    gather(query, candidates);
    found.extend(candidates.pairs().map(|(id, distance_squared)| Neighbor { id, distance_squared }));
}

/// All points within the radius in order, into an empty list.
pub(in crate::point) fn collect_sorted(
    query: &CompiledQuery<'_, '_>,
    candidates: &mut Candidates,
    found: &mut Vec<Neighbor>,
) {
    gather(query, candidates);
    all_in_order(query.tree.simd, candidates, found);
}

/// The number of points within the radius.
pub(in crate::point) fn count(query: &CompiledQuery<'_, '_>) -> usize {
    let (simd, bound) = (query.tree.simd, query.bound);
    match (query.tree.is_double(), query.keep) {
        (false, Allowed(None)) => {
            let search = Counting { layers: query.layers(), bound, keep: KeepAll };
            dispatch_or(simd, search, |Counting { layers, bound, .. }| {
                dispatch(simd, Counting { layers, bound, keep: KeepLanes::ALL })
            })
        }
        (false, Allowed(Some(kept))) => {
            dispatch(simd, Counting { layers: query.layers(), bound, keep: KeepLanes(kept) })
        }
        (true, keep) => in_double(simd, Counting { layers: query.double_layers(), bound, keep }),
    }
}

/// Calls `visit` with all points within the radius, some at a time, until it breaks; whatever is kept.
pub(in crate::point) fn for_some(query: &CompiledQuery<'_, '_>, visit: VisitSome<'_>) -> ControlFlow<()> {
    let (simd, bound) = (query.tree.simd, query.bound);
    if query.tree.is_double() {
        return in_double(simd, Visiting { layers: query.double_layers(), bound, visit });
    }
    dispatch(simd, Visiting { layers: query.layers(), bound, visit })
}

struct Nearest<L, K> {
    layers: L,
    limits: Limits,
    keep: K,
}

impl<L: QueriedLayers, K: Keep> Kernel for Nearest<L, K> {
    type Output = Option<(u32, f32)>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<(u32, f32)> {
        let Nearest { layers, limits: Limits { bound, shrink }, keep } = self;
        let mut best = Best::within(s, bound, shrink, &keep);
        layers.nearest(s, &mut best);
        best.finish(s)
    }
}

struct NearestN<'a, L, K, O> {
    layers: L,
    limits: Limits,
    keep: K,
    k: usize,
    candidates: &'a mut Candidates,
    found: &'a mut Vec<Neighbor>,
    observe: &'a mut O,
}

impl<L: QueriedLayers, K: Keep, O: Observe> Kernel for NearestN<'_, L, K, O> {
    /// Whether the points found are in order already.
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let NearestN { layers, limits: Limits { bound, shrink }, keep, k, candidates, found, observe } = self;
        let mut search = KNearest::within(k, bound, shrink, candidates, &keep, observe);
        loop {
            layers.walk(s, &mut search);
            if !search.retry() {
                break;
            }
        }
        few_in_order(s, k, candidates, found)
    }
}

struct Collecting<'a, L, K> {
    layers: L,
    bound: f32,
    keep: K,
    candidates: &'a mut Candidates,
}

impl<L: QueriedLayers, K: Keep> Kernel for Collecting<'_, L, K> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Collecting { layers, bound, keep, candidates } = self;
        // A sink that never breaks.
        let _ = layers.within(s, bound, &mut Gather { candidates, keep: &keep });
    }
}

struct Counting<L, K> {
    layers: L,
    bound: f32,
    keep: K,
}

impl<L: QueriedLayers, K: Keep> Kernel for Counting<L, K> {
    type Output = usize;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> usize {
        let Counting { layers, bound, keep } = self;
        let mut sink = Count { count: 0, keep: &keep };
        // A sink that never breaks.
        let _ = layers.within(s, bound, &mut sink);
        sink.count
    }
}

struct Visiting<'v, L> {
    layers: L,
    bound: f32,
    visit: VisitSome<'v>,
}

impl<L: QueriedLayers> Kernel for Visiting<'_, L> {
    type Output = ControlFlow<()>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> ControlFlow<()> {
        let mut sink = Visit::new(self.visit);
        self.layers.within(s, self.bound, &mut sink)?;
        sink.finish()
    }
}
