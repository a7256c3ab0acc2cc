//! Leaves of moving points: blocks of sixteen in rows, with active intervals.

use super::lane_intervals::LaneIntervals;
use super::over_interval::{PathRows, all_lanes};
use super::view::{Target, rows, squared};
use crate::geometry::{KeyTime, TimeInterval};
use crate::point::leaf_order::moving_reference::MovingReference;
use crate::simd::{LANES, Lanes, MovingPointBlock, Simd, prefetch};
use glam::Vec3;

/// Sets the point of a lane.
#[inline(always)]
pub(in crate::point) fn set(block: &mut MovingPointBlock, lane: usize, reference: &MovingReference) {
    for axis in 0..3 {
        block.open[axis][lane] = reference.open[axis];
        block.close[axis][lane] = reference.close[axis];
    }
    block.id[lane] = reference.id;
}

/// The leaves of a tree, one block each.
#[derive(Clone)]
pub(in crate::point) struct MovingLeaves {
    pub(in crate::point) blocks: Vec<MovingPointBlock>,
    /// Active intervals of the lanes; empty if all are active throughout.
    pub(in crate::point) times: Vec<LaneIntervals>,
    /// Whole intervals of the points; empty if all points exist throughout the shutter.
    pub(in crate::point) active: Vec<LaneIntervals>,
}

impl MovingLeaves {
    /// Leaves with these blocks, whatever they hold; `timed` if not all lanes are active throughout, `has_active_intervals` if not
    /// all points exist throughout the shutter.
    pub(in crate::point) fn of(blocks: Vec<MovingPointBlock>, timed: bool, has_active_intervals: bool) -> MovingLeaves {
        let count = blocks.len();
        MovingLeaves {
            blocks,
            times: vec![LaneIntervals::NEVER; if timed { count } else { 0 }],
            active: vec![LaneIntervals::NEVER; if has_active_intervals { count } else { 0 }],
        }
    }

    /// All leaves, to be filled.
    pub(in crate::point) fn rows(&mut self) -> LeafRows<'_> {
        LeafRows { blocks: &mut self.blocks, times: &mut self.times, active: &mut self.active }
    }

    /// Bytes allocated.
    pub(in crate::point) fn bytes(&self) -> usize {
        self.blocks.capacity() * size_of::<MovingPointBlock>()
            + (self.times.capacity() + self.active.capacity()) * size_of::<LaneIntervals>()
    }

    /// Ids of a block's points.
    #[inline(always)]
    pub(in crate::point) fn ids(&self, block: usize) -> &Lanes<u32> {
        &self.blocks[block].id
    }

    /// Number of references.
    pub(in crate::point) fn references(&self) -> usize {
        self.blocks.iter().flat_map(|block| block.id).filter(|&id| id != u32::MAX).count()
    }

    /// Prefetches a block that will probably be tested soon.
    #[inline(always)]
    pub(in crate::point) fn prefetch(&self, block: usize) {
        if let Some(block) = self.blocks.get(block) {
            prefetch(block);
        }
    }

    /// Positions of the points of a block, whether they are active at this time or not.
    #[inline(always)]
    fn interpolated<S: Simd>(&self, s: S, at: KeyTime, target: &Target<S>, block: usize) -> [S::F; 3] {
        let MovingPointBlock { open, close, .. } = &self.blocks[block];
        let base = rows(s, if at.from_end { close } else { open });
        let ([ax, ay, az], [bx, by, bz]) = (rows(s, open), rows(s, close));
        [base[0] + (bx - ax) * target.step, base[1] + (by - ay) * target.step, base[2] + (bz - az) * target.step]
    }

    /// Positions of the points of a block at a time; the first coordinate is infinite if a point is not active then.
    #[inline(always)]
    pub(in crate::point) fn positions<S: Simd, const TIMED: bool>(
        &self,
        s: S,
        at: KeyTime,
        target: &Target<S>,
        block: usize,
    ) -> [S::F; 3] {
        let mut positions = self.interpolated(s, at, target, block);
        if TIMED {
            let active = self.times[block].active_at(s, target.time);
            positions[0] = s.select(active, positions[0], s.splat(f32::INFINITY));
        }
        positions
    }

    /// Whether a lane of a block is active at a time.
    pub(in crate::point) fn is_active(&self, block: usize, lane: usize, time: f32) -> bool {
        self.times.get(block).is_none_or(|times| times.is_active(lane, time))
    }

    /// The points that are active at a time, with their ids.
    pub(in crate::point) fn active_points(&self, at: KeyTime, time: f32) -> impl Iterator<Item = (u32, Vec3)> + '_ {
        all_lanes(0..self.blocks.len()).filter_map(move |(block, lane)| {
            let MovingPointBlock { open, close, id } = &self.blocks[block];
            let [open, close] = [open, close].map(|rows| Vec3::from_array(rows.map(|row| row[lane])));
            (self.is_active(block, lane, time) && id[lane] != u32::MAX).then(|| (id[lane], at.position(open, close)))
        })
    }

    /// Squared distances to the points of a block at a time; infinite if a point is not active then.
    #[inline(always)]
    pub(in crate::point) fn distances<S: Simd, const TIMED: bool>(
        &self,
        s: S,
        at: KeyTime,
        target: &Target<S>,
        block: usize,
    ) -> S::F {
        let [x, y, z] = self.interpolated(s, at, target, block);
        let distances = squared::<S>(x - target.point[0], y - target.point[1], z - target.point[2]);
        if !TIMED {
            return distances;
        }
        let active = self.times[block].active_at(s, target.time);
        s.select(active, distances, s.splat(f32::INFINITY))
    }

    /// The active interval of a lane of a block.
    pub(in crate::point) fn times(&self, block: usize, lane: usize) -> [f32; 2] {
        let times = &self.times[block];
        [times.begin[lane], times.end[lane]]
    }

    /// The points of a block between their keys.
    #[inline(always)]
    pub(in crate::point) fn paths(&self, block: usize) -> PathRows<f32> {
        let MovingPointBlock { open, close, id } = &self.blocks[block];
        PathRows::new(open, close, id, self.active.get(block))
    }
}

