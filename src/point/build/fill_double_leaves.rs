//! Writing f64 points into the leaves of a tree, in the order that was found for them.

use super::source::Source;
use crate::geometry::TimeInterval;
use crate::parallel;
use crate::point::layout::double_box::DoubleBox;
use crate::point::layout::double_tree::{DoubleBlock, DoubleTree, between};
use crate::point::layout::lane_intervals::LaneIntervals;
use crate::point::layout::view::DoubleRows;
use crate::point::leaf_order::rounded_order::PointsToOrder;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::point::leaf_order::widest_axis::include;
use crate::progress::Progress;
use crate::simd::LANES;
use core::iter;
use glam::DVec3;

/// Leaves that one thread fills at a time.
const SHARE: usize = 256;

/// Points whose positions are on their way from memory.
const AHEAD: usize = 16;

/// The points of a set during a time slice.
#[derive(Clone, Copy)]
pub(in crate::point) struct DoublePoints<'a> {
    pub(in crate::point) source: &'a Source,
    pub(in crate::point) slice: SegmentSlice,
}

impl DoublePoints<'_> {
    /// Positions of a point at the keys of the segment.
    #[inline(always)]
    pub(in crate::point) fn keys(&self, point: u32) -> [DVec3; 2] {
        let [open, close] = self.slice.ends();
        [self.source.double(point as usize, open), self.source.double(point as usize, close)]
    }

    /// The position of a point at the earlier key.
    #[inline(always)]
    pub(in crate::point) fn at_rest(&self, point: u32) -> DVec3 {
        self.source.double(point as usize, self.slice.segment)
    }

    /// Positions of a point at the begin and at the end of the slice.
    #[inline(always)]
    pub(in crate::point) fn ends(&self, point: u32) -> [DVec3; 2] {
        let (keys, [begin, end]) = (self.keys(point), self.slice.phases);
        [between(keys, begin), between(keys, end)]
    }

    /// When a point exists.
    #[inline(always)]
    pub(in crate::point) fn active(&self, point: u32) -> TimeInterval {
        self.source.active(point as usize)
    }

    /// Whether a point exists at some time of the slice.
    pub(in crate::point) fn exists(&self, point: u32) -> bool {
        self.active(point).intersect(self.slice.interval).is_some()
    }

    /// Prefetches the positions of a point; a hint.
    #[inline(always)]
    pub(in crate::point) fn prefetch(&self, point: u32) {
        self.source.prefetch_double(point as usize, self.slice.segment);
    }
}

/// They are ordered by where they are in the middle of the slice.
impl PointsToOrder for DoublePoints<'_> {
    #[inline(always)]
    fn at(&self, point: u32) -> DVec3 {
        let [begin, end] = self.slice.phases;
        // Of a single key both give the same.
        if self.slice.keys == 1 { self.at_rest(point) } else { between(self.keys(point), 0.5 * (begin + end)) }
    }
    fn displacement(&self, point: u32) -> DVec3 {
        let [begin, end] = self.ends(point);
        end - begin
    }
}

/// Leaves to be filled. Rows that the tree does not have are empty.
struct LeafRowsMut<'a> {
    numbers: &'a [u32],
    blocks: &'a mut [DoubleBlock],
    ends: &'a mut [DoubleRows],
    block_times: &'a mut [LaneIntervals],
    active: &'a mut [LaneIntervals],
}

