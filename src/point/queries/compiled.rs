//! The queries as plain functions, compiled once in this crate.
//!
//! A search is compiled for each instruction set and each kind of tree. If callers instantiated it, every crate that
//! queries a tree would compile all of that again, once for each of its filters. So a caller's filter is called through
//! `dyn`, once for each block with a point that is near enough, and each query is compiled in two forms: without and with
//! a filter. For SSE2 only the latter is compiled; queries without a filter pass one that accepts everything.

use crate::point::neighbor::Neighbor;
use crate::point::precise::{Allowed, PreciseQuery};
use crate::point::search::candidates::Candidates;
use crate::point::search::counted_search::{CountedSearch, search_counted};
use crate::point::search::k_nearest::KNearest;
use crate::point::search::layers::QueriedLayers;
use crate::point::search::nearest::Best;
use crate::point::search::sinks::{Count, Gather, Visit, VisitSome};
use crate::point::search::sort::{all_in_order, few_in_order, nearest_in_order};
use crate::point::search::{Keep, KeepAll, KeepLanes, NeighborWork, Observe};
use crate::point::tree::PointTree;
use crate::simd::{Kernel, Lanes, Mask, Simd, SimdLevel, dispatch, dispatch_or};
use core::ops::ControlFlow;
use glam::{DVec3, Vec3};

/// A query of a tree: point, time, bounds and filter.
#[derive(Clone, Copy)]
pub(in crate::point) struct PreparedQuery<'a, K> {
    pub tree: &'a PointTree,
    /// The point, relative to the tree's origin.
    pub point: Vec3,
    /// The point as the caller gave it.
    pub exact: DVec3,
    pub time: f32,
    /// Squared distance up to which points count; negative if none do.
    pub bound: f32,
    /// Factor on the bound for boxes: 1, or less if answers may be approximate.
    pub shrink: f32,
    pub keep: K,
}

impl<'a, K> PreparedQuery<'a, K> {
    /// The same query with another filter.
    #[inline(always)]
    pub(in crate::point) fn keeping<L>(&self, keep: L) -> PreparedQuery<'a, L> {
        let PreparedQuery { tree, point, exact, time, bound, shrink, keep: _ } = *self;
        PreparedQuery { tree, point, exact, time, bound, shrink, keep }
    }

    /// Whether the points are kept in f64.
    #[inline(always)]
    pub(in crate::point) fn is_precise(&self) -> bool {
        !self.tree.precise.is_empty()
    }

    /// The layers of points in f32.
    #[inline(always)]
    fn layers(&self) -> QueriedLayers<'a> {
        QueriedLayers { layers: &self.tree.layers, point: self.point, time: self.time }
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

impl<K: Keep> PreparedQuery<'_, K> {
    /// Runs the query over points in f64.
    #[cold]
    #[inline(never)]
    fn precise<R>(&self, run: impl FnOnce(&PreciseQuery<'_>) -> R) -> R {
        let kept = |ids: &Lanes<u32>, mask: Mask| self.keep.kept(ids, mask);
        let PointTree { precise, simd, .. } = self.tree;
        run(&PreciseQuery {
            layers: precise,
            simd: *simd,
            point: self.exact,
            time: self.time,
            bound: self.bound,
            shrink: self.shrink,
            keep: Allowed(K::FILTERS.then_some(&kept)),
        })
    }
}

/// A filter that accepts everything.
const ALL: KeepLanes<'static> = KeepLanes(&|_, mask| mask);

