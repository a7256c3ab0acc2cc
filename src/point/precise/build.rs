//! Building a tree over f64 points.

use super::linear_box::{FULL, LinearBox, Node, NodeRows};
use super::order::order;
use super::rounded_order::{OfPoint, Points};
use super::tree::{Block, NO_POINTS, PreciseTree, between};
use crate::geometry::TimeInterval;
use crate::point::build::source::Source;
use crate::point::layout::moving_leaf::LaneIntervals;
use crate::point::leaf_order::moving_reference::TimeSlice;
use crate::point::leaf_order::order::ORDERING;
use crate::progress::Progress;
use crate::simd::{LANES, huge_vec_of};
use glam::DVec3;

/// Leaves between two reports of progress. Not fitted: they take a few hundred microseconds.
const REPORTED: usize = 256;

impl PreciseTree {
    /// The tree of a time slice over some points of a set. Unless it `moves`, all points must be static
    /// and exist throughout the shutter.
    pub(in crate::point) fn build(
        source: &Source,
        slice: TimeSlice,
        mut numbers: Vec<u32>,
        moves: bool,
        progress: &Progress,
    ) -> PreciseTree {
        let later = (slice.segment + 1).min(slice.keys - 1);
        let keys = |point: usize| [source.exact(point, slice.segment), source.exact(point, later)];
        let middle = 0.5 * (slice.phases[0] + slice.phases[1]);
        let persist = source.all_persist();
        if !persist {
            numbers.retain(|&point| source.active(point as usize).intersect(slice.interval).is_some());
        }
        let shape = PreciseTree::shape(numbers.len(), moves);
        let at_rest = |point: u32| source.exact(point as usize, slice.segment);
        let in_the_middle = |point: u32| between(keys(point as usize), middle);
        let at: OfPoint<'_> = if moves { &in_the_middle } else { &at_rest };
        let displacement = |point: u32| {
            let [begin, end] = slice.phases.map(|phase| between(keys(point as usize), phase));
            end - begin
        };
        let points = Points { at, displacement: moves.then_some(&displacement as OfPoint<'_>) };
        order(&mut numbers, shape.leaf(), points, &progress.subtask(ORDERING));
        let leaves = numbers.len().div_ceil(shape.leaf());
        let blocks = leaves * shape.leaf_blocks;
        let active = |number: &u32| source.active(*number as usize);
        let has_active_intervals = !persist && numbers.iter().any(|number| active(number) != TimeInterval::FULL);
        let timed =
            !persist && numbers.iter().any(|number| active(number).intersect(slice.interval) != Some(slice.interval));
        let mut tree = PreciseTree {
            slice,
            shape,
            nodes: huge_vec_of(Node::NONE, shape.nodes()),
            slopes: huge_vec_of(Node::STATIC, if moves { shape.nodes() } else { 0 }),
            blocks: huge_vec_of(Block::EMPTY, blocks),
            ends: huge_vec_of(NO_POINTS, if moves { blocks } else { 0 }),
            node_times: Vec::new(),
            block_times: vec![LaneIntervals::NEVER; if timed { blocks } else { 0 }],
            active: vec![LaneIntervals::NEVER; if has_active_intervals { blocks } else { 0 }],
            references: numbers.len(),
        };
        let mut boxes_below = Vec::with_capacity(leaves);
        let progress = progress.in_units(leaves);
        for (leaf, numbers) in numbers.chunks(shape.leaf()).enumerate() {
            if leaf.is_multiple_of(REPORTED) {
                if progress.cancelled() {
                    break;
                }
                progress.finished(REPORTED as f64);
            }
            if !moves {
                let blocks = &mut tree.blocks[leaf * shape.leaf_blocks..][..shape.leaf_blocks];
                boxes_below.push(fill_static_leaf(source, slice.segment, numbers, blocks));
                continue;
            }
            let mut bounds = LinearBox::NONE;
            for (i, number) in numbers.iter().enumerate() {
                let (block, lane) = (leaf * shape.leaf_blocks + i / LANES, i % LANES);
                let point = *number as usize;
                let (keys, active) = (keys(point), active(number));
                let [begin, end] = keys.map(|p| p.to_array());
                let interval = active.intersect(slice.interval).unwrap_or(slice.interval);
                for axis in 0..3 {
                    tree.blocks[block].begin.0[axis][lane] = begin[axis];
                    tree.ends[block].0[axis][lane] = end[axis];
                }
                tree.blocks[block].id[lane] = source.id(point);
                let set = |to: &mut [LaneIntervals], interval: TimeInterval| {
                    if let Some(to) = to.get_mut(block) {
                        (to.begin[lane], to.end[lane]) = (interval.begin(), interval.end_bound());
                    }
                };
                set(&mut tree.block_times, interval);
                set(&mut tree.active, active);
                let ends = slice.phases.map(|phase| between(keys, phase));
                bounds = bounds.union(&LinearBox::of_point(ends, keys, [interval.begin(), interval.end_bound()]));
            }
            boxes_below.push(bounds);
        }
        drop(numbers);
        for level in 0..shape.levels {
            let mut above = Vec::with_capacity(boxes_below.len().div_ceil(LANES));
            // Even a tree without points has a root.
            for i in 0..shape.begin[level + 1] - shape.begin[level] {
                let children =
                    &boxes_below[(i * LANES).min(boxes_below.len())..((i + 1) * LANES).min(boxes_below.len())];
                let (NodeRows { node, slopes, times }, bounds) = Node::over(children, moves, FULL);
                let number = shape.begin[level] + i;
                tree.nodes[number] = node;
                if moves {
                    tree.slopes[number] = slopes;
                }
                if timed {
                    tree.node_times.push(times);
                }
                above.push(bounds);
            }
            boxes_below = above;
        }
        tree
    }
}

/// Writes points that are static and exist throughout the shutter to the blocks of a leaf; returns the box around them.
fn fill_static_leaf(source: &Source, key: usize, numbers: &[u32], blocks: &mut [Block]) -> LinearBox {
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (block, numbers) in blocks.iter_mut().zip(numbers.chunks(LANES)) {
        let [x, y, z] = &mut block.begin.0;
        for (lane, &number) in numbers.iter().enumerate() {
            let at = source.exact(number as usize, key);
            (x[lane], y[lane], z[lane]) = (at.x, at.y, at.z);
            block.id[lane] = source.id(number as usize);
            (lo, hi) = (lo.min(at), hi.max(at));
        }
    }
    LinearBox::at_rest(lo, hi)
}
