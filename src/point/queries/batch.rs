//! Batches of queries: in parallel, in an order that is coherent in space, results in the caller's order.
//!
//! Queries are sorted along a Morton curve, so that each finds in the cache what the one before has read (unless the
//! cache holds the whole tree anyway), and divided into runs for the threads. Each query is answered on its own, so
//! neither the order nor the number of threads can change an answer.

use super::buffer::NeighborBuffer;
use super::query::NeighborQuery;
use crate::geometry::morton_code;
use crate::parallel;
use crate::point::neighbor::Neighbor;
use crate::point::search::Keep;
use crate::point::tree::PointTree;
use crate::primitive::Position;
use crate::tuning::points::NEAR;
use glam::Vec3;

/// Neighbours of many queries: one list for each, in the order of the queries.
///
/// ```
/// use mbkd::{PointParams, PointTree};
/// let points = [[0.0f32; 3], [1.0; 3], [2.0; 3]];
/// let tree = PointTree::build(&points, &PointParams::default())?;
/// let queries: Vec<_> = points.iter().map(|p| (*p, 0.5)).collect();
/// let lists = tree.nearest_n_batch(&queries, 2);
/// assert_eq!(lists.len(), 3);
/// assert_eq!(lists.row(2).iter().map(|n| n.id).collect::<Vec<_>>(), [2, 1]);
/// # Ok::<(), mbkd::PointError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct NeighborBatch {
    /// Begin of each list, and the end of the last.
    begin: Vec<usize>,
    neighbors: Vec<Neighbor>,
}

impl NeighborBatch {
    /// Number of lists.
    pub fn len(&self) -> usize {
        self.begin.len() - 1
    }

    /// Whether there is no list.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The neighbours of a query.
    ///
    /// # Panics
    /// If `query` is not less than [`NeighborBatch::len`].
    pub fn row(&self, query: usize) -> &[Neighbor] {
        &self.neighbors[self.begin[query]..self.begin[query + 1]]
    }

    /// The lists in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[Neighbor]> {
        self.begin.windows(2).map(|ends| &self.neighbors[ends[0]..ends[1]])
    }
}

/// Number of queries that one thread answers in a row.
const RUN: usize = 512;

impl PointTree {
    /// The nearest point of each query `(point, time)`, as [`PointTree::nearest`] gives it.
    pub fn nearest_batch<Q: Position>(&self, queries: &[(Q, f32)]) -> Vec<Option<Neighbor>> {
        self.nearest_batch_with(queries, |_, query| query)
    }

    /// The nearest point of each query with options of its own, as [`NeighborQuery::nearest`] gives it.
    ///
    /// `options` gets the index of a query in `queries` and the query, and returns it with a radius, a filter or an allowed error
    /// ([`NeighborQuery`]). It must be pure, and is called from any thread.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let points = [[0.0f32; 3], [1.0; 3], [3.0; 3]];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let queries: Vec<_> = points.iter().map(|p| (*p, 0.5)).collect();
    /// // Of each point the nearest other one, up to a distance of 2.
    /// let others = tree.nearest_batch_with(&queries, |index, query| query.radius(2.0).filter(move |id| id != index as u32));
    /// assert_eq!(others.iter().map(|near| near.map(|n| n.id)).collect::<Vec<_>>(), [Some(1), Some(0), None]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn nearest_batch_with<'a, Q: Position, K: Keep>(
        &'a self,
        queries: &[(Q, f32)],
        options: impl Fn(usize, NeighborQuery<'a>) -> NeighborQuery<'a, K> + Sync,
    ) -> Vec<Option<Neighbor>> {
        self.answers(queries, |index, (point, time)| options(index, self.query(point, time)).nearest())
    }

    /// The `k` nearest points of each query, as [`PointTree::nearest_n`] gives them.
    pub fn nearest_n_batch<Q: Position>(&self, queries: &[(Q, f32)], k: usize) -> NeighborBatch {
        self.nearest_n_batch_with(queries, k, |_, query| query)
    }

