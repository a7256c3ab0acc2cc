//! The interface of neighbour queries: point, time, radius and filter, and then one of several runs.

use super::buffer::NeighborBuffer;
use super::compiled::{self, CompiledQuery, PreparedQuery};
use crate::limits::is_in_range;
use crate::point::neighbor::Neighbor;
use crate::point::search::{Allowed, Keep, KeepAll, KeepIf, NeighborWork};
use crate::point::tree::PointTree;
use crate::primitive::Position;
use crate::simd::{Lanes, Mask};
use core::fmt;
use core::ops::ControlFlow;
use glam::DVec3;

/// A neighbour query with its options: set [`radius`](NeighborQuery::radius), [`filter`](NeighborQuery::filter) and
/// [`approximate`](NeighborQuery::approximate), then run it.
///
/// [`PointTree::query`] makes it. All runs consider only points that exist at the query's time.
#[derive(Clone, Copy)]
#[must_use = "a query does nothing until one of its runs is called"]
pub struct NeighborQuery<'a, K = KeepAll> {
    pub(in crate::point) query: PreparedQuery<'a, K>,
}

impl<K> fmt::Debug for NeighborQuery<'_, K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let PreparedQuery { given, time, bound, .. } = &self.query;
        f.debug_struct("NeighborQuery")
            .field("position", given)
            .field("time", time)
            .field("radius_squared", bound)
            .finish_non_exhaustive()
    }
}

impl<'a> NeighborQuery<'a> {
    #[inline(always)]
    pub(in crate::point) fn new(tree: &'a PointTree, at: impl Position, time: f32) -> Self {
        let (given, point) = (at.wide(), at.relative(tree.origin));
        let valid = is_in_range(point) && (0.0..=1.0).contains(&time);
        let bound = if valid { f32::MAX } else { -1.0 };
        NeighborQuery { query: PreparedQuery { tree, point, given, time, bound, shrink: 1.0, keep: KeepAll } }
    }

    /// Considers only points for whose id the predicate returns true. It must be pure. It may be called more than once for
    /// a point, and is called only for points that are near enough to matter.
    ///
    /// To leave out one point alone, a search for one neighbour more that skips it is mostly faster, often twice.
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
        NeighborQuery { query: self.query.keeping(KeepIf(predicate)) }
    }
}

impl<'a, K: Keep> NeighborQuery<'a, K> {
    /// Considers only points whose squared distance is at most `radius * radius` (computed in f32). Infinity is no
    /// restriction; a negative or NaN radius finds nothing. Of several radii the least counts.
    #[inline(always)]
    pub fn radius(self, radius: f32) -> Self {
        let bound = if radius >= 0.0 { (radius * radius).min(self.query.bound) } else { -1.0 };
        NeighborQuery { query: PreparedQuery { bound, ..self.query } }
    }

    /// Allows answers whose distance is up to 1 + `epsilon` times that of the exact answer, for `nearest` and for each rank
    /// of `nearest_n`. The number of points found is the same, and all of them are within the radius. Runs that return all
    /// points in a radius stay exact. A negative or NaN `epsilon` counts as 0. With an infinite `epsilon` the search returns
    /// the first points that it reaches.
    ///
    /// As soon as k points are known to lie within a squared distance d², boxes farther away than `d² / (1 + epsilon)²`
    /// are culled. The factor is rounded up, so the guarantee holds for the distances as computed.
    #[inline(always)]
    pub fn approximate(self, epsilon: f32) -> Self {
        let shrink = if epsilon > 0.0 {
            let factor = 1.0 + f64::from(epsilon);
            // The next f32 is above the exact factor. The product with d² needs no more: a box is culled if its distance is an f32
            // above the product as rounded, and such an f32 is above the exact product too.
            ((1.0 / (factor * factor)) as f32).next_up().min(1.0)
        } else {
            1.0
        };
        NeighborQuery { query: PreparedQuery { shrink, ..self.query } }
    }

    #[inline(always)]
    pub(super) fn finds_something(&self) -> bool {
        self.query.bound >= 0.0
    }

