//! The tree over points that move or have an active interval, for one time slice.
//!
//! The same pyramid as the static tree, but faces of boxes are lines in time, points are interpolated
//! from two keys, and if points exist for a while only, nodes and leaves have active intervals.

use super::boxes::LinearBoxes;
use super::fill_moving_leaves::{MovingBottomNodes, OrderedReferences, fill};
use super::lane_intervals::LaneIntervals;
use super::linear_bounds::LinearBox;
use super::moving_leaf::MovingLeaves;
use super::moving_view::TreeAtTime;
use super::over_interval::{BlockTree, BoxTree, PathRows, throughout};
use super::shape::Shape;
use super::slice_tree::{SliceTree, TreeSize};
use super::view::{CoordinateView, Target, View, diagonal, outside, rows};
use crate::file::{Encoder, FileError};
use crate::point::leaf_order::moving_reference::{MovingReference, References, take_positions};
use crate::point::leaf_order::order::{Displacements, ORDERING, order_rows};
use crate::point::leaf_order::point_rows::{NO_POINT, PointRows};
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::progress::Progress;
use crate::simd::{LANES, Lanes, Mask, MovingPointBlock, PointBlock, Simd, WordBlock, huge_vec_of, prefetch};

/// Points that move or have an active interval, in a 16-ary tree for one time slice.
#[derive(Clone)]
pub(in crate::point) struct MovingTree {
    pub(in crate::point) slice: SegmentSlice,
    pub(in crate::point) nodes: Vec<LinearBoxes>,
    pub(in crate::point) shape: Shape,
    pub(in crate::point) leaves: MovingLeaves,
    /// Active intervals of the children of nodes; empty if all are active throughout.
    pub(in crate::point) node_times: Vec<LaneIntervals>,
    pub(in crate::point) references: usize,
}

/// A tree without fast references.
pub(in crate::point) struct WithoutFast {
    pub(in crate::point) tree: MovingTree,
    /// The numbers of the references that are fast.
    pub(in crate::point) fast: Vec<u32>,
    /// Whether references are divided by motion as well as by position.
    pub(in crate::point) by_motion: bool,
}

impl MovingTree {
    /// Builds the complete tree: each reference is in one leaf.
    pub(in crate::point) fn build<R: References + ?Sized>(
        references: &R,
        slice: SegmentSlice,
        progress: &Progress,
    ) -> MovingTree {
        MovingTree::build_without_fast(references, slice, None, &mut Vec::new(), progress).tree
    }

    /// The same without references that are fast ([`fast_points`](crate::point::leaf_order::fast_points)), if the longest side of a
    /// leaf of usual size is given. Their lanes are empty, the shape of the tree is that with them. Trees that are built one after
    /// the other share the memory `more`.
    pub(in crate::point) fn build_without_fast<R: References + ?Sized>(
        references: &R,
        slice: SegmentSlice,
        without_fast: Option<f32>,
        more: &mut Vec<PointBlock>,
        progress: &Progress,
    ) -> WithoutFast {
        // Points are put in order in the memory of the blocks that they end up in, and as much besides as they need.
        let count = references.len();
        let mut blocks = MovingPointBlock::zeroed(count.div_ceil(LANES));
        let mut from = PointRows::in_blocks(&mut blocks, count);
        take_positions(from.borrow(), references, slice.middle_phase());
        let mut rows = PointRows::in_memory(more, count);
        let phases = (slice.phases[1] - slice.phases[0]) as f32;
        let displacements = |numbers: &[u32], to: &mut [[f32; 3]]| {
            let points = numbers.iter().zip(to).enumerate();
            for (i, (&number, to)) in points.filter(|(_, (number, _))| **number != NO_POINT.index) {
                // The accesses are practically random.
                if let Some(&later) = numbers.get(i + LANES) {
                    references.prefetch(later);
                }
                let MovingReference { open, close, .. } = references.reference(number);
                *to = core::array::from_fn(|axis| (close[axis] - open[axis]) * phases);
            }
        };
        // Fast references would be divided from the others instead of left out.
        let motion = without_fast.is_none().then_some(&displacements as Displacements<'_>);
        let by_motion = order_rows(from, &mut rows, LANES, motion, &progress.subtask(ORDERING));
        let timed = references.timed(&slice);
        let shape = Shape::with_leaf(count, 1);
        let mut leaves = MovingLeaves::of(blocks, timed, references.have_active_intervals());
        let mut nodes = huge_vec_of(LinearBoxes::NONE, shape.nodes());
        let mut node_times = vec![LaneIntervals::NEVER; if timed { shape.nodes() } else { 0 }];
        let mut boxes = vec![LinearBox::EMPTY; shape.begin[1]];
        let bottoms = MovingBottomNodes {
            first: 0,
            count,
            nodes: &mut nodes[..shape.begin[1]],
            times: &mut node_times[..if timed { shape.begin[1] } else { 0 }],
            boxes: &mut boxes,
            leaves: leaves.rows(),
        };
        let ordered = OrderedReferences { references, slice: &slice, rows: &rows, without_fast };
        let fast = fill(bottoms, &ordered, &progress.in_units(count));
        for level in 1..shape.levels {
            for (node, children) in (shape.begin[level]..).zip(boxes.chunks(LANES)) {
                for (lane, child) in children.iter().enumerate() {
                    nodes[node].set(lane, child);
                    if let Some(times) = node_times.get_mut(node) {
                        times.set(lane, child.times);
                    }
                }
            }
            boxes = boxes.chunks(LANES).map(LinearBox::around).collect();
        }
        let references = count - fast.len();
        let tree = MovingTree { slice, nodes, shape, leaves, node_times, references };
        WithoutFast { tree, fast, by_motion }
    }

    /// The tree at a time, which lies in its slice.
    #[inline(always)]
    pub(in crate::point) fn at<const TIMED: bool>(&self, time: f32) -> MovingView<'_, TIMED> {
        TreeAtTime::new(self, &self.leaves, &self.slice, time)
    }
}

