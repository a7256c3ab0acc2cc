//! Queries as callers see them: where, when, how far, which points, and then what to do with them.

use super::search::k_nearest::{Candidates, KNearest};
use super::search::nearest::Best;
use super::search::radius::{Sink, within};
use super::search::sort::nearest_in_order;
use super::search::walk::walk;
use super::search::{Keep, KeepAll, KeepIf, NeighborWork, Observe, kept};
use super::tree::PointTree;
use super::view::View;
use super::{Neighbor, MAX_POINT_COORDINATE};
use crate::simd::{Kernel, Mask, Simd, dispatch};
use core::ops::ControlFlow;
use glam::Vec3;

/// Memory for results and candidates, to be reused from query to query.
#[derive(Clone, Debug, Default)]
pub struct NeighborBuffer {
    candidates: Candidates,
    found: Vec<Neighbor>,
}

/// A query in preparation.
#[derive(Clone, Copy)]
pub struct NeighborQuery<'a, K = KeepAll> {
    tree: &'a PointTree,
    point: Vec3,
    time: f32,
    bound: f32,
    shrink: f32,
    keep: K,
}

impl<'a> NeighborQuery<'a> {
    #[inline(always)]
    pub(super) fn new(tree: &'a PointTree, point: Vec3, time: f32) -> Self {
        let most = Vec3::splat(MAX_POINT_COORDINATE as f32);
        // Also false for NaN.
        let valid = point.abs().cmple(most).all() && (0.0..=1.0).contains(&time);
        NeighborQuery { tree, point, time, bound: if valid { f32::MAX } else { -1.0 }, shrink: 1.0, keep: KeepAll }
    }
}

impl<'a, K: Keep> NeighborQuery<'a, K> {
    /// r
    pub fn radius(self, radius: f32) -> Self {
        let bound = if radius >= 0.0 { (radius * radius).min(self.bound) } else { -1.0 };
        NeighborQuery { bound, ..self }
    }
    /// nearest
    pub fn nearest(self) -> Option<Neighbor> {
        if !(self.bound >= 0.0) {
            return None;
        }
        dispatch(self.tree.simd, Nearest(&self)).map(|(id, distance_squared)| Neighbor { id, distance_squared })
    }
    /// k
    pub fn nearest_n_into(self, k: usize, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        buffer.found.clear();
        if self.bound >= 0.0 && k > 0 {
            dispatch(self.tree.simd, NearestN { query: &self, k, buffer });
        }
        &buffer.found
    }
    /// r
    pub fn collect_into(self, buffer: &mut NeighborBuffer) -> &[Neighbor] {
        buffer.found.clear();
        if self.bound >= 0.0 {
            dispatch(self.tree.simd, Collecting { query: &self, buffer });
        }
        &buffer.found
    }
}

struct Nearest<'q, 'a, K>(&'q NeighborQuery<'a, K>);

impl<K: Keep> Kernel for Nearest<'_, '_, K> {
    type Output = Option<(u32, f32)>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<(u32, f32)> {
        let q = self.0;
        let mut none = ();
        let mut best = Best::within(s, q.bound, q.shrink, &q.keep, &mut none);
        if let Some(still) = &q.tree.still {
            walk(s, &still, &still.target(s, q.point), &mut best, &mut ());
        }
        best.finish(s)
    }
}

struct NearestN<'q, 'a, 'b, K> {
    query: &'q NeighborQuery<'a, K>,
    k: usize,
    buffer: &'b mut NeighborBuffer,
}

impl<K: Keep> Kernel for NearestN<'_, '_, '_, K> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let q = self.query;
        let buffer = self.buffer;
        let mut none = ();
        let mut search = KNearest::within(self.k, q.bound, q.shrink, &mut buffer.candidates, &q.keep, &mut none);
        if let Some(still) = &q.tree.still {
            walk(s, &still, &still.target(s, q.point), &mut search, &mut ());
        }
        let c = &mut buffer.candidates;
        c.reserve(0);
        nearest_in_order(s, self.k, c.count, &mut c.distances, &c.ids, &mut buffer.found, &mut c.packed);
    }
}

struct Collecting<'q, 'a, 'b, K> {
    query: &'q NeighborQuery<'a, K>,
    buffer: &'b mut NeighborBuffer,
}

struct Gather<'a, K> {
    candidates: &'a mut Candidates,
    keep: &'a K,
}

impl<S: Simd, K: Keep> Sink<S> for Gather<'_, K> {
    #[inline(always)]
    fn take<V: View>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let ids = view.ids(block);
        self.candidates.reserve(0);
        self.candidates.push(s, distance, s.load_u(ids), kept(self.keep, ids, hits));
        ControlFlow::Continue(())
    }
}

impl<K: Keep> Kernel for Collecting<'_, '_, '_, K> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let q = self.query;
        let buffer = self.buffer;
        buffer.candidates.count = 0;
        let mut sink = Gather { candidates: &mut buffer.candidates, keep: &q.keep };
        if let Some(still) = &q.tree.still {
            let _ = within(s, &still, &still.target(s, q.point), q.bound, &mut sink, &mut ());
        }
        let c = &buffer.candidates;
        let pairs = c.ids.iter().zip(&c.distances).take(c.count);
        buffer.found.extend(pairs.map(|(&id, &distance_squared)| Neighbor { id, distance_squared }));
    }
}
