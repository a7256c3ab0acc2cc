//! The tree over points that move or have an active interval, for one time slice.
//!
//! The same pyramid as the static tree, but faces of boxes are lines in time, points are interpolated
//! from two keys, and if points exist for a while only, nodes and leaves have active intervals.

use super::linear_bounds::{LinearBox, LinearBoxes, TrajectoryRows};
use super::moving_leaf::{LaneIntervals, Leaf, LeafRows, MovingLeaves};
use super::moving_reference::{MovingReference, TimeSlice, positions_at};
use super::moving_view::{AtTime, HasLeaves};
use super::order::{Item, ORDERING, order};
use super::over_interval::{BlockTree, BoxTree, PathRows, PointPath};
use super::slice_tree::SliceTree;
use super::snapshot::{CoordinateView, Target, View, diagonal, outside, rows};
use super::static_tree::Shape;
use crate::geometry::TimeInterval;
use crate::parallel;
use crate::progress::Progress;
use crate::simd::{LANES, Lanes, Mask, Simd, huge_vec_of, prefetch};

/// Points that move or have an active interval, in a 16-ary tree for one time slice.
#[derive(Clone)]
pub(super) struct MovingTree {
    pub(super) slice: TimeSlice,
    pub(super) nodes: Vec<LinearBoxes>,
    /// Index of each node's first child (node, or block on level 0).
    pub(super) first: Vec<u32>,
    pub(super) leaves: MovingLeaves,
    /// Active intervals of the children of nodes; empty if all are active throughout.
    pub(super) node_times: Vec<LaneIntervals>,
    pub(super) levels: usize,
    pub(super) references: usize,
}

/// Writes the rows of a node.
fn set(node: &mut LinearBoxes, times: &mut LaneIntervals, children: &[LinearBox]) {
    for (lane, child) in children.iter().enumerate() {
        node.set(lane, child);
        times.set(lane, child.times);
    }
}

impl MovingTree {
    /// Builds the complete tree: each reference is in one leaf.
    pub(super) fn build(references: &[MovingReference], slice: TimeSlice, progress: &Progress) -> MovingTree {
        let mut items = positions_at(references, slice.middle_phase());
        order(&mut items, LANES, &progress.subtask(ORDERING));
        let timed = references.iter().any(|m| m.interval != slice.interval);
        let has_active_intervals = references.iter().any(|m| m.active != TimeInterval::FULL);
        let shape = Shape::with_leaf(references.len(), 1);
        let count = references.len().div_ceil(LANES);
        let mut leaves = MovingLeaves::empty(count, timed, has_active_intervals);
        let mut boxes: Vec<Option<LinearBox>> = vec![None; count];
        Fill { references, slice: &slice }.leaves(&items, leaves.rows(), &mut boxes);
        drop(items);
        let mut nodes = huge_vec_of(LinearBoxes::NONE, shape.nodes());
        let mut node_times = vec![LaneIntervals::NEVER; if timed { shape.nodes() } else { 0 }];
        let mut boxes: Vec<LinearBox> = boxes.into_iter().flatten().collect();
        for level in 0..shape.levels {
            let begin = shape.begin[level];
            let mut above = Vec::with_capacity(boxes.len().div_ceil(LANES));
            // Even a tree without references has a root.
            for i in 0..shape.begin[level + 1] - begin {
                let children = &boxes[(i * LANES).min(boxes.len())..((i + 1) * LANES).min(boxes.len())];
                let mut times = LaneIntervals::NEVER;
                set(&mut nodes[begin + i], &mut times, children);
                if timed {
                    node_times[begin + i] = times;
                }
                if !children.is_empty() {
                    above.push(LinearBox::of_boxes(children));
                }
            }
            boxes = above;
        }
        let first = first_children(&shape);
        progress.finished(1.0 - ORDERING);
        MovingTree { slice, nodes, first, leaves, node_times, levels: shape.levels, references: references.len() }
    }

    /// Whether references have intervals.
    pub(super) fn timed(&self) -> bool {
        !self.node_times.is_empty()
    }

