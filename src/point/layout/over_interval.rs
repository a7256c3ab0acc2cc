//! The interface between trees and searches over a range of times.

use super::lane_intervals::LaneIntervals;
use super::shape::Shape;
use super::slice_tree::SliceTree;
use crate::geometry::{KeyTime, TimeInterval};
use crate::parallel;
use crate::simd::{LANES, Lanes, Mask};
use core::ops::Range;
use glam::{DVec3, Vec3};

/// The trajectory of a point between two keys, for searches over a range of times.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct PointPath {
    pub(in crate::point) id: u32,
    pub(in crate::point) open: [f64; 3],
    pub(in crate::point) close: [f64; 3],
    /// The whole interval of the point, not its intersection with a time slice.
    pub(in crate::point) active: TimeInterval,
}

impl PointPath {
    /// Positions at both keys, of a point that is kept in f32.
    pub(in crate::point) fn ends(&self) -> [[f32; 3]; 2] {
        let ([x, y, z], [u, v, w]) = (self.open, self.close);
        [[x as f32, y as f32, z as f32], [u as f32, v as f32, w as f32]]
    }

    /// The position at a time as queries compute it, of a point that is kept in f32.
    pub(in crate::point) fn position(&self, at: KeyTime) -> Vec3 {
        let [open, close] = self.ends();
        at.position(open.into(), close.into())
    }
}

/// Trajectories of sixteen points between two keys, in rows; absent lanes have the id `u32::MAX`.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(in crate::point) struct PathRows<C> {
    pub(in crate::point) open: [Lanes<C>; 3],
    pub(in crate::point) close: [Lanes<C>; 3],
    /// Whole intervals, with the end bound.
    pub(in crate::point) begin: Lanes<f32>,
    pub(in crate::point) end: Lanes<f32>,
    pub(in crate::point) id: Lanes<u32>,
}

impl<C: Copy + Into<f64>> PathRows<C> {
    /// Points with these active intervals, or throughout the shutter.
    #[inline(always)]
    pub(in crate::point) fn new(
        open: &[Lanes<C>; 3],
        close: &[Lanes<C>; 3],
        id: &Lanes<u32>,
        active: Option<&LaneIntervals>,
    ) -> PathRows<C> {
        let (begin, end) = match active {
            Some(active) => (active.begin, active.end),
            None => ([TimeInterval::FULL.begin(); LANES], [TimeInterval::FULL.end_bound(); LANES]),
        };
        PathRows { open: *open, close: *close, begin, end, id: *id }
    }

    /// The largest magnitude of a coordinate at either key.
    pub(in crate::point) fn magnitude(&self) -> f64 {
        let coordinates = self.open.iter().chain(&self.close).flat_map(|row| row.iter().zip(self.id));
        coordinates.filter(|(_, id)| *id != u32::MAX).fold(0.0, |most, (&x, _)| greater(most, x.into().abs()))
    }

    /// The points, without the absent ones.
    pub(in crate::point) fn point_paths(&self) -> impl Iterator<Item = PointPath> {
        (0..LANES).filter_map(|lane| self.point_path(lane))
    }

    /// The most by which a displacement between the keys differs from another one along an axis.
    pub(in crate::point) fn motion(&self, displacement: impl Fn(C, C) -> f64, from: [f64; 3]) -> f64 {
        let mut most = 0.0;
        for ((open, close), from) in self.open.iter().zip(&self.close).zip(from) {
            for lane in (0..LANES).filter(|&lane| self.id[lane] != u32::MAX) {
                most = greater(most, (displacement(open[lane], close[lane]) - from).abs());
            }
        }
        most
    }

    /// One of the points.
    #[inline(always)]
    pub(in crate::point) fn point_path(&self, lane: usize) -> Option<PointPath> {
        let active = TimeInterval::half_open(self.begin[lane], self.end[lane])?;
        let PathRows { open: [x, y, z], close: [u, v, w], .. } = self;
        let open = [x[lane].into(), y[lane].into(), z[lane].into()];
        let close = [u[lane].into(), v[lane].into(), w[lane].into()];
        (self.id[lane] != u32::MAX).then_some(PointPath { id: self.id[lane], open, close, active })
    }
}