/// Some of the leaves of a tree, to be filled.
pub(in crate::point) struct LeafRows<'a> {
    blocks: &'a mut [MovingPointBlock],
    times: &'a mut [LaneIntervals],
    active: &'a mut [LaneIntervals],
}

impl<'a> LeafRows<'a> {
    /// Whether they have intervals of lanes or of points.
    pub(in crate::point) fn timed(&self) -> bool {
        !(self.times.is_empty() && self.active.is_empty())
    }

    /// The first `count` leaves and the rest.
    pub(in crate::point) fn split_at(self, count: usize) -> [LeafRows<'a>; 2] {
        let (blocks, more_blocks) = self.blocks.split_at_mut(count);
        let (times, more_times) = self.times.split_at_mut(count.min(self.times.len()));
        let (active, more_active) = self.active.split_at_mut(count.min(self.active.len()));
        [LeafRows { blocks, times, active }, LeafRows { blocks: more_blocks, times: more_times, active: more_active }]
    }

    /// Sets the point of a lane of a leaf.
    #[inline(always)]
    pub(in crate::point) fn set(&mut self, i: usize, lane: usize, reference: &MovingReference) {
        set(&mut self.blocks[i], lane, reference);
    }

    /// Sets the points of the first lanes of a leaf.
    #[inline(always)]
    pub(in crate::point) fn set_all(&mut self, i: usize, references: impl Iterator<Item = MovingReference>) {
        let block = &mut self.blocks[i];
        for (lane, reference) in references.enumerate().take(LANES) {
            set(block, lane, &reference);
        }
    }

    /// Makes a lane of a leaf absent, which has no interval either.
    #[inline(always)]
    pub(in crate::point) fn clear(&mut self, i: usize, lane: usize) {
        let MovingPointBlock { open, close, id } = &mut self.blocks[i];
        for row in open.iter_mut().chain(close) {
            row[lane] = f32::MAX;
        }
        id[lane] = u32::MAX;
    }

    /// Sets the active interval of a lane of a leaf, and the whole interval of its point.
    #[inline(always)]
    pub(in crate::point) fn set_times(&mut self, i: usize, lane: usize, times: [f32; 2], active: TimeInterval) {
        if let Some(of_lanes) = self.times.get_mut(i) {
            of_lanes.set(lane, times);
        }
        if let Some(of_points) = self.active.get_mut(i) {
            of_points.set(lane, [active.begin(), active.end_bound()]);
        }
    }

    /// Positions of the points of a leaf at both keys.
    #[inline(always)]
    pub(in crate::point) fn ends(&self, i: usize) -> ([Lanes<f32>; 3], [Lanes<f32>; 3]) {
        (self.blocks[i].open, self.blocks[i].close)
    }
}
