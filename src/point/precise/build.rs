//! Building a tree over f64 points.

use super::linear_box::{FULL, LinearBox, Node, NodeRows};
use super::order::{Displacement, Item, order};
use super::tree::{Block, PreciseTree, Rows, between};
use crate::geometry::TimeInterval;
use crate::point::build::source::Source;
use crate::point::layout::moving_leaf::LaneIntervals;
use crate::point::leaf_order::moving_reference::TimeSlice;
use crate::point::leaf_order::order::ORDERING;
use crate::progress::Progress;
use crate::simd::{LANES, huge_vec_of};

impl PreciseTree {
    /// The tree of a time slice over some points of a set. Unless it `moves`, all points must be static
    /// and exist throughout the shutter.
    pub(in crate::point) fn build(
        source: &Source,
        slice: TimeSlice,
        points: impl Iterator<Item = usize>,
        moves: bool,
        progress: &Progress,
    ) -> PreciseTree {
        let later = (slice.segment + 1).min(slice.keys - 1);
        let keys = |point: usize| [source.exact(point, slice.segment), source.exact(point, later)];
        let middle = 0.5 * (slice.phases[0] + slice.phases[1]);
        let item = |point: usize| {
            source.active(point).intersect(slice.interval)?;
            Some(Item { at: between(keys(point), middle), point: point as u32 })
        };
        let mut items: Vec<Item> = points.filter_map(item).collect();
        let shape = PreciseTree::shape(items.len(), moves);
        let displacement = |point: u32| {
            let [begin, end] = slice.phases.map(|phase| between(keys(point as usize), phase));
            end - begin
        };
        let motion = moves.then_some(&displacement as Displacement<'_>);
        order(&mut items, shape.leaf(), motion, &progress.subtask(ORDERING));
        let leaves = items.len().div_ceil(shape.leaf());
        let blocks = leaves * shape.leaf_blocks;
        let active = |item: &Item| source.active(item.point as usize);
        let has_active_intervals = items.iter().any(|item| active(item) != TimeInterval::FULL);
        let timed = items.iter().any(|item| active(item).intersect(slice.interval) != Some(slice.interval));
        let mut tree = PreciseTree {
            slice,
            shape,
            nodes: huge_vec_of(Node::NONE, shape.nodes()),
            slopes: huge_vec_of(Node::STATIC, if moves { shape.nodes() } else { 0 }),
            blocks: huge_vec_of(Block::EMPTY, blocks),
            ends: huge_vec_of(Rows::ABSENT, if moves { blocks } else { 0 }),
            node_times: Vec::new(),
            block_times: vec![LaneIntervals::NEVER; if timed { blocks } else { 0 }],
            active: vec![LaneIntervals::NEVER; if has_active_intervals { blocks } else { 0 }],
            references: items.len(),
        };
        let mut boxes_below = Vec::with_capacity(leaves);
        for (leaf, items) in items.chunks(shape.leaf()).enumerate() {
            let mut bounds = LinearBox::NONE;
            for (i, item) in items.iter().enumerate() {
                let (block, lane) = (leaf * shape.leaf_blocks + i / LANES, i % LANES);
                let point = item.point as usize;
                let (keys, active) = (keys(point), active(item));
                let [begin, end] = keys.map(|p| p.to_array());
                let interval = active.intersect(slice.interval).unwrap_or(slice.interval);
                for axis in 0..3 {
                    tree.blocks[block].begin.0[axis][lane] = begin[axis];
                    if moves {
                        tree.ends[block].0[axis][lane] = end[axis];
                    }
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
        drop(items);
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
        progress.finished(1.0 - ORDERING);
        tree
    }
}
