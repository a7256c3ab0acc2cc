//! From moving points below bottom nodes to leaf blocks and boxes that move linearly.

use super::boxes::LinearBoxes;
use super::lane_intervals::LaneIntervals;
use super::linear_bounds::{LinearBox, TrajectoryRows};
use super::moving_leaf::LeafRows;
use crate::parallel;
use crate::point::leaf_order::bottom_order::{MOST, Rows, SPARE};
use crate::point::leaf_order::fast_points::{Among, displacements, sizes_of_leaves};
use crate::point::leaf_order::moving_reference::References;
use crate::point::leaf_order::point_rows::PointRows;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::progress::Progress;
use crate::simd::{Kernel, LANES, Simd, SimdLevel, dispatch};

/// What leaves are filled from.
pub(in crate::point) struct OrderedReferences<'a, R: ?Sized> {
    pub(in crate::point) references: &'a R,
    pub(in crate::point) slice: &'a SegmentSlice,
    /// Positions and numbers of the references, those of one bottom node behind those of the other.
    pub(in crate::point) rows: &'a PointRows<'a>,
    /// The longest side of a leaf of usual size, if fast references are to be left out.
    pub(in crate::point) without_fast: Option<f32>,
}

/// Bottom nodes and the leaves below them, to be filled.
pub(in crate::point) struct MovingBottomNodes<'a> {
    /// Number of the first reference.
    pub(in crate::point) first: usize,
    /// Number of references; a root may have none.
    pub(in crate::point) count: usize,
    pub(in crate::point) nodes: &'a mut [LinearBoxes],
    /// Active intervals of the children of nodes; empty if all are active throughout.
    pub(in crate::point) times: &'a mut [LaneIntervals],
    /// The box around each node.
    pub(in crate::point) boxes: &'a mut [LinearBox],
    pub(in crate::point) leaves: LeafRows<'a>,
}

/// References below a bottom node.
const BELOW: usize = LANES * LANES;

/// Nodes that one thread fills at a time.
const SHARE: usize = 64;

/// Takes the references of each bottom node, puts them in order, and writes its leaves and boxes. Returns the numbers of those that
/// were left out; the last lanes of their bottom nodes remain empty. `progress` counts references; once it is cancelled, nothing
/// more is written.
pub(in crate::point) fn fill<R: References + ?Sized>(
    bottoms: MovingBottomNodes<'_>,
    from: &OrderedReferences<'_, R>,
    progress: &Progress,
) -> Vec<u32> {
    let MovingBottomNodes { first, count, nodes, times, boxes, leaves } = bottoms;
    if nodes.len() > SHARE {
        let half = nodes.len() / 2;
        let (nodes, more_nodes) = nodes.split_at_mut(half);
        let (times, more_times) = times.split_at_mut(half.min(times.len()));
        let (boxes, more_boxes) = boxes.split_at_mut(half);
        let [leaves, more_leaves] = leaves.split_at(half * LANES);
        let low = MovingBottomNodes { first, count: half * BELOW, nodes, times, boxes, leaves };
        let high = MovingBottomNodes {
            first: first + half * BELOW,
            count: count - half * BELOW,
            nodes: more_nodes,
            times: more_times,
            boxes: more_boxes,
            leaves: more_leaves,
        };
        let (mut fast, more_fast) = parallel::both(|| fill(low, from, progress), || fill(high, from, progress));
        fast.extend(more_fast);
        return fast;
    }
    if progress.cancelled() {
        return Vec::new();
    }
    progress.finished(count.min(nodes.len() * BELOW) as f64);
    // What is written does not depend on the instruction set.
    dispatch(SimdLevel::best(), Fill { bottoms: MovingBottomNodes { first, count, nodes, times, boxes, leaves }, from })
}

struct Fill<'a, 'b, R: ?Sized> {
    bottoms: MovingBottomNodes<'a>,
    from: &'b OrderedReferences<'b, R>,
}

