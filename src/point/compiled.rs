//! The queries as plain functions, compiled once in this crate.
//!
//! A search is compiled for each instruction set and each kind of tree. If callers instantiated it, every crate that asks
//! a tree would compile all of that again, once for each of its filters. So a caller's filter is called through `dyn`, once
//! for each block with something near, and what is compiled are two forms of each query: without and with a filter. For SSE2 it is the
//! latter alone, with a filter that lets everything through.

use super::counted::{CountedSearch, search_counted};
use super::neighbor::Neighbor;
use super::partition::{nearest_in_all, walk_all, within_all};
use super::precise::{Allowed, Asked};
use super::search::candidates::Candidates;
use super::search::k_nearest::KNearest;
use super::search::nearest::Best;
use super::search::sinks::{Count, Gather, Visit, VisitSome};
use super::search::sort::{all_in_order, few_in_order, nearest_in_order};
use super::search::{Keep, KeepAll, KeepLanes, NeighborWork};
use super::tree::PointTree;
use crate::simd::{Kernel, Lanes, Mask, Simd, SimdLevel, dispatch, dispatch_or};
use core::ops::ControlFlow;
use glam::{DVec3, Vec3};

/// What is asked of a tree.
#[derive(Clone, Copy)]
pub(super) struct Search<'a, K> {
    pub tree: &'a PointTree,
    /// Where, relative to the tree's origin.
    pub point: Vec3,
    /// Where, as the caller gave it.
    pub exact: DVec3,
    pub time: f32,
    /// Squared distance up to which points count; not negative.
    pub bound: f32,
    /// Factor on the bound for boxes: 1, or less where answers may be approximate.
    pub shrink: f32,
    pub keep: K,
}

impl<'a, K> Search<'a, K> {
    /// The same with another filter.
    fn keeping<L>(&self, keep: L) -> Search<'a, L> {
        let Search { tree, point, exact, time, bound, shrink, keep: _ } = *self;
        Search { tree, point, exact, time, bound, shrink, keep }
    }
}

impl<K: Keep> Search<'_, K> {
    /// Whether the points are kept in f64.
    #[inline(always)]
    pub(super) fn is_precise(&self) -> bool {
        !self.tree.precise.is_empty()
    }

    /// Asks the same of points in f64.
    #[cold]
    #[inline(never)]
    pub(super) fn asked<R>(&self, run: impl FnOnce(&Asked<'_>) -> R) -> R {
        let kept = |ids: &Lanes<u32>, mask: Mask| self.keep.kept(ids, mask);
        let PointTree { precise, simd, .. } = self.tree;
        run(&Asked {
            layers: precise,
            simd: *simd,
            point: self.exact,
            time: self.time,
            bound: self.bound,
            shrink: self.shrink,
            keep: Allowed(K::ASKS.then_some(&kept)),
        })
    }
}

/// A filter that lets everything through.
const ALL: KeepLanes<'static> = KeepLanes(&|_, mask| mask);

