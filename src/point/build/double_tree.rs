//! Building a tree over f64 points.

use super::fill_double_leaves::DoublePoints;
use super::source::Source;
use crate::geometry::TimeInterval;
use crate::parallel;
use crate::point::layout::double_box::{DoubleBox, DoubleNode, FULL};
use crate::point::layout::double_tree::{DoubleBlock, DoubleTree, NO_POINTS};
use crate::point::layout::lane_intervals::LaneIntervals;
use crate::point::leaf_order::double_order::order;
use crate::point::leaf_order::order::ORDERING;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::progress::Progress;
use crate::simd::{LANES, huge_vec_of};

impl DoubleTree {
    /// The tree of a time slice over some points of a set. Unless it `moves`, all points must be static
    /// and exist throughout the shutter.
    pub(in crate::point) fn build(
        source: &Source,
        slice: SegmentSlice,
        mut numbers: Vec<u32>,
        moves: bool,
        progress: &Progress,
    ) -> DoubleTree {
        let points = DoublePoints { source, slice };
        if !source.all_persist() {
            numbers.retain(|&point| points.exists(point));
        }
        let mut tree = DoubleTree::empty(points, &numbers, moves);
        let (leaf, ordering) = (tree.shape.leaf(), progress.subtask(ORDERING));
        order(&mut numbers, leaf, &points, moves, &ordering);
        drop(ordering);
        let boxes = tree.fill_leaves(points, &numbers, &progress.rest(1.0));
        drop(numbers);
        if !progress.cancelled() {
            tree.write_nodes(boxes);
        }
        tree
    }

    /// A tree with room for some points.
    fn empty(points: DoublePoints<'_>, numbers: &[u32], moves: bool) -> DoubleTree {
        let DoublePoints { source, slice } = points;
        let shape = DoubleTree::shape(numbers.len(), moves);
        let blocks = numbers.len().div_ceil(shape.leaf()) * shape.leaf_blocks;
        let any = |holds: &dyn Fn(TimeInterval) -> bool| {
            !source.all_persist() && numbers.iter().any(|&number| holds(points.active(number)))
        };
        let has_active_intervals = any(&|active| active != TimeInterval::FULL);
        let timed = any(&|active| active.intersect(slice.interval) != Some(slice.interval));
        let times = |timed: bool, rows: usize| vec![LaneIntervals::NEVER; if timed { rows } else { 0 }];
        DoubleTree {
            slice,
            shape,
            nodes: huge_vec_of(DoubleNode::NONE, shape.nodes()),
            slopes: huge_vec_of(DoubleNode::STATIC, if moves { shape.nodes() } else { 0 }),
            blocks: huge_vec_of(DoubleBlock::EMPTY, blocks),
            ends: huge_vec_of(NO_POINTS, if moves { blocks } else { 0 }),
            node_times: times(timed, shape.nodes()),
            block_times: times(timed, blocks),
            active: times(has_active_intervals, blocks),
            references: numbers.len(),
        }
    }

    /// Writes the nodes of all levels above leaves with these boxes.
    fn write_nodes(&mut self, mut boxes: Vec<DoubleBox>) {
        for level in 0..self.shape.levels {
            let (begin, end) = (self.shape.begin[level], self.shape.begin[level + 1]);
            // Even a tree without points has a root.
            let children = |i: usize| &boxes[(i * LANES).min(boxes.len())..((i + 1) * LANES).min(boxes.len())];
            let above = parallel::map(end - begin, |i| DoubleNode::over(children(i), self.moves(), FULL));
            for (node, rows) in (begin..).zip(&above) {
                self.nodes[node] = rows.node;
                if let Some(slopes) = self.slopes.get_mut(node) {
                    *slopes = rows.slopes;
                }
                if let Some(times) = self.node_times.get_mut(node) {
                    *times = rows.times;
                }
            }
            boxes = above.iter().map(|rows| rows.hull).collect();
        }
    }
}
