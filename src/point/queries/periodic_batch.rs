//! Batches of queries in periodic boxes: in parallel and in an order of locality, as those in open space.

use super::batch::NeighborBatch;
use super::periodic::{PeriodicPoints, PeriodicQuery};
use crate::point::neighbor::Neighbor;
use crate::point::search::Keep;
use crate::primitive::Position;

impl<'a> PeriodicPoints<'a> {
    /// The nearest point of each query `(point, time)`, as [`PeriodicQuery::nearest`] gives it.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.1f32, 0.5, 0.5], [0.7, 0.5, 0.5]], &PointParams::default())?;
    /// let nearest = tree.periodic([Some(1.0); 3])?.nearest_batch(&[([0.95f32, 0.5, 0.5], 0.0), ([0.8, 0.5, 0.5], 0.0)]);
    /// assert_eq!(nearest.iter().map(|near| near.map(|near| near.id)).collect::<Vec<_>>(), [Some(0), Some(1)]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn nearest_batch<Q: Position>(&self, queries: &[(Q, f32)]) -> Vec<Option<Neighbor>> {
        self.nearest_batch_with(queries, |_, query| query)
    }

    /// The nearest point of each query with options of its own, as
    /// [`PointTree::nearest_batch_with`](crate::PointTree::nearest_batch_with).
    pub fn nearest_batch_with<Q: Position, K: Keep>(
        &self,
        queries: &[(Q, f32)],
        options: impl Fn(usize, PeriodicQuery<'a>) -> PeriodicQuery<'a, K> + Sync,
    ) -> Vec<Option<Neighbor>> {
        self.tree.answers(queries, |index, (point, time)| options(index, self.query(point, time)).nearest())
    }

    /// The `k` nearest points of each query, as [`PeriodicQuery::nearest_n`] gives them.
    pub fn nearest_n_batch<Q: Position>(&self, queries: &[(Q, f32)], k: usize) -> NeighborBatch {
        self.nearest_n_batch_with(queries, k, |_, query| query)
    }

    /// The `k` nearest points of each query with options of its own, as
    /// [`PointTree::nearest_batch_with`](crate::PointTree::nearest_batch_with).
    pub fn nearest_n_batch_with<Q: Position, K: Keep>(
        &self,
        queries: &[(Q, f32)],
        k: usize,
        options: impl Fn(usize, PeriodicQuery<'a>) -> PeriodicQuery<'a, K> + Sync,
    ) -> NeighborBatch {
        self.tree.lists(queries, |index, (point, time), buffer| {
            options(index, self.query(point, time)).nearest_n_into(k, buffer)
        })
    }

    /// The points within `radius` of each query, in order of (distance, id).
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.1f32, 0.5, 0.5], [0.7, 0.5, 0.5]], &PointParams::default())?;
    /// let lists = tree.periodic([Some(1.0); 3])?.within_batch(&[([0.95f32, 0.5, 0.5], 0.0), ([0.4, 0.5, 0.5], 0.0)], 0.28);
    /// assert_eq!(lists.row(0).iter().map(|near| near.id).collect::<Vec<_>>(), [0, 1]);
    /// assert!(lists.row(1).is_empty());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn within_batch<Q: Position>(&self, queries: &[(Q, f32)], radius: f32) -> NeighborBatch {
        self.within_batch_with(queries, |_, query| query.radius(radius))
    }

    /// The points of each query with options of its own, in order of (distance, id), as
    /// [`PointTree::within_batch_with`](crate::PointTree::within_batch_with).
    pub fn within_batch_with<Q: Position, K: Keep>(
        &self,
        queries: &[(Q, f32)],
        options: impl Fn(usize, PeriodicQuery<'a>) -> PeriodicQuery<'a, K> + Sync,
    ) -> NeighborBatch {
        self.tree.lists(queries, |index, (point, time), buffer| {
            options(index, self.query(point, time)).collect_sorted_into(buffer)
        })
    }

    /// The number of points within `radius` of each query.
    pub fn count_batch<Q: Position>(&self, queries: &[(Q, f32)], radius: f32) -> Vec<usize> {
        self.count_batch_with(queries, |_, query| query.radius(radius))
    }

    /// The number of points that each query with options of its own finds, as
    /// [`PointTree::count_batch_with`](crate::PointTree::count_batch_with).
    pub fn count_batch_with<Q: Position, K: Keep>(
        &self,
        queries: &[(Q, f32)],
        options: impl Fn(usize, PeriodicQuery<'a>) -> PeriodicQuery<'a, K> + Sync,
    ) -> Vec<usize> {
        self.tree.answers(queries, |index, (point, time)| options(index, self.query(point, time)).count())
    }
}