impl DoubleTree {
    /// Writes points, in order, into the leaves, which are empty; returns the boxes around each leaf.
    ///
    /// Once `progress` is cancelled, the other leaves are left empty, without boxes.
    pub(in crate::point) fn fill_leaves(
        &mut self,
        points: DoublePoints<'_>,
        numbers: &[u32],
        progress: &Progress,
    ) -> Vec<DoubleBox> {
        let (moves, leaf_blocks) = (self.moves(), self.shape.leaf_blocks);
        let leaf = leaf_blocks * LANES;
        let mut ends = sections(&mut self.ends, leaf_blocks);
        let mut block_times = sections(&mut self.block_times, leaf_blocks);
        let mut active = sections(&mut self.active, leaf_blocks);
        let shares = numbers.chunks(leaf * SHARE).zip(self.blocks.chunks_mut(leaf_blocks * SHARE));
        let mut shares: Vec<LeafRowsMut<'_>> = shares
            .map(|(numbers, blocks)| {
                let (ends, block_times) = (ends.next().unwrap_or_default(), block_times.next().unwrap_or_default());
                LeafRowsMut { numbers, blocks, ends, block_times, active: active.next().unwrap_or_default() }
            })
            .collect();
        let progress = progress.in_units(shares.len());
        let boxes = parallel::each(&mut shares, |leaves| {
            if progress.cancelled() {
                return Vec::new();
            }
            let boxes = if moves { leaves.fill_moving(points) } else { leaves.fill_static(points, leaf_blocks) };
            progress.finished(1.0);
            boxes
        });
        let mut all = Vec::with_capacity(numbers.len().div_ceil(leaf));
        boxes.into_iter().for_each(|boxes| all.extend(boxes));
        all
    }
}

/// The rows of each share; no more once there are none.
fn sections<T>(rows: &mut [T], leaf_blocks: usize) -> impl Iterator<Item = &mut [T]> {
    rows.chunks_mut(leaf_blocks * SHARE)
}

/// The numbers of points, each with that of one that will be its turn soon.
fn with_next(numbers: &[u32]) -> impl Iterator<Item = (u32, Option<u32>)> {
    let later = numbers.iter().skip(AHEAD).map(|&number| Some(number));
    numbers.iter().copied().zip(later.chain(iter::repeat(None)))
}

impl LeafRowsMut<'_> {
    /// Fills leaves with points that do not move and exist throughout the shutter.
    fn fill_static(&mut self, points: DoublePoints<'_>, leaf_blocks: usize) -> Vec<DoubleBox> {
        let mut boxes = Vec::with_capacity(self.blocks.len() / leaf_blocks);
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let mut next = self.numbers.chunks(LANES).skip(1);
        for (i, (numbers, block)) in self.numbers.chunks(LANES).zip(self.blocks.iter_mut()).enumerate() {
            next.next().into_iter().flatten().for_each(|&next| points.prefetch(next));
            let DoubleBlock { begin: DoubleRows([x, y, z]), id } = block;
            let lanes = x.iter_mut().zip(y).zip(z).zip(id);
            for ((((x, y), z), id), &number) in lanes.zip(numbers) {
                let at = points.at_rest(number).to_array();
                ([*x, *y, *z], *id) = (at, points.source.id(number as usize));
                include(&mut lo, &mut hi, at);
            }
            // A leaf ends here, or there are no more points.
            if (i + 1) % leaf_blocks == 0 || numbers.len() < LANES || (i + 1) * LANES == self.numbers.len() {
                boxes.push(DoubleBox::at_rest(DVec3::from_array(lo), DVec3::from_array(hi)));
                (lo, hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
            }
        }
        boxes
    }

    /// Fills leaves, of one block each.
    fn fill_moving(&mut self, points: DoublePoints<'_>) -> Vec<DoubleBox> {
        let mut boxes = vec![DoubleBox::NONE; self.blocks.len()];
        for (i, (number, next)) in with_next(self.numbers).enumerate() {
            next.into_iter().for_each(|next| points.prefetch(next));
            let (block, lane) = (i / LANES, i % LANES);
            let (keys, active) = (points.keys(number), points.active(number));
            let interval = active.intersect(points.slice.interval).unwrap_or(points.slice.interval);
            self.blocks[block].set(lane, keys[0], points.source.id(number as usize));
            for (row, x) in self.ends[block].0.iter_mut().zip(keys[1].to_array()) {
                row[lane] = x;
            }
            let set = |rows: &mut [LaneIntervals], interval: TimeInterval| {
                if let Some(row) = rows.get_mut(block) {
                    row.set(lane, [interval.begin(), interval.end_bound()]);
                }
            };
            set(self.block_times, interval);
            set(self.active, active);
            let times = [interval.begin(), interval.end_bound()];
            boxes[block] = boxes[block].union(&DoubleBox::of_point(points.ends(number), keys, times));
        }
        boxes
    }
}