    /// The `k` nearest points of each query with options of its own, as [`NeighborQuery::nearest_n`] gives them: see
    /// [`PointTree::nearest_batch_with`].
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let points = [[0.0f32; 3], [1.0; 3], [3.0; 3]];
    /// let tree = PointTree::build(&points, &PointParams::default())?;
    /// let (queries, radii) = (points.map(|p| (p, 0.5)), [1.0, 4.0, 4.0]);
    /// let lists = tree.nearest_n_batch_with(&queries, 2, |index, query| query.radius(radii[index]).approximate(0.1));
    /// assert_eq!(lists.iter().map(|list| list.len()).collect::<Vec<_>>(), [1, 2, 2]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn nearest_n_batch_with<'a, Q: Position, K: Keep>(
        &'a self,
        queries: &[(Q, f32)],
        k: usize,
        options: impl Fn(usize, NeighborQuery<'a>) -> NeighborQuery<'a, K> + Sync,
    ) -> NeighborBatch {
        self.lists(queries, |index, (point, time), buffer| {
            options(index, self.query(point, time)).nearest_n_into(k, buffer)
        })
    }

    /// The points within `radius` of each query, in order of (distance, id).
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0, 0.0, 0.0], [5.0; 3]], &PointParams::default())?;
    /// let lists = tree.within_batch(&[([0.75f32, 0.0, 0.0], 0.0), ([9.0; 3], 0.0)], 1.0);
    /// assert_eq!(lists.row(0).iter().map(|near| near.id).collect::<Vec<_>>(), [1, 0]);
    /// assert!(lists.row(1).is_empty());
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn within_batch<Q: Position>(&self, queries: &[(Q, f32)], radius: f32) -> NeighborBatch {
        self.within_batch_with(queries, |_, query| query.radius(radius))
    }

    /// The points of each query with options of its own, in order of (distance, id), as [`NeighborQuery::collect_sorted`] gives
    /// them: see [`PointTree::nearest_batch_with`]. Of a query without a radius these are all points.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], &PointParams::default())?;
    /// let queries = [([0.0f32; 3], 0.0), ([2.0, 0.0, 0.0], 0.0)];
    /// let lists = tree.within_batch_with(&queries, |index, query| query.radius([1.5, 0.5][index]).filter(|id| id > 0));
    /// assert_eq!((lists.row(0)[0].id, lists.row(1)[0].id, lists.row(1).len()), (1, 2, 1));
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn within_batch_with<'a, Q: Position, K: Keep>(
        &'a self,
        queries: &[(Q, f32)],
        options: impl Fn(usize, NeighborQuery<'a>) -> NeighborQuery<'a, K> + Sync,
    ) -> NeighborBatch {
        self.lists(queries, |index, (point, time), buffer| {
            options(index, self.query(point, time)).collect_sorted_into(buffer)
        })
    }

    /// The number of points within `radius` of each query, as [`PointTree::count_within`] gives it.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0, 0.0, 0.0], [5.0; 3]], &PointParams::default())?;
    /// assert_eq!(tree.count_batch(&[([0.75f32, 0.0, 0.0], 0.0), ([9.0; 3], 0.0)], 1.0), [2, 0]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn count_batch<Q: Position>(&self, queries: &[(Q, f32)], radius: f32) -> Vec<usize> {
        self.count_batch_with(queries, |_, query| query.radius(radius))
    }

    /// The number of points that each query with options of its own finds, as [`NeighborQuery::count`] gives it: see
    /// [`PointTree::nearest_batch_with`]. A query without a radius counts all points.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], &PointParams::default())?;
    /// let queries = [([0.0f32; 3], 0.0), ([2.0, 0.0, 0.0], 0.0)];
    /// let counts = tree.count_batch_with(&queries, |index, query| query.radius([1.5, 0.5][index]).filter(|id| id != 1));
    /// assert_eq!(counts, [1, 1]);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn count_batch_with<'a, Q: Position, K: Keep>(
        &'a self,
        queries: &[(Q, f32)],
        options: impl Fn(usize, NeighborQuery<'a>) -> NeighborQuery<'a, K> + Sync,
    ) -> Vec<usize> {
        self.answers(queries, |index, (point, time)| options(index, self.query(point, time)).count())
    }

    /// The answer of each query, given its index and itself.
    pub(super) fn answers<Q: Position, A: Clone + Default + Send>(
        &self,
        queries: &[(Q, f32)],
        answer: impl Fn(usize, (Q, f32)) -> A + Sync,
    ) -> Vec<A> {
        answered_in_order(&self.order(queries), |indices| {
            indices.iter().map(|&index| answer(index, queries[index])).collect()
        })
    }

    /// The list of each query, given its index and itself.
    pub(super) fn lists<Q: Position>(
        &self,
        queries: &[(Q, f32)],
        answer: impl for<'b> Fn(usize, (Q, f32), &'b mut NeighborBuffer) -> &'b [Neighbor] + Sync,
    ) -> NeighborBatch {
        lists_in_order(&self.order(queries), |index, buffer, out| {
            out.extend_from_slice(answer(index, queries[index], buffer));
        })
    }

    /// The order in which queries are answered. For a tree that fits a near cache any order will do.
    fn order<Q: Position>(&self, queries: &[(Q, f32)]) -> Vec<usize> {
        if self.statistics().bytes() <= NEAR {
            return (0..queries.len()).collect();
        }
        let positions: Vec<Vec3> = queries.iter().map(|(point, _)| point.relative(self.origin)).collect();
        morton_order(&positions)
    }
}

