//! The interface between trees and searches over a range of times.

use crate::geometry::{KeyTime, TimeInterval};
use crate::point::leaf_order::moving_reference::SegmentSlice;
use crate::simd::{LANES, Lanes};
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
        [self.open, self.close].map(|p| p.map(|x| x as f32))
    }

    /// The position at a time as queries compute it, of a point that is kept in f32.
    pub(in crate::point) fn position(&self, at: KeyTime) -> Vec3 {
        let [open, close] = self.ends();
        at.position(open.into(), close.into())
    }
}

/// Trajectories of sixteen points between two keys, in f32, in rows; absent lanes have the id `u32::MAX`.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(in crate::point) struct PathRows {
    pub(in crate::point) open: [Lanes<f32>; 3],
    pub(in crate::point) close: [Lanes<f32>; 3],
    /// Whole intervals, with the end bound.
    pub(in crate::point) begin: Lanes<f32>,
    pub(in crate::point) end: Lanes<f32>,
    pub(in crate::point) id: Lanes<u32>,
}

impl PathRows {
    /// Points that exist throughout the shutter.
    #[inline(always)]
    pub(in crate::point) fn always_active(
        open: &[Lanes<f32>; 3],
        close: &[Lanes<f32>; 3],
        id: &Lanes<u32>,
    ) -> PathRows {
        let active = TimeInterval::FULL;
        let (begin, end) = ([active.begin(); LANES], [active.end_bound(); LANES]);
        PathRows { open: *open, close: *close, begin, end, id: *id }
    }

    /// One of the points.
    #[inline(always)]
    pub(in crate::point) fn point_path(&self, lane: usize) -> Option<PointPath> {
        let active = TimeInterval::half_open(self.begin[lane], self.end[lane])?;
        let [open, close] = [self.open, self.close].map(|rows| rows.map(|row| f64::from(row[lane])));
        (self.id[lane] != u32::MAX).then_some(PointPath { id: self.id[lane], open, close, active })
    }
}

/// A tree whose points are kept in f32, sixteen in a block.
pub(in crate::point) trait BlockTree: BoxTree {
    /// The points of a block.
    fn rows(&self, block: usize) -> PathRows;
    /// Whether some points do not exist throughout the shutter.
    fn has_active_intervals(&self) -> bool;
}

/// A tree whose boxes can be evaluated over a range of times.
pub(in crate::point) trait BoxTree {
    /// The time slice that the tree covers.
    fn slice(&self) -> SegmentSlice;
    /// Level and number of the root.
    fn root_node(&self) -> (usize, usize);
    /// The node, or block on level 0, of lane 0, and the stride from lane to lane.
    fn children(&self, level: usize, node: usize) -> (usize, usize);
    /// Begin and end of the active interval of each lane; absent lanes have an infinite begin.
    fn times(&self, node: usize) -> [Lanes<f32>; 2];
    /// Lower and upper faces, each lane at a phase of its own.
    fn faces(&self, node: usize, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2];
    /// Whether a lane of a block is active at a time.
    fn is_active(&self, block: usize, lane: usize, time: f32) -> bool;
    /// A point of a block.
    fn point_path(&self, block: usize, lane: usize) -> Option<PointPath>;
    /// The position of a point at a time, as queries compute it.
    fn position(&self, point: &PointPath, time: f32) -> DVec3 {
        point.position(KeyTime::new(time, self.slice().keys)).as_dvec3()
    }
    /// The phase of a time between the keys.
    fn phase(&self, time: f32) -> f64 {
        self.slice().phase(time).into()
    }
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