    /// Whether answers may be farther away than the exact ones.
    #[inline(always)]
    pub(super) fn is_approximate(&self) -> bool {
        self.query.shrink < 1.0
    }

    /// The same query at another place, which must be in range, with another bound.
    #[inline(always)]
    pub(super) fn moved(&self, place: DVec3, bound: f32) -> NeighborQuery<'a, &K> {
        let query = self.query.keeping(&self.query.keep);
        NeighborQuery {
            query: PreparedQuery { point: place.relative(query.tree.origin), given: place, bound, ..query },
        }
    }

    /// Runs the query by one of the functions that are compiled in this crate.
    #[inline(always)]
    pub(super) fn run<R>(&self, run: impl FnOnce(&CompiledQuery<'a, '_>) -> R) -> R {
        if K::FILTERS {
            let kept = |ids: &Lanes<u32>, mask: Mask| self.query.keep.kept(ids, mask);
            run(&self.query.keeping(Allowed(Some(&kept))))
        } else {
            run(&self.query.keeping(Allowed(None)))
        }
    }

    /// The nearest point. Ties go to the lowest id.
    #[inline(always)]
    pub fn nearest(self) -> Option<Neighbor> {
        if !self.finds_something() {
            return None;
        }
        self.run(compiled::nearest)
    }

    /// The `k` nearest points in order of (distance, id); all if there are fewer.
    ///
    /// This and other runs that return a vector use memory that the thread keeps for them, up to a megabyte.
    pub fn nearest_n(self, k: usize) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::take();
        self.nearest_n_into(k, &mut buffer);
        buffer.into_found()
    }

    /// The same, with the caller's buffer for the result.
    #[inline(always)]
    pub fn nearest_n_into(self, k: usize, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        buffer.found.clear();
        if self.finds_something() && k > 0 {
            self.run(|query| compiled::nearest_n(query, k, &mut buffer.candidates, &mut buffer.found));
        }
        &buffer.found
    }

    /// The work that [`NeighborQuery::nearest_n`] does for this query. (For one neighbour without a list of candidates it does
    /// somewhat less.)
    pub fn work(self, k: usize) -> NeighborWork {
        if self.finds_something() && k > 0 {
            self.run(|query| compiled::work(query, k))
        } else {
            NeighborWork::default()
        }
    }

    /// All points within the radius, in no particular order.
    pub fn collect(self) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::take();
        self.collect_into(&mut buffer);
        buffer.into_found()
    }

    /// The same, with the caller's buffer for the result.
    #[inline(always)]
    pub fn collect_into(self, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        buffer.found.clear();
        if self.finds_something() {
            self.run(|query| compiled::collect(query, &mut buffer.candidates, &mut buffer.found));
        }
        &buffer.found
    }

    /// All points within the radius, in order of (distance, id).
    pub fn collect_sorted(self) -> Vec<Neighbor> {
        let mut buffer = NeighborBuffer::take();
        self.collect_sorted_into(&mut buffer);
        buffer.into_found()
    }

    /// The same, with the caller's buffer for the result.
    #[inline(always)]
    pub fn collect_sorted_into(self, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        buffer.found.clear();
        if self.finds_something() {
            self.run(|query| compiled::collect_sorted(query, &mut buffer.candidates, &mut buffer.found));
        }
        &buffer.found
    }

    /// The number of points within the radius.
    pub fn count(self) -> usize {
        if self.finds_something() { self.run(compiled::count) } else { 0 }
    }

    /// Calls `visit` for every point within the radius, in no particular order, until it returns `Break`. Returns the last
    /// return value of `visit`.
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
    #[inline]
    pub fn for_each(self, mut visit: impl FnMut(Neighbor) -> ControlFlow<()>) -> ControlFlow<()> {
        if !self.finds_something() {
            return ControlFlow::Continue(());
        }
        compiled::for_some(&self.query.keeping(Allowed(None)), &mut |ids, distances| {
            for (&id, &distance_squared) in ids.iter().zip(distances) {
                if self.query.keep.keep(id) {
                    visit(Neighbor { id, distance_squared })?;
                }
            }
            ControlFlow::Continue(())
        })
    }
}