/// Answers queries in an order of their indices, a run of it at a time, in parallel; returns the answers by index.
pub(in crate::point) fn answered_in_order<T: Clone + Default + Send>(
    order: &[usize],
    answers_of: impl Fn(&[usize]) -> Vec<T> + Send + Sync,
) -> Vec<T> {
    let runs = in_runs(order, answers_of);
    let mut answers = vec![T::default(); order.len()];
    for (&index, answer) in order.iter().zip(runs.into_iter().flatten()) {
        answers[index] = answer;
    }
    answers
}

/// The lists of queries, which are made in an order of their indices, in parallel. `answer` appends the list of a query.
fn lists_in_order(
    order: &[usize],
    answer: impl Fn(usize, &mut NeighborBuffer, &mut Vec<Neighbor>) + Send + Sync,
) -> NeighborBatch {
    let runs = in_runs(order, |indices| {
        let mut buffer = NeighborBuffer::new();
        let mut run = Run { found: Vec::new(), ends: Vec::with_capacity(indices.len()) };
        for &index in indices {
            answer(index, &mut buffer, &mut run.found);
            run.ends.push(run.found.len());
        }
        run
    });
    // Where each query's list is: its run, and its offset in it.
    let mut begin = vec![0; order.len() + 1];
    let mut source = vec![(0u32, 0usize); order.len()];
    for (number, (indices, run)) in order.chunks(RUN).zip(&runs).enumerate() {
        let mut next = 0;
        for (&query, &end) in indices.iter().zip(&run.ends) {
            source[query] = (number as u32, next);
            begin[query + 1] = end - next;
            next = end;
        }
    }
    for i in 0..order.len() {
        begin[i + 1] += begin[i];
    }
    let mut neighbors = Vec::with_capacity(begin[order.len()]);
    for (ends, &(run, from)) in begin.windows(2).zip(&source) {
        neighbors.extend_from_slice(&runs[run as usize].found[from..from + (ends[1] - ends[0])]);
    }
    NeighborBatch { begin, neighbors }
}

/// Answers the runs of an order in parallel; returns the results in the order of the runs.
fn in_runs<R: Send>(order: &[usize], one: impl Fn(&[usize]) -> R + Send + Sync) -> Vec<R> {
    parallel::map(order.len().div_ceil(RUN), |run| one(&order[run * RUN..order.len().min((run + 1) * RUN)]))
}

/// Answers of a run of queries, one behind the other.
struct Run {
    found: Vec<Neighbor>,
    /// End of each query's answers.
    ends: Vec<usize>,
}

/// The indices of positions in the order of a Morton curve.
pub(in crate::point) fn morton_order(positions: &[Vec3]) -> Vec<usize> {
    let finite = positions.iter().copied().filter(|p| p.is_finite());
    let (lo, hi) = finite.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    let cells = (1u32 << 21) as f32;
    let scale = (cells - 1.0) / (hi - lo).max(Vec3::splat(f32::MIN_POSITIVE));
    let code = |p: Vec3| {
        // Casts saturate, and NaN becomes 0: every position has a code.
        let cell = (p - lo) * scale;
        morton_code([cell.x as u32, cell.y as u32, cell.z as u32])
    };
    // Index and code in one integer, which sorts in a third of the time of a pair: the index replaces as many of the
    // lowest bits of the code as it needs.
    let low = (1u64 << (usize::BITS - positions.len().leading_zeros())) - 1;
    let mut order: Vec<u64> = (0..).zip(positions).map(|(index, &p)| (code(p) & !low) | index).collect();
    order.sort_unstable();
    order.into_iter().map(|key| (key & low) as usize).collect()
}