impl SliceTree for MovingTree {
    #[inline(always)]
    fn slice(&self) -> SegmentSlice {
        self.slice
    }
    fn size(&self) -> TreeSize {
        let bytes = self.nodes.capacity() * size_of::<LinearBoxes>()
            + self.leaves.bytes()
            + self.node_times.capacity() * size_of::<LaneIntervals>();
        TreeSize { references: self.references, nodes: self.nodes.len(), levels: self.shape.levels, bytes }
    }
    fn block_count(&self) -> usize {
        self.leaves.blocks.len()
    }
    fn block_ids(&self, block: usize) -> &Lanes<u32> {
        self.leaves.ids(block)
    }
    fn block_ids_mut(&mut self, block: usize) -> &mut Lanes<u32> {
        &mut self.leaves.blocks[block].id
    }
    fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put(self.references as u64)?;
        to.array(&self.nodes)?;
        to.array(&self.node_times)?;
        self.leaves.encode(to)
    }
}

/// A moving tree at a time.
pub(in crate::point) type MovingView<'a, const TIMED: bool> = TreeAtTime<'a, MovingTree, TIMED>;

/// Three rows of lines at a phase.
#[inline(always)]
fn line<S: Simd>(s: S, at: &[Lanes<f32>; 3], slope: &[Lanes<f32>; 3], phase: S::F) -> [S::F; 3] {
    let ([x, y, z], [by_x, by_y, by_z]) = (rows(s, at), rows(s, slope));
    [x + by_x * phase, y + by_y * phase, z + by_z * phase]
}

impl<const TIMED: bool> View for MovingView<'_, TIMED> {
    const BALL: f32 = if TIMED { 0.36 } else { 0.14 };

    #[inline(always)]
    fn shape(&self) -> &Shape {
        &self.tree.shape
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
        self.tree.leaves.positions::<S, TIMED>(s, self.at, target, block)
    }
}

impl BoxTree for MovingTree {
    fn shape(&self) -> &Shape {
        &self.shape
    }
    #[inline(always)]
    fn times(&self, node: usize) -> [Lanes<f32>; 2] {
        if let Some(times) = self.node_times.get(node) {
            return [times.begin, times.end];
        }
        throughout(&self.nodes[node].lo[0])
    }
    #[inline(always)]
    fn faces(&self, node: usize, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        self.nodes[node].faces(phase)
    }
    fn is_active(&self, block: usize, lane: usize, time: f32) -> bool {
        self.leaves.is_active(block, lane, time)
    }
}

impl BlockTree for MovingTree {
    type Coordinate = f32;
    #[inline(always)]
    fn rows(&self, block: usize) -> PathRows<f32> {
        self.leaves.paths(block)
    }
    fn has_active_intervals(&self) -> bool {
        !self.leaves.active.is_empty()
    }
    fn timed(&self) -> bool {
        !self.node_times.is_empty()
    }
    fn begins_at(&self, time: f32) -> bool {
        self.leaves.active.iter().any(|active| active.begin.contains(&time))
    }
}