/// A query without or with a filter.
#[derive(Clone, Copy)]
pub(super) enum Either<'q, 'a> {
    All(&'q Search<'a, KeepAll>),
    Some(&'q Search<'a, KeepLanes<'q>>),
}

impl Either<'_, '_> {
    /// Asks points that are kept in f64, if they are.
    #[inline(always)]
    fn precise<R>(self, run: impl FnOnce(&Asked<'_>) -> R) -> Option<R> {
        match self {
            Either::All(query) => query.is_precise().then(|| query.asked(run)),
            Either::Some(query) => query.is_precise().then(|| query.asked(run)),
        }
    }

    #[inline(always)]
    fn simd(self) -> SimdLevel {
        match self {
            Either::All(query) => query.tree.simd,
            Either::Some(query) => query.tree.simd,
        }
    }
}

/// The nearest point.
pub(super) fn nearest(query: Either<'_, '_>) -> Option<Neighbor> {
    let found = match query.precise(|asked| asked.nearest()) {
        Some(found) => found,
        None => match query {
            Either::All(query) => dispatch_or(query.tree.simd, Nearest(query), |_| {
                dispatch(query.tree.simd, Nearest(&query.keeping(ALL)))
            }),
            Either::Some(query) => dispatch(query.tree.simd, Nearest(query)),
        },
    };
    found.map(|(id, distance_squared)| Neighbor { id, distance_squared })
}

/// The `k` nearest points in order, into an empty list.
pub(super) fn nearest_n(query: Either<'_, '_>, k: usize, candidates: &mut Candidates, found: &mut Vec<Neighbor>) {
    let precise = query.precise(|asked| asked.nearest_n(k, candidates, found, &mut NeighborWork::default()));
    if let Some(in_order) = precise {
        if !in_order {
            nearest_in_order(query.simd(), k, candidates, found);
        }
        return;
    }
    let in_order = match query {
        Either::All(query) => {
            let search = NearestN { query, k, candidates: &mut *candidates, found };
            dispatch_or(query.tree.simd, search, |search| {
                filtered(&query.keeping(ALL), k, search.candidates);
                false
            })
        }
        Either::Some(query) => {
            filtered(query, k, candidates);
            false
        }
    };
    if !in_order {
        nearest_in_order(query.simd(), k, candidates, found);
    }
}

/// The same with a filter, not yet in order.
fn filtered(query: &Search<'_, KeepLanes<'_>>, k: usize, candidates: &mut Candidates) -> NeighborWork {
    let &Search { tree, point, time, bound, shrink, keep, .. } = query;
    let search = CountedSearch { layers: &[(&tree.layers, time)], point, k, bound, shrink, keep };
    search_counted(tree.simd, &search, candidates)
}

/// The work of finding the `k` nearest.
pub(super) fn work(query: Either<'_, '_>, k: usize) -> NeighborWork {
    let (mut candidates, mut found, mut work) = (Candidates::default(), Vec::new(), NeighborWork::default());
    if query.precise(|asked| asked.nearest_n(k, &mut candidates, &mut found, &mut work)).is_some() {
        return work;
    }
    let query = match query {
        Either::All(query) => query.keeping(ALL),
        Either::Some(query) => *query,
    };
    filtered(&query, k, &mut candidates)
}

/// Gathers all points within the radius.
fn gather(query: Either<'_, '_>, candidates: &mut Candidates) {
    if query.precise(|asked| asked.collect(candidates)).is_some() {
        return;
    }
    candidates.count = 0;
    match query {
        Either::All(query) => dispatch_or(query.tree.simd, Collecting { query, candidates }, |collecting| {
            append(&query.keeping(ALL), collecting.candidates);
        }),
        Either::Some(query) => append(query, candidates),
    }
}

/// Appends all points within the radius that pass a filter to candidates, from a tree of points in f32.
pub(super) fn append(query: &Search<'_, KeepLanes<'_>>, candidates: &mut Candidates) {
    dispatch(query.tree.simd, Collecting { query, candidates });
}

/// All points within the radius in any order, into an empty list.
pub(super) fn collect(query: Either<'_, '_>, candidates: &mut Candidates, found: &mut Vec<Neighbor>) {
    gather(query, candidates);
    let pairs = candidates.ids[..candidates.count].iter().zip(&candidates.distances);
    found.extend(pairs.map(|(&id, &distance_squared)| Neighbor { id, distance_squared }));
}

/// All points within the radius in order, into an empty list.
pub(super) fn collect_sorted(query: Either<'_, '_>, candidates: &mut Candidates, found: &mut Vec<Neighbor>) {
    gather(query, candidates);
    all_in_order(query.simd(), candidates, found);
}

/// The number of points within the radius.
pub(super) fn count(query: Either<'_, '_>) -> usize {
    let mut candidates = Candidates::default();
    if query.precise(|asked| asked.collect(&mut candidates)).is_some() {
        return candidates.count;
    }
    match query {
        Either::All(query) => {
            dispatch_or(query.tree.simd, Counting(query), |_| dispatch(query.tree.simd, Counting(&query.keeping(ALL))))
        }
        Either::Some(query) => dispatch(query.tree.simd, Counting(query)),
    }
}

/// Calls `visit` with all points within the radius, some at a time, until it breaks.
pub(super) fn for_some(query: &Search<'_, KeepAll>, visit: VisitSome<'_>) -> ControlFlow<()> {
    if query.is_precise() {
        return query.asked(|asked| asked.for_some(visit));
    }
    dispatch(query.tree.simd, Visiting { query, visit })
}

struct Nearest<'q, 'a, K>(&'q Search<'a, K>);

impl<K: Keep> Kernel for Nearest<'_, '_, K> {
    type Output = Option<(u32, f32)>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<(u32, f32)> {
        let q = self.0;
        let observe = &mut ();
        let mut best = Best::within(s, q.bound, q.shrink, &q.keep, observe);
        nearest_in_all(s, &q.tree.layers, (q.point, q.time), &mut best);
        best.finish(s)
    }
}

struct NearestN<'q, 'a, 'b> {
    query: &'q Search<'a, KeepAll>,
    k: usize,
    candidates: &'b mut Candidates,
    found: &'b mut Vec<Neighbor>,
}

impl Kernel for NearestN<'_, '_, '_> {
    /// Whether what was found is in order already.
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let NearestN { query: q, k, candidates, found } = self;
        let observe = &mut ();
        let mut search = KNearest::within(k, q.bound, q.shrink, candidates, &KeepAll, observe);
        loop {
            walk_all(s, &q.tree.layers, (q.point, q.time), &mut search);
            if !search.again() {
                break;
            }
        }
        few_in_order(s, k, candidates, found)
    }
}

struct Collecting<'q, 'a, 'b, K> {
    query: &'q Search<'a, K>,
    candidates: &'b mut Candidates,
}

impl<K: Keep> Kernel for Collecting<'_, '_, '_, K> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Collecting { query: q, candidates } = self;
        let mut sink = Gather { candidates, keep: &q.keep };
        // A sink that never breaks.
        let _ = within_all(s, &q.tree.layers, (q.point, q.time), q.bound, &mut sink, &mut ());
    }
}

struct Counting<'q, 'a, K>(&'q Search<'a, K>);

impl<K: Keep> Kernel for Counting<'_, '_, K> {
    type Output = usize;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> usize {
        let q = self.0;
        let mut sink = Count { count: 0, keep: &q.keep };
        // A sink that never breaks.
        let _ = within_all(s, &q.tree.layers, (q.point, q.time), q.bound, &mut sink, &mut ());
        sink.count
    }
}

struct Visiting<'q, 'a, 'v> {
    query: &'q Search<'a, KeepAll>,
    visit: VisitSome<'v>,
}

impl Kernel for Visiting<'_, '_, '_> {
    type Output = ControlFlow<()>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> ControlFlow<()> {
        let q = self.query;
        let mut sink = Visit::new(self.visit);
        within_all(s, &q.tree.layers, (q.point, q.time), q.bound, &mut sink, &mut ())?;
        sink.finish()
    }
}
