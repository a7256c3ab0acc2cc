//! Queries as callers see them: where, when, how far, which points, and then what to do with them.

use super::neighbor::Neighbor;
use super::partition::{nearest_in_all, walk_all, within_all};
use super::precise::{Allowed, Asked};
use super::search::candidates::Candidates;
use super::search::k_nearest::KNearest;
use super::search::nearest::Best;
use super::search::radius::Sink;
use super::search::sort::{all_in_order, few_in_order, nearest_in_order};
use super::search::{Keep, KeepAll, KeepIf, NeighborWork, Observe, kept};
use super::snapshot::View;
use super::tree::PointTree;
use crate::limits::MAX_POINT_COORDINATE;
use crate::primitive::Position;
use crate::simd::{Kernel, LANES, Mask, Simd, dispatch};
use core::ops::ControlFlow;
use glam::{DVec3, Vec3};

/// Memory for results and candidates. Reused from query to query, a loop allocates nothing once the
/// buffer has grown to what its queries need.
///
/// ```
/// use mbkd::{NeighborBuffer, PointParams, PointTree};
/// let points = [[0.0f32; 3], [1.0; 3], [2.0; 3]];
/// let tree = PointTree::build(&points, &PointParams::default())?;
/// let mut buffer = NeighborBuffer::new();
/// for (i, p) in points.iter().enumerate() {
///     let others = tree.query(*p, 0.0).filter(|id| id != i as u32).nearest_n_into(2, &mut buffer);
///     assert_eq!(others.len(), 2);
/// }
/// # Ok::<(), mbkd::PointError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct NeighborBuffer {
    pub(super) candidates: Candidates,
    pub(super) found: Vec<Neighbor>,
}

impl NeighborBuffer {
    /// An empty buffer; it grows with the first queries.
    pub fn new() -> NeighborBuffer {
        NeighborBuffer::default()
    }

    /// The results of the last query.
    pub fn found(&self) -> &[Neighbor] {
        &self.found
    }
}

/// A query in preparation: refine it by [`radius`](NeighborQuery::radius),
/// [`filter`](NeighborQuery::filter) and [`approximate`](NeighborQuery::approximate), then run it.
///
/// Made by [`PointTree::query`]. All runs look at the points that exist at the query's time only.
#[derive(Clone, Copy)]
#[must_use = "a query does nothing until one of its runs is called"]
pub struct NeighborQuery<'a, K = KeepAll> {
    pub(super) tree: &'a PointTree,
    pub(super) point: Vec3,
    /// The same as it was given.
    exact: DVec3,
    pub(super) time: f32,
    /// Squared distance up to which points count; negative where nothing does.
    pub(super) bound: f32,
    /// Factor on the bound for boxes: 1, or less where answers may be approximate.
    shrink: f32,
    pub(super) keep: K,
}

impl<'a> NeighborQuery<'a> {
    #[inline(always)]
    pub(super) fn new(tree: &'a PointTree, at: impl Position, time: f32) -> Self {
        let (exact, point) = (at.wide(), at.relative(tree.origin));
        let most = Vec3::splat(MAX_POINT_COORDINATE as f32);
        // Also false for NaN.
        let valid = point.abs().cmple(most).all() && (0.0..=1.0).contains(&time);
        NeighborQuery {
            tree,
            point,
            exact,
            time,
            bound: if valid { f32::MAX } else { -1.0 },
            shrink: 1.0,
            keep: KeepAll,
        }
    }

    /// Only points whose id the predicate returns true for. It must be pure: it may be asked more than
    /// once about a point, and is asked only about points that are near enough to matter.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3], [2.0; 3]], &PointParams::default())?;
    /// let other = tree.query([1.0f32; 3], 0.0).filter(|id| id != 1).nearest();
    /// assert_eq!(other.map(|n| n.id), Some(0));
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    #[inline(always)]
    pub fn filter<F: Fn(u32) -> bool>(self, predicate: F) -> NeighborQuery<'a, KeepIf<F>> {
        let NeighborQuery { tree, point, exact, time, bound, shrink, keep: _ } = self;
        NeighborQuery { tree, point, exact, time, bound, shrink, keep: KeepIf(predicate) }
    }
}

impl<'a, K: Keep> NeighborQuery<'a, K> {
    /// Only points whose squared distance is at most `radius * radius` (computed in f32). Infinity is no
    /// restriction; with a negative or NaN radius nothing is found.
    #[inline(always)]
    pub fn radius(self, radius: f32) -> Self {
        let bound = if radius >= 0.0 { (radius * radius).min(self.bound) } else { -1.0 };
        NeighborQuery { bound, ..self }
    }