impl<R: References + ?Sized> Kernel for Fill<'_, '_, R> {
    type Output = Vec<u32>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Vec<u32> {
        let Fill { bottoms: MovingBottomNodes { first, count, nodes, times, boxes, mut leaves }, from } = self;
        let OrderedReferences { references, slice, rows: all, without_fast } = from;
        let mut fast = Vec::new();
        let (mut rows, mut spare) = (Rows::<MOST>::EMPTY, Rows::<SPARE>::EMPTY);
        let mut by = [[[0.0; LANES]; 3]; LANES];
        let mut trajectories = throughout(slice);
        let (whole, timed) = (trajectories.range.map(|row| row[0]), leaves.timed());
        for (number, node) in nodes.iter_mut().enumerate() {
            let before = number * BELOW;
            let (begin, count) = (first + before, count.saturating_sub(before).min(BELOW));
            rows.take(all, begin, count);
            rows.order(s, count, LANES, &mut spare);
            let (room, mut used_of) = (count.div_ceil(LANES), sizes_of_leaves(count));
            for (leaf, &used) in used_of.iter().enumerate().take(room) {
                // The accesses are practically random. Those of the next node are known before their order.
                let next = begin + BELOW + leaf * LANES;
                for &later in all.index.get(next..).unwrap_or_default().iter().take(used) {
                    references.prefetch(later);
                }
                let of_leaf = &rows.index[leaf * LANES..(leaf + 1) * LANES];
                leaves
                    .set_all(number * LANES + leaf, of_leaf[..used].iter().map(|&number| references.reference(number)));
            }
            if let Some(leaf_size) = *without_fast {
                for (leaf, by) in by.iter_mut().enumerate().take(room) {
                    *by = displacements(s, &leaves.ends(number * LANES + leaf), used_of[leaf]);
                }
                let among = Among { references: *references, slice, timed, leaf_size };
                let kept = among.take(s, (&mut rows, count), &by, &mut spare, &mut fast);
                used_of = kept.in_leaves;
                for leaf in (0..room).filter(|leaf| kept.changed >> leaf & 1 != 0) {
                    for lane in 0..used_of[leaf] {
                        let reference = references.reference(rows.index[leaf * LANES + lane]);
                        leaves.set(number * LANES + leaf, lane, &reference);
                    }
                }
            }
            let mut children = [LinearBox::EMPTY; LANES];
            let mut of_node = LaneIntervals::NEVER;
            let used_children = used_of.iter().filter(|&&used| used > 0).count();
            for (leaf, child) in children.iter_mut().enumerate().take(used_children) {
                let (at, used) = (number * LANES + leaf, used_of[leaf]);
                for lane in 0..if timed { used } else { 0 } {
                    let reference = references.reference(rows.index[leaf * LANES + lane]);
                    let active_throughout = reference.interval == slice.interval;
                    let range = if active_throughout { whole } else { reference.range(slice) };
                    let times = [reference.interval.begin(), reference.interval.end_bound()];
                    trajectories.set_times(lane, range, times);
                    leaves.set_times(at, lane, times, reference.active);
                }
                for lane in used..LANES {
                    leaves.clear(at, lane);
                }
                (trajectories.open, trajectories.close) = leaves.ends(at);
                trajectories.complete(used);
                trajectories.whole = !timed || trajectories.same_phases();
                *child = LinearBox::of_points(s, &trajectories);
                node.set(leaf, child);
                of_node.set(leaf, child.times);
            }
            for leaf in used_children..room {
                for lane in 0..LANES {
                    leaves.clear(number * LANES + leaf, lane);
                }
            }
            if let Some(times) = times.get_mut(number) {
                *times = of_node;
            }
            if used_children > 0 {
                boxes[number] = LinearBox::of_boxes(s, &children[..used_children]);
            }
        }
        fast
    }
}

/// Rows for trajectories of points that are active throughout a slice.
fn throughout(slice: &SegmentSlice) -> TrajectoryRows {
    let times = [slice.interval.begin(), slice.interval.end_bound()];
    TrajectoryRows {
        open: [[0.0; LANES]; 3],
        close: [[0.0; LANES]; 3],
        range: slice.range(times).map(|phase| [phase; LANES]),
        times: times.map(|time| [time; LANES]),
        whole: true,
    }
}
