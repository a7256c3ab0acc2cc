//! Building a tree over f64 points.

use super::fill_double_leaves::DoublePoints;
use super::source::Source;
use crate::geometry::TimeInterval;
use crate::parallel;
use crate::point::layout::double_box::{DoubleBox, DoubleNode, DoubleNodeRows, FULL};
use crate::point::layout::double_tree::{DoubleBlock, DoubleTree, NO_POINTS};
use crate::point::layout::lane_intervals::LaneIntervals;
use crate::point::leaf_order::double_order::order;
use crate::point::leaf_order::order::ORDERING;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::progress::Progress;
use crate::simd::{LANES, huge_vec_of};

/// Nodes that one thread writes at a time.
const SHARE: usize = 256;

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
            let mut slopes = self.slopes.get_mut(begin..end).unwrap_or_default().chunks_mut(SHARE);
            let mut times = self.node_times.get_mut(begin..end).unwrap_or_default().chunks_mut(SHARE);
            let nodes = self.nodes[begin..end].chunks_mut(SHARE).enumerate();
            let mut shares: Vec<_> = nodes.map(|(i, nodes)| (i * SHARE, nodes, slopes.next(), times.next())).collect();
            let above = parallel::each(&mut shares, |(first, nodes, slopes, times)| {
                let mut slopes = slopes.iter_mut().flat_map(|slopes| slopes.iter_mut());
                let mut times = times.iter_mut().flat_map(|times| times.iter_mut());
                let rows =
                    nodes.iter_mut().map(|node| DoubleNodeRows { node, slopes: slopes.next(), times: times.next() });
                (*first..).zip(rows).map(|(i, rows)| DoubleNode::over(children(i), FULL, rows)).collect::<Vec<_>>()
            });
            boxes = above.concat();
        }
    }
}