    /// Allows answers whose distance is up to 1 + `epsilon` times that of the exact answer: of `nearest`, and of
    /// each place of `nearest_n`. As many points are found as without it, all of them within the radius. Runs that
    /// want all points in a radius stay exact. A negative or NaN `epsilon` counts as 0; an infinite one takes the
    /// first points that the search comes to.
    ///
    /// As soon as k points are known to lie within a squared distance d², boxes farther away than `d² / (1 + epsilon)²`
    /// are passed by. The factor is rounded up, so the guarantee holds for the distances as computed.
    #[inline(always)]
    pub fn approximate(self, epsilon: f32) -> Self {
        let shrink = if epsilon > 0.0 {
            let factor = 1.0 + f64::from(epsilon);
            ((1.0 / (factor * factor)) as f32).next_up().next_up().min(1.0)
        } else {
            1.0
        };
        NeighborQuery { shrink, ..self }
    }

    #[inline(always)]
    fn finds_something(&self) -> bool {
        self.bound >= 0.0
    }

    /// Whether the points are kept in f64.
    #[inline(always)]
    pub(super) fn is_precise(&self) -> bool {
        !self.tree.precise.is_empty()
    }

    /// Asks the same of points in f64.
    #[cold]
    #[inline(never)]
    pub(super) fn asked<R>(&self, run: impl FnOnce(&Asked<'_>) -> R) -> R {
        let keep = |id| self.keep.keep(id);
        let PointTree { precise, simd, .. } = self.tree;
        run(&Asked {
            layers: precise,
            simd: *simd,
            point: self.exact,
            time: self.time,
            bound: self.bound,
            shrink: self.shrink,
            keep: Allowed(K::ASKS.then_some(&keep as &dyn Fn(u32) -> bool)),
        })
    }

    /// The nearest point; of several at the same distance the one with the lowest id.
    #[inline(always)]
    pub fn nearest(self) -> Option<Neighbor> {
        if !self.finds_something() {
            return None;
        }
        let found = if self.is_precise() {
            self.asked(|asked| asked.nearest())
        } else {
            dispatch(self.tree.simd, Nearest(&self))
        };
        found.map(|(id, distance_squared)| Neighbor { id, distance_squared })
    }

    /// The `k` nearest points in order of (distance, id); all where there are fewer.
    pub fn nearest_n(self, k: usize) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::new();
        self.nearest_n_into(k, &mut buffer);
        buffer.found
    }

    /// The same, into a buffer of the caller.
    #[inline(always)]
    pub fn nearest_n_into(self, k: usize, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        buffer.found.clear();
        if self.finds_something() && k > 0 {
            let candidates = &mut buffer.candidates;
            let found = &mut buffer.found;
            let done = if self.is_precise() {
                self.asked(|asked| asked.nearest_n(k, candidates, found, &mut NeighborWork::default()))
            } else {
                dispatch(self.tree.simd, NearestN { query: &self, k, candidates, found, observe: &mut () })
            };
            if !done {
                nearest_in_order(self.tree.simd, k, candidates, &mut buffer.found);
            }
        }
        &buffer.found
    }

    /// The work that [`NeighborQuery::nearest_n`] does for this query.
    pub fn work(self, k: usize) -> NeighborWork {
        let mut work = NeighborWork::default();
        if self.finds_something() && k > 0 {
            let candidates = &mut Candidates::default();
            let found = &mut Vec::new();
            if self.is_precise() {
                self.asked(|asked| asked.nearest_n(k, candidates, found, &mut work));
            } else {
                dispatch(self.tree.simd, NearestN { query: &self, k, candidates, found, observe: &mut work });
            }
        }
        work
    }

    /// All points within the radius, in no particular order.
    pub fn collect(self) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::new();
        self.collect_into(&mut buffer);
        buffer.found
    }

    /// The same, into a buffer of the caller.
    #[inline(always)]
    pub fn collect_into(self, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        buffer.found.clear();
        if self.finds_something() {
            let candidates = &mut buffer.candidates;
            self.gather(candidates);
            let pairs = candidates.ids[..candidates.count].iter().zip(&candidates.distances);
            buffer.found.extend(pairs.map(|(&id, &distance_squared)| Neighbor { id, distance_squared }));
        }
        &buffer.found
    }

    /// All points within the radius, in order of (distance, id).
    pub fn collect_sorted(self) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::new();
        self.collect_sorted_into(&mut buffer);
        buffer.found
    }

    /// The same, into a buffer of the caller.
    #[inline(always)]
    pub fn collect_sorted_into(self, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        buffer.found.clear();
        if self.finds_something() {
            let candidates = &mut buffer.candidates;
            self.gather(candidates);
            all_in_order(self.tree.simd, candidates, &mut buffer.found);
        }
        &buffer.found
    }

    #[inline(always)]
    fn gather(&self, candidates: &mut Candidates) {
        if self.is_precise() {
            self.asked(|asked| asked.collect(candidates));
        } else {
            dispatch(self.tree.simd, Collecting { query: self, candidates });
        }
    }

    /// How many points are within the radius.
    pub fn count(self) -> usize {
        if !self.finds_something() {
            return 0;
        }
        if self.is_precise() {
            let mut candidates = Candidates::default();
            self.asked(|asked| asked.collect(&mut candidates));
            return candidates.count;
        }
        dispatch(self.tree.simd, Counting(&self))
    }

    /// Calls `visit` for every point within the radius, in no particular order, until it returns
    /// `Break`; returns that.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3], [9.0; 3]], &PointParams::default())?;
    /// let mut sum = 0.0;
    /// let flow = tree.query([0.0f32; 3], 0.0).radius(2.0).for_each(|n| {
    ///     sum += n.distance_squared;
    ///     ControlFlow::Continue(())
    /// });
    /// assert_eq!((flow, sum), (ControlFlow::Continue(()), 3.0));
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn for_each(self, mut visit: impl FnMut(Neighbor) -> ControlFlow<()>) -> ControlFlow<()> {
        if !self.finds_something() {
            return ControlFlow::Continue(());
        }
        if self.is_precise() {
            return self.asked(|asked| asked.visit(&mut visit));
        }
        dispatch(self.tree.simd, Visiting { query: &self, visit })
    }
}

