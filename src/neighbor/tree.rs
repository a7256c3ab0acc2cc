//! The tree that callers build and ask.

use super::PointError;
use super::order::Item;
use super::query::NeighborQuery;
use super::static_tree::StaticTree;
use crate::SimdLevel;
use crate::motion::{PointSet, Position};
use glam::DVec3;

/// The largest magnitude of a coordinate, relative to the tree's origin: squared distances between
/// such points fit into f32.
pub const MAX_POINT_COORDINATE: f64 = 1e18;

/// How a point tree is built.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct PointParams {
    /// Instruction set of the queries; answers do not depend on it. Default: the widest of this CPU.
    pub simd: SimdLevel,
}

/// Points in a tree that answers neighbour queries at any time of the shutter.
#[derive(Clone)]
pub struct PointTree {
    pub(super) origin: DVec3,
    pub(super) simd: SimdLevel,
    pub(super) still: Option<StaticTree>,
    len: usize,
}

impl PointTree {
    /// Builds the tree of a set of points.
    pub fn build<P: PointSet + ?Sized>(points: &P, params: &PointParams) -> Result<PointTree, PointError> {
        let len = points.len();
        let items = (0..len)
            .map(|i| Item { at: points.position(i, 0).as_vec3().to_array(), index: i as u32 })
            .collect();
        let still = Some(StaticTree::build(items, |i| points.id(i as usize)));
        Ok(PointTree { origin: DVec3::ZERO, simd: params.simd, still, len })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// A query at `point` and `time`, to be refined and run.
    #[inline(always)]
    pub fn query<Q: Position>(&self, point: Q, time: f32) -> NeighborQuery<'_> {
        NeighborQuery::new(self, point.relative(self.origin), time)
    }
    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.still.as_ref().map_or(0, StaticTree::bytes)
    }
}
