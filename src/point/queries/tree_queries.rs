//! The common queries of a point tree as single calls.

use super::query::NeighborQuery;
use crate::point::neighbor::Neighbor;
use crate::point::tree::PointTree;
use crate::primitive::Position;

impl PointTree {
    /// A query at `point` and `time`. The caller sets its options (radius, predicate, approximation) and runs it.
    #[inline(always)]
    pub fn query<Q: Position>(&self, point: Q, time: f32) -> NeighborQuery<'_> {
        NeighborQuery::new(self, point, time)
    }

    /// The nearest point at a time. Ties go to the lowest id.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3]], &PointParams::default())?;
    /// assert_eq!(tree.nearest([0.9f32; 3], 0.5).map(|n| n.id), Some(1));
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn nearest<Q: Position>(&self, point: Q, time: f32) -> Option<Neighbor> {
        self.query(point, time).nearest()
    }

    /// The `k` nearest points at a time, in order of (distance, id); all if there are fewer.
    ///
    /// Allocates the result; in a loop use [`NeighborQuery::nearest_n_into`].
    pub fn nearest_n<Q: Position>(&self, point: Q, time: f32, k: usize) -> Vec<Neighbor> {
        self.query(point, time).nearest_n(k)
    }

    /// The `k` nearest points that are no farther than `radius`, in order of (distance, id).
    pub fn nearest_n_within<Q: Position>(&self, point: Q, time: f32, k: usize, radius: f32) -> Vec<Neighbor> {
        self.query(point, time).radius(radius).nearest_n(k)
    }

    /// All points no farther than `radius` (squared distance at most `radius * radius` in f32), in no
    /// particular order.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3]], &PointParams::default())?;
    /// assert_eq!(tree.within([0.0f32; 3], 0.0, 1.5).len(), 1);
    /// assert_eq!(tree.within([0.0f32; 3], 0.0, f32::INFINITY).len(), 2);
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn within<Q: Position>(&self, point: Q, time: f32, radius: f32) -> Vec<Neighbor> {
        self.query(point, time).radius(radius).collect()
    }

    /// The number of points no farther than `radius`.
    pub fn count_within<Q: Position>(&self, point: Q, time: f32, radius: f32) -> usize {
        self.query(point, time).radius(radius).count()
    }
}