/// A tree whose points are in blocks of sixteen.
pub(in crate::point) trait BlockTree: BoxTree + Sync {
    /// The numbers that positions are kept in.
    type Coordinate: Copy + Into<f64>;
    /// The points of a block.
    fn rows(&self, block: usize) -> PathRows<Self::Coordinate>;
    /// Whether some points do not exist throughout the shutter.
    fn has_active_intervals(&self) -> bool;
    /// Whether some references are not active throughout the time slice.
    fn timed(&self) -> bool;
    /// Whether the interval of any point begins at a time.
    fn begins_at(&self, time: f32) -> bool;
    /// The place at a phase that positions below a node are best measured from; of no account where they are in f32.
    #[inline(always)]
    fn center(&self, _node: usize, _phase: f64) -> [f64; 3] {
        [0.0; 3]
    }
    /// The largest magnitude of a coordinate at either key of the segment. (Boxes do not tell: those of a time slice, and of points
    /// that exist for a while, bound nothing at the keys.)
    fn magnitude(&self) -> f64 {
        let of_block = |block: usize| self.rows(block).magnitude();
        let parts = parallel::chunks(self.block_count(), |blocks| blocks.map(of_block).fold(0.0, greater));
        parts.into_iter().fold(0.0, greater)
    }
    /// The ids of the points that exist at some time between two, both ends included. (A point does not exist at its end bound.)
    fn ids_during(&self, [first, last]: [f32; 2]) -> Vec<u32> {
        let of_block = |block: usize| {
            let rows = self.rows(block);
            let exists =
                move |&lane: &usize| rows.id[lane] != u32::MAX && rows.begin[lane] <= last && first < rows.end[lane];
            (0..LANES).filter(exists).map(move |lane| rows.id[lane])
        };
        parallel::chunks(self.block_count(), |blocks| blocks.flat_map(of_block).collect::<Vec<u32>>()).concat()
    }
    /// The least and the greatest displacement of a point between the keys, along each axis, infinite without a point; of no
    /// account where positions are in f32.
    fn displacements(&self) -> [[f64; 3]; 2] {
        [[0.0; 3]; 2]
    }
}

/// A tree whose boxes can be evaluated over a range of times.
pub(in crate::point) trait BoxTree: SliceTree {
    /// How many nodes its levels have.
    fn shape(&self) -> &Shape;
    /// Begin and end of the active interval of each lane; absent lanes have an infinite begin.
    fn times(&self, node: usize) -> [Lanes<f32>; 2];
    /// Lower and upper faces, each lane at a phase of its own.
    fn faces(&self, node: usize, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2];
    /// Whether a lane of a block is active at a time.
    fn is_active(&self, block: usize, lane: usize, time: f32) -> bool;
    /// The position of a point at a time, as queries compute it.
    fn position(&self, point: &PointPath, time: f32) -> DVec3 {
        point.position(KeyTime::new(time, self.slice().keys)).as_dvec3()
    }
    /// The phase of a time between the keys.
    fn phase(&self, time: f32) -> f64 {
        self.slice().phase(time).into()
    }
}

/// The times of a node whose lanes are active throughout, given their lowest faces, which are infinite where there is none.
#[inline(always)]
pub(in crate::point) fn throughout(lowest: &Lanes<f32>) -> [Lanes<f32>; 2] {
    let mut begins = [0.0; LANES];
    for (begin, &x) in begins.iter_mut().zip(lowest) {
        *begin = if x < f32::INFINITY { 0.0 } else { f32::INFINITY };
    }
    [begins, [1.0; LANES]]
}

/// Lanes of a node that are active at some time of a range, both ends included.
#[inline(always)]
pub(in crate::point) fn active_lanes<T: BoxTree + ?Sized>(tree: &T, node: usize, [first, last]: [f32; 2]) -> Mask {
    let [begin, end] = tree.times(node);
    (0..LANES).fold(0, |mask, lane| mask | Mask::from(begin[lane] <= last && first <= end[lane]) << lane)
}

/// The bottom nodes in the order of the tree, without those below lanes that are active at no time of a range.
pub(in crate::point) fn bottom_nodes<T: BoxTree + ?Sized>(tree: &T, times: [f32; 2]) -> Vec<usize> {
    let (top, root) = tree.shape().root();
    let mut nodes = vec![root];
    // One level after the other: each node is replaced by its children.
    for level in (1..=top).rev() {
        let children = |&node: &usize| {
            let (first, active) = (tree.shape().children(level, node).0, active_lanes(tree, node, times));
            (0..LANES).filter(move |lane| active >> lane & 1 != 0).map(move |lane| first + lane)
        };
        nodes = nodes.iter().flat_map(children).collect();
    }
    nodes
}

/// All lanes of some blocks.
#[inline(always)]
pub(in crate::point) fn all_lanes(blocks: Range<usize>) -> impl Iterator<Item = (usize, usize)> {
    blocks.flat_map(|block| (0..LANES).map(move |lane| (block, lane)))
}

/// The greater; one instruction, which takes no care of NaN.
#[inline(always)]
pub(in crate::point) fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The lesser, likewise.
#[inline(always)]
pub(in crate::point) fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}