    /// The tree at a time, which lies in its slice.
    #[inline(always)]
    pub(super) fn at<const TIMED: bool>(&self, time: f32) -> MovingView<'_, TIMED> {
        AtTime::new(self, &self.slice, time)
    }
}

/// Index of each node's first child (node, or block on level 0).
pub(super) fn first_children(shape: &Shape) -> Vec<u32> {
    let mut first = Vec::with_capacity(shape.nodes());
    for level in 0..shape.levels {
        let below = if level == 0 { 0 } else { shape.begin[level - 1] };
        first.extend((0..shape.begin[level + 1] - shape.begin[level]).map(|i| (below + i * LANES) as u32));
    }
    first
}

/// The inputs of filling leaves.
#[derive(Clone, Copy)]
struct Fill<'a> {
    references: &'a [MovingReference],
    slice: &'a TimeSlice,
}

impl Fill<'_> {
    /// Fills leaves from ordered items, recursively in parallel.
    fn leaves(self, items: &[Item], mut leaves: LeafRows<'_>, boxes: &mut [Option<LinearBox>]) {
        if leaves.len() > 1024 {
            let half = leaves.len() / 2;
            let (items, more_items) = items.split_at(half * LANES);
            let (boxes, more_boxes) = boxes.split_at_mut(half);
            let [leaves, more_leaves] = leaves.split_at(half);
            parallel::both(|| self.leaves(items, leaves, boxes), || self.leaves(more_items, more_leaves, more_boxes));
            return;
        }
        let throughout = [self.slice.interval.begin(), self.slice.interval.end_bound()];
        let whole = self.slice.range(throughout);
        let mut rows = TrajectoryRows {
            open: [[0.0; LANES]; 3],
            close: [[0.0; LANES]; 3],
            range: whole.map(|phase| [phase; LANES]),
            times: throughout.map(|time| [time; LANES]),
        };
        let timed = leaves.timed();
        // A full leaf overwrites every lane of the one before.
        let mut leaf = Leaf::EMPTY;
        for (i, of_leaf) in items.chunks(LANES).enumerate() {
            // The accesses are practically random, and each reference may span two cache lines.
            for item in items.iter().skip((i + 2) * LANES).take(LANES) {
                let reference = &self.references[item.index as usize];
                prefetch(reference);
                prefetch(&reference.id);
            }
            if of_leaf.len() < LANES {
                leaf = Leaf::EMPTY;
            }
            for lane in 0..LANES {
                let item = of_leaf.get(lane).or(of_leaf.last()).expect("a leaf has a point");
                let reference = &self.references[item.index as usize];
                rows.set_ends(lane, [reference.open, reference.close]);
                if lane < of_leaf.len() {
                    leaf.set(lane, reference);
                }
                if timed {
                    let active_throughout = reference.interval == self.slice.interval;
                    let range = if active_throughout { whole } else { reference.range(self.slice) };
                    let times = [reference.interval.begin(), reference.interval.end_bound()];
                    rows.set_times(lane, range, times);
                    if lane < of_leaf.len() {
                        leaf.set_times(lane, times, reference.active);
                    }
                }
            }
            leaves.set(i, &leaf);
            boxes[i] = Some(LinearBox::of_points(&rows));
        }
    }
}

impl SliceTree for MovingTree {
    fn time_slice(&self) -> &TimeSlice {
        &self.slice
    }
    fn references(&self) -> usize {
        self.references
    }
    fn node_count(&self) -> usize {
        self.nodes.len()
    }
    fn levels(&self) -> usize {
        self.levels
    }
    fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<LinearBoxes>()
            + self.leaves.bytes()
            + self.node_times.capacity() * size_of::<LaneIntervals>()
            + self.first.capacity() * size_of::<u32>()
    }
}

impl HasLeaves for MovingTree {
    #[inline(always)]
    fn leaves(&self) -> &MovingLeaves {
        &self.leaves
    }
}

/// A moving tree at a time.
pub(super) type MovingView<'a, const TIMED: bool> = AtTime<'a, MovingTree, TIMED>;

