//! Radius queries in bulk: the queries become a tree of their own, and its leaves walk through the other one.

use super::csr::NeighborCsr;
use super::error::ListError;
use crate::limits::MAX_POINT_COORDINATE;
use crate::point::tree::{PointParams, PointTree};
use crate::primitive::Position;
use glam::Vec3;

impl PointTree {
    /// The ids of all points within `radius` of each query at `time`: what [`PointTree::within`] finds for each of them,
    /// unsorted and without distances.
    ///
    /// Rows come in the order in which they are made, in which queries that are close in space follow each other;
    /// [`NeighborCsr::points`] says which query each belongs to. Queries may come in any order: they are put in one of
    /// their own, at the cost of a build over them, and neighbouring ones answered together.
    ///
    /// ```
    /// use mbkd::{NeighborCsr, PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3], [9.0; 3]], &PointParams::default())?;
    /// let mut lists = NeighborCsr::new();
    /// tree.within_lists(&[[0.5f32; 3]], 0.0, 2.0, &mut lists)?;
    /// assert_eq!((lists.points(), lists.row(0).len()), (&[0][..], 2));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn within_lists<Q: Position>(
        &self,
        queries: &[Q],
        time: f32,
        radius: f32,
        lists: &mut NeighborCsr,
    ) -> Result<(), ListError> {
        let places: Vec<Vec3> = queries.iter().map(|query| query.relative(self.origin)).collect();
        let wrong = |place: &Vec3| !place.abs().cmple(Vec3::splat(MAX_POINT_COORDINATE as f32)).all();
        if let Some(query) = places.iter().position(wrong) {
            lists.offsets.clear();
            lists.points.clear();
            return Err(ListError::Query { query });
        }
        let params = PointParams { simd: self.simd, ..PointParams::default() };
        // Nothing else can be wrong with them but that they are too many.
        let mut asking = PointTree::build(&places, &params).map_err(|_| ListError::Query { query: places.len() })?;
        // The places are relative to this origin already.
        asking.origin = self.origin;
        asking.neighbor_lists(time, radius).among(self).run(lists)
    }
}