struct Nearest<'q, 'a, K>(&'q NeighborQuery<'a, K>);

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

struct NearestN<'q, 'a, 'b, K, O> {
    query: &'q NeighborQuery<'a, K>,
    k: usize,
    candidates: &'b mut Candidates,
    found: &'b mut Vec<Neighbor>,
    observe: &'b mut O,
}

impl<K: Keep, O: Observe> Kernel for NearestN<'_, '_, '_, K, O> {
    /// Whether what was found is in order already.
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let NearestN { query: q, k, candidates, found, observe } = self;
        let mut search = KNearest::within(k, q.bound, q.shrink, candidates, &q.keep, observe);
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
    query: &'q NeighborQuery<'a, K>,
    candidates: &'b mut Candidates,
}

impl<K: Keep> Kernel for Collecting<'_, '_, '_, K> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Collecting { query: q, candidates } = self;
        candidates.count = 0;
        let mut sink = Gather { candidates, keep: &q.keep };
        // A sink that never breaks.
        let _ = within_all(s, &q.tree.layers, (q.point, q.time), q.bound, &mut sink, &mut ());
    }
}

/// Appends what is found to candidates.
pub(super) struct Gather<'a, K> {
    pub(super) candidates: &'a mut Candidates,
    pub(super) keep: &'a K,
}

impl<S: Simd, K: Keep> Sink<S> for Gather<'_, K> {
    const TAKES_NONE: bool = true;
    #[inline(always)]
    fn take<V: View>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let ids = view.ids(block);
        self.candidates.reserve(0);
        self.candidates.push(s, distance, s.load_u(ids), kept(self.keep, ids, hits));
        ControlFlow::Continue(())
    }
}

struct Count<'q, K> {
    keep: &'q K,
    count: usize,
}

impl<S: Simd, K: Keep> Sink<S> for Count<'_, K> {
    const TAKES_NONE: bool = true;
    #[inline(always)]
    fn take<V: View>(&mut self, _: S, view: &V, block: usize, _: S::F, hits: Mask) -> ControlFlow<()> {
        self.count += kept(self.keep, view.ids(block), hits).count_ones() as usize;
        ControlFlow::Continue(())
    }
}

pub(super) struct Visit<'q, K, F> {
    pub(super) keep: &'q K,
    pub(super) visit: F,
}

impl<S: Simd, K: Keep, F: FnMut(Neighbor) -> ControlFlow<()>> Sink<S> for Visit<'_, K, F> {
    const TAKES_NONE: bool = false;
    #[inline(always)]
    fn take<V: View>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let ids = view.ids(block);
        let mut rest = kept(self.keep, ids, hits);
        let mut distances = [0.0; LANES];
        s.store(distance, &mut distances);
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            (self.visit)(Neighbor { id: ids[lane], distance_squared: distances[lane] })?;
        }
        ControlFlow::Continue(())
    }
}

struct Counting<'q, 'a, K>(&'q NeighborQuery<'a, K>);

impl<K: Keep> Kernel for Counting<'_, '_, K> {
    type Output = usize;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> usize {
        let q = self.0;
        let mut sink = Count { keep: &q.keep, count: 0 };
        // A sink that never breaks.
        let _ = within_all(s, &q.tree.layers, (q.point, q.time), q.bound, &mut sink, &mut ());
        sink.count
    }
}

struct Visiting<'q, 'a, K, F> {
    query: &'q NeighborQuery<'a, K>,
    visit: F,
}

impl<K: Keep, F: FnMut(Neighbor) -> ControlFlow<()>> Kernel for Visiting<'_, '_, K, F> {
    type Output = ControlFlow<()>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> ControlFlow<()> {
        let q = self.query;
        let mut sink = Visit { keep: &q.keep, visit: self.visit };
        within_all(s, &q.tree.layers, (q.point, q.time), q.bound, &mut sink, &mut ())
    }
}