/// Three rows of lines at a phase.
#[inline(always)]
fn line<S: Simd>(s: S, at: &[Lanes<f32>; 3], slope: &[Lanes<f32>; 3], phase: S::F) -> [S::F; 3] {
    let ([x, y, z], [by_x, by_y, by_z]) = (rows(s, at), rows(s, slope));
    [x + by_x * phase, y + by_y * phase, z + by_z * phase]
}

impl<const TIMED: bool> View for MovingView<'_, TIMED> {
    const BALL: f32 = if TIMED { 0.36 } else { 0.14 };

    #[inline(always)]
    fn root(&self) -> (usize, usize) {
        (self.tree.levels - 1, self.tree.nodes.len() - 1)
    }
    #[inline(always)]
    fn first_child(&self, _level: usize, node: usize) -> usize {
        self.tree.first[node] as usize
    }
    #[inline(always)]
    fn first_block(&self, node: usize) -> usize {
        self.tree.first[node] as usize
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> (S::F, Mask) {
        let boxes = &self.tree.nodes[node];
        // Not fused: then every instruction set visits the same nodes, and approximate answers agree as well.
        let lo = line(s, &boxes.lo, &boxes.lo_slope, target.phase);
        let hi = line(s, &boxes.hi, &boxes.hi_slope, target.phase);
        let (distances, holding) = outside(s, &target.point, lo, hi);
        if !TIMED {
            return (distances, holding);
        }
        let active = self.tree.node_times[node].active_at(s, target.time);
        (s.select(active, distances, s.splat(f32::INFINITY)), holding & active)
    }
    #[inline(always)]
    fn box_sizes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> S::F {
        let boxes = &self.tree.nodes[node];
        let lo = line(s, &boxes.lo, &boxes.lo_slope, target.phase);
        diagonal::<S>(lo, line(s, &boxes.hi, &boxes.hi_slope, target.phase))
    }
    #[inline(always)]
    fn prefetch_node(&self, node: usize) {
        prefetch(&self.tree.nodes[node]);
    }
}

impl<const TIMED: bool> CoordinateView for MovingView<'_, TIMED> {
    #[inline(always)]
    fn faces<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> ([S::F; 3], [S::F; 3]) {
        let boxes = &self.tree.nodes[node];
        let mut lo = line(s, &boxes.lo, &boxes.lo_slope, target.phase);
        let hi = line(s, &boxes.hi, &boxes.hi_slope, target.phase);
        if TIMED {
            let active = self.tree.node_times[node].active_at(s, target.time);
            lo[0] = s.select(active, lo[0], s.splat(f32::INFINITY));
        }
        (lo, hi)
    }
    #[inline(always)]
    fn positions<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> [S::F; 3] {
        self.point_positions(s, target, block)
    }
}

impl BoxTree for MovingTree {
    fn slice(&self) -> TimeSlice {
        self.slice
    }
    fn root_node(&self) -> (usize, usize) {
        (self.levels - 1, self.nodes.len() - 1)
    }
    fn children(&self, _level: usize, node: usize) -> (usize, usize) {
        (self.first[node] as usize, 1)
    }
    #[inline(always)]
    fn times(&self, node: usize) -> [Lanes<f32>; 2] {
        if let Some(times) = self.node_times.get(node) {
            return [times.begin, times.end];
        }
        [self.nodes[node].lo[0].map(|x| if x < f32::INFINITY { 0.0 } else { f32::INFINITY }), [1.0; LANES]]
    }
    #[inline(always)]
    fn faces(&self, node: usize, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        self.nodes[node].faces(phase)
    }
    fn is_active(&self, block: usize, lane: usize, time: f32) -> bool {
        self.leaves.is_active(block, lane, time)
    }
    fn point_path(&self, block: usize, lane: usize) -> Option<PointPath> {
        self.leaves.point_path(block, lane)
    }
}

impl BlockTree for MovingTree {
    #[inline(always)]
    fn rows(&self, block: usize) -> PathRows {
        self.leaves.path_rows(block)
    }
    fn has_active_intervals(&self) -> bool {
        !self.leaves.active.is_empty()
    }
}