/// A query without or with a filter.
#[derive(Clone, Copy)]
pub(in crate::point) enum MaybeFiltered<'q, 'a> {
    Unfiltered(&'q PreparedQuery<'a, KeepAll>),
    Filtered(&'q PreparedQuery<'a, KeepLanes<'q>>),
}

impl MaybeFiltered<'_, '_> {
    /// [`PreparedQuery::precise`], if the points are kept in f64.
    #[inline(always)]
    fn precise<R>(self, run: impl FnOnce(&PreciseQuery<'_>) -> R) -> Option<R> {
        match self {
            MaybeFiltered::Unfiltered(query) => query.is_precise().then(|| query.precise(run)),
            MaybeFiltered::Filtered(query) => query.is_precise().then(|| query.precise(run)),
        }
    }

    #[inline(always)]
    fn simd(self) -> SimdLevel {
        match self {
            MaybeFiltered::Unfiltered(query) => query.tree.simd,
            MaybeFiltered::Filtered(query) => query.tree.simd,
        }
    }
}

/// The nearest point.
pub(in crate::point) fn nearest(query: MaybeFiltered<'_, '_>) -> Option<Neighbor> {
    let simd = query.simd();
    let precise = query.precise(|query| query.nearest());
    let found = match (precise, query) {
        (Some(found), _) => found,
        (None, MaybeFiltered::Unfiltered(query)) => {
            let search = Nearest { layers: query.layers(), limits: query.limits(), keep: KeepAll };
            dispatch_or(simd, search, |Nearest { layers, limits, .. }| {
                dispatch(simd, Nearest { layers, limits, keep: ALL })
            })
        }
        (None, MaybeFiltered::Filtered(query)) => {
            dispatch(simd, Nearest { layers: query.layers(), limits: query.limits(), keep: query.keep })
        }
    };
    found.map(|(id, distance_squared)| Neighbor { id, distance_squared })
}

/// The `k` nearest points in order, into an empty list.
pub(in crate::point) fn nearest_n(
    query: MaybeFiltered<'_, '_>,
    k: usize,
    candidates: &mut Candidates,
    found: &mut Vec<Neighbor>,
) {
    if k == 1 {
        // Found without a list of candidates.
        return found.extend(nearest(query));
    }
    let (simd, work) = (query.simd(), &mut NeighborWork::default());
    let precise = query.precise(|query| query.nearest_n(k, candidates, found, work));
    let in_order = match (precise, query) {
        (Some(in_order), _) => in_order,
        (None, MaybeFiltered::Unfiltered(query)) => {
            let (layers, limits, observe) = (query.layers(), query.limits(), &mut ());
            let search = NearestN { layers, limits, keep: KeepAll, k, candidates: &mut *candidates, found, observe };
            dispatch_or(simd, search, |search| {
                filtered(&query.keeping(ALL), k, search.candidates);
                false
            })
        }
        (None, MaybeFiltered::Filtered(query)) => {
            filtered(query, k, candidates);
            false
        }
    };
    if !in_order {
        nearest_in_order(simd, k, candidates, found);
    }
}

/// The same with a filter, not yet in order.
fn filtered(query: &PreparedQuery<'_, KeepLanes<'_>>, k: usize, candidates: &mut Candidates) -> NeighborWork {
    let &PreparedQuery { tree, point, time, bound, shrink, keep, .. } = query;
    let search = CountedSearch { layers: &[&tree.layers], point, time, k, bound, shrink, keep };
    search_counted(tree.simd, &search, candidates)
}

/// The work of finding the `k` nearest.
pub(in crate::point) fn work(query: MaybeFiltered<'_, '_>, k: usize) -> NeighborWork {
    let (mut candidates, mut found, mut work) = (Candidates::default(), Vec::new(), NeighborWork::default());
    let precise = query.precise(|query| query.nearest_n(k, &mut candidates, &mut found, &mut work));
    if precise.is_some() {
        return work;
    }
    let query = match query {
        MaybeFiltered::Unfiltered(query) => query.keeping(ALL),
        MaybeFiltered::Filtered(query) => *query,
    };
    filtered(&query, k, &mut candidates)
}

/// Gathers all points within the radius.
pub(in crate::point) fn gather(query: MaybeFiltered<'_, '_>, candidates: &mut Candidates) {
    candidates.count = 0;
    let simd = query.simd();
    let precise = query.precise(|query| query.collect(candidates));
    match (precise, query) {
        (Some(()), _) => {}
        (None, MaybeFiltered::Unfiltered(query)) => {
            let search = Collecting { layers: query.layers(), bound: query.bound, keep: KeepAll, candidates };
            dispatch_or(simd, search, |search| append(&query.keeping(ALL), search.candidates));
        }
        (None, MaybeFiltered::Filtered(query)) => append(query, candidates),
    }
}

/// Appends all points within the radius that pass a filter to candidates, from a tree of points in f32.
pub(in crate::point) fn append(query: &PreparedQuery<'_, KeepLanes<'_>>, candidates: &mut Candidates) {
    let search = Collecting { layers: query.layers(), bound: query.bound, keep: query.keep, candidates };
    dispatch(query.tree.simd, search);
}

/// All points within the radius in any order, into an empty list.
pub(in crate::point) fn collect(query: MaybeFiltered<'_, '_>, candidates: &mut Candidates, found: &mut Vec<Neighbor>) {
    gather(query, candidates);
    found.extend(candidates.pairs().map(|(id, distance_squared)| Neighbor { id, distance_squared }));
}

/// All points within the radius in order, into an empty list.
pub(in crate::point) fn collect_sorted(
    query: MaybeFiltered<'_, '_>,
    candidates: &mut Candidates,
    found: &mut Vec<Neighbor>,
) {
    gather(query, candidates);
    all_in_order(query.simd(), candidates, found);
}

/// The number of points within the radius.
pub(in crate::point) fn count(query: MaybeFiltered<'_, '_>) -> usize {
    let simd = query.simd();
    let precise = query.precise(|query| query.count());
    match (precise, query) {
        (Some(count), _) => count,
        (None, MaybeFiltered::Unfiltered(query)) => {
            let search = Counting { layers: query.layers(), bound: query.bound, keep: KeepAll };
            dispatch_or(simd, search, |Counting { layers, bound, .. }| {
                dispatch(simd, Counting { layers, bound, keep: ALL })
            })
        }
        (None, MaybeFiltered::Filtered(query)) => {
            dispatch(simd, Counting { layers: query.layers(), bound: query.bound, keep: query.keep })
        }
    }
}

/// Calls `visit` with all points within the radius, some at a time, until it breaks.
pub(in crate::point) fn for_some(query: &PreparedQuery<'_, KeepAll>, visit: VisitSome<'_>) -> ControlFlow<()> {
    if query.is_precise() {
        return query.precise(|query| query.for_some(visit));
    }
    dispatch(query.tree.simd, Visiting { layers: query.layers(), bound: query.bound, visit })
}

struct Nearest<'a, K> {
    layers: QueriedLayers<'a>,
    limits: Limits,
    keep: K,
}

impl<K: Keep> Kernel for Nearest<'_, K> {
    type Output = Option<(u32, f32)>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<(u32, f32)> {
        let Nearest { layers, limits: Limits { bound, shrink }, keep } = self;
        let mut best = Best::within(s, bound, shrink, &keep);
        layers.nearest(s, &mut best);
        best.finish(s)
    }
}

struct NearestN<'a, 'b, K, O> {
    layers: QueriedLayers<'a>,
    limits: Limits,
    keep: K,
    k: usize,
    candidates: &'b mut Candidates,
    found: &'b mut Vec<Neighbor>,
    observe: &'b mut O,
}

impl<K: Keep, O: Observe> Kernel for NearestN<'_, '_, K, O> {
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

struct Collecting<'a, 'b, K> {
    layers: QueriedLayers<'a>,
    bound: f32,
    keep: K,
    candidates: &'b mut Candidates,
}

impl<K: Keep> Kernel for Collecting<'_, '_, K> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Collecting { layers, bound, keep, candidates } = self;
        // A sink that never breaks.
        let _ = layers.within(s, bound, &mut Gather { candidates, keep: &keep });
    }
}

struct Counting<'a, K> {
    layers: QueriedLayers<'a>,
    bound: f32,
    keep: K,
}

impl<K: Keep> Kernel for Counting<'_, K> {
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

struct Visiting<'a, 'v> {
    layers: QueriedLayers<'a>,
    bound: f32,
    visit: VisitSome<'v>,
}

impl Kernel for Visiting<'_, '_> {
    type Output = ControlFlow<()>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> ControlFlow<()> {
        let mut sink = Visit::new(self.visit);
        self.layers.within(s, self.bound, &mut sink)?;
        sink.finish()
    }
}
