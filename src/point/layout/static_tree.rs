//! The complete tree over static points.
//!
//! The picture to have in mind: leaves of 16 or 32 points in a row, nodes of sixteen boxes above
//! them, and nothing else, no pointers and no time. Children of the j-th node of a level are the
//! nodes 16j to 16j + 15 of the level below. Which of the two leaf sizes is taken depends on which
//! fills the levels better.

use super::boxes::Boxes;
use super::fill_leaves::{BottomNodes, BottomPoints, fill};
use super::over_interval::{BlockTree, BoxTree, PathRows, throughout};
use super::shape::Shape;
use super::slice_tree::{SliceTree, TreeSize};
use super::view::{CoordinateView, LeafView, Target, View, diagonal, outside, rows, squared};
use crate::file::{Encoder, FileError};
use crate::limits::MAX_LEVELS;
use crate::point::leaf_order::bottom_order::{MOST, Rows};
use crate::point::leaf_order::order::{ORDERING, order_rows};
use crate::point::leaf_order::point_rows::PointRows;
use crate::point::leaf_order::segment_slice::SegmentSlice;
use crate::progress::Progress;
use crate::simd::{Item, LANES, Lanes, Mask, PointBlock, Simd, WordBlock, huge_vec_of, prefetch};
use glam::Vec3;

/// Static points, in a complete 16-ary tree.
#[derive(Clone)]
pub(in crate::point) struct StaticTree {
    /// The boxes of all nodes, level by level from the bottom.
    pub(in crate::point) nodes: Vec<Boxes>,
    /// As many as all bottom nodes have lanes for.
    pub(in crate::point) blocks: Vec<PointBlock>,
    pub(in crate::point) shape: Shape,
    pub(in crate::point) references: usize,
    /// What is known of the time when the points were put in order; nothing if that was for this tree.
    pub(in crate::point) ordered: Option<Box<LastOrder>>,
}

/// When all points were put in order, and since.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct LastOrder {
    /// [`StaticTree::sizes`] then.
    pub(in crate::point) sizes: [f64; MAX_LEVELS],
    /// By how much leaves have been larger in all trees since, added up, as a share of their sides.
    pub(in crate::point) excess: f64,
}

/// The least size of a box relative to that around it; smaller ones, as those of equal points, count as this.
const LEAST_SIZE: f64 = 1.0 / 16_777_216.0;

/// Sizes of boxes are multiples of one over this.
const SIZE_STEPS: f64 = (1u64 << 32) as f64;

impl StaticTree {
    /// The blocks of a tree over `count` points, without points.
    pub(in crate::point) fn room(count: usize) -> Vec<PointBlock> {
        let shape = Shape::flattest(count);
        PointBlock::zeroed(shape.begin[1] * LANES * shape.leaf_blocks)
    }

    /// `count` items in rows, in the memory of the blocks of their tree.
    pub(in crate::point) fn rows(count: usize, items: impl Iterator<Item = Item>) -> Vec<PointBlock> {
        let mut blocks = StaticTree::room(count);
        PointRows::in_blocks(&mut blocks, count).take(items);
        blocks
    }

    /// Builds the tree over the first `count` points of [`rows`](StaticTree::rows). `id_of` turns an index there into the id
    /// that answers carry.
    ///
    /// Points are put in order in rows, in the memory of the blocks that they end up in and as much besides, unless they are all
    /// below one node.
    pub(in crate::point) fn build(
        count: usize,
        mut blocks: Vec<PointBlock>,
        id_of: impl Fn(u32) -> u32 + Sync,
        progress: &Progress,
    ) -> StaticTree {
        let shape = Shape::flattest(count);
        if shape.levels == 1 {
            return StaticTree::around(count, blocks, shape, &Sorted { rows: None, id_of }, progress);
        }
        let mut more = PointRows::memory(count);
        let mut rows = PointRows::in_blocks(&mut more, count);
        order_rows(
            PointRows::in_blocks(&mut blocks, count),
            &mut rows,
            shape.leaf(),
            None,
            &progress.subtask(ORDERING),
        );
        StaticTree::around(count, blocks, shape, &Sorted { rows: Some(&rows), id_of }, &progress.rest(1.0))
    }

    /// The tree over points that come bottom node by bottom node.
    fn around(
        count: usize,
        blocks: Vec<PointBlock>,
        shape: Shape,
        points: &impl BottomPoints,
        progress: &Progress,
    ) -> StaticTree {
        let nodes = huge_vec_of(Boxes::NONE, shape.nodes());
        let mut tree = StaticTree { nodes, blocks, shape, references: count, ordered: None };
        let (nodes, blocks) = (&mut tree.nodes[..shape.begin[1]], &mut tree.blocks[..]);
        let bottoms = BottomNodes { first: 0, count, nodes, blocks, leaf_blocks: shape.leaf_blocks };
        fill(bottoms, points, &progress.in_units(count));
        for level in 1..shape.levels {
            for node in shape.begin[level]..shape.begin[level + 1] {
                let first = shape.first_child(level, node);
                let mut boxes = Boxes::NONE;
                for (lane, child) in (first..shape.begin[level]).take(LANES).enumerate() {
                    let (lo, hi) = tree.nodes[child].bounds();
                    boxes.include(lane, lo, hi);
                }
                tree.nodes[node] = boxes;
            }
        }
        tree
    }

    /// The tree over the same points elsewhere, in almost the same order: only the points of a bottom node are put in
    /// order again. `at` has the position of each id.
    pub(in crate::point) fn moved(mut self, at: &[[f32; 3]]) -> StaticTree {
        let mut ordered =
            self.ordered.take().unwrap_or_else(|| Box::new(LastOrder { sizes: self.sizes(), excess: 0.0 }));
        let mut tree = StaticTree::around(at.len(), self.blocks, self.shape, &Moved { at }, &Progress::new(None));
        let growth: f64 = tree.sizes().iter().zip(&ordered.sizes).map(|(now, then)| (now - then).max(0.0)).sum();
        ordered.excess += growth.exp_m1();
        tree.ordered = Some(ordered);
        tree
    }

    /// By how much leaves have been larger than when all points were put in order, as a share of their sides, added up
    /// over the trees since.
    pub(in crate::point) fn excess(&self) -> f64 {
        self.ordered.as_ref().map_or(0.0, |ordered| ordered.excess)
    }

    /// How large the boxes below the nodes of each level are, relative to the box around those of the same node: the logarithm of
    /// the ratio of their sides, on average.
    ///
    /// Points that mix make boxes overlap, so that these ratios grow, at the levels at which they mix. A set that grows or shrinks,
    /// as a whole or in parts, does not change them.
    fn sizes(&self) -> [f64; MAX_LEVELS] {
        let mut sizes = [0.0; MAX_LEVELS];
        let side =
            |lo: [f32; 3], hi: [f32; 3]| (0..3).map(|axis| f64::from(hi[axis]) - f64::from(lo[axis])).sum::<f64>();
        for (level, size) in sizes.iter_mut().enumerate().take(self.shape.levels) {
            let mut boxes = 0;
            for node in &self.nodes[self.shape.begin[level]..self.shape.begin[level + 1]] {
                let (lo, hi) = node.bounds();
                let whole = side(lo, hi);
                // The product of sixteen is far above the least f64.
                let mut product = 1.0;
                for lane in (0..LANES).filter(|&lane| node.lo[0][lane] <= node.hi[0][lane]) {
                    let [lo, hi] = [&node.lo, &node.hi].map(|faces| faces.map(|row| row[lane]));
                    product *= if whole > 0.0 { (side(lo, hi) / whole).max(LEAST_SIZE) } else { 1.0 };
                    boxes += 1;
                }
                *size += product.ln();
            }
            *size /= f64::from(boxes.max(1));
            // Logarithms of platforms differ in their last bits, and files with them.
            *size = (*size * SIZE_STEPS).round() / SIZE_STEPS;
        }
        sizes
    }
}

impl SliceTree for StaticTree {
    fn slice(&self) -> SegmentSlice {
        SegmentSlice::AT_REST
    }
    fn size(&self) -> TreeSize {
        let bytes = self.nodes.capacity() * size_of::<Boxes>() + self.blocks.capacity() * size_of::<PointBlock>();
        TreeSize { references: self.references, nodes: self.nodes.len(), levels: self.shape.levels, bytes }
    }
    fn block_count(&self) -> usize {
        self.blocks.len()
    }
    fn block_ids(&self, block: usize) -> &Lanes<u32> {
        &self.blocks[block].id
    }
    fn block_ids_mut(&mut self, block: usize) -> &mut Lanes<u32> {
        &mut self.blocks[block].id
    }
    fn encode(&self, to: &mut Encoder<'_>) -> Result<(), FileError> {
        to.put(self.references as u64)?;
        let ordered = self.ordered.iter().flat_map(|ordered| [ordered.excess].into_iter().chain(ordered.sizes));
        to.array(&ordered.collect::<Vec<f64>>())?;
        to.array(&self.nodes)?;
        to.array(&self.blocks)
    }
}

/// Points in rows, those of one bottom node behind those of the other.
struct Sorted<'a, F> {
    /// None if they are in the memory of the blocks of the only node.
    rows: Option<&'a PointRows<'a>>,
    id_of: F,
}

impl<F: Fn(u32) -> u32 + Sync> BottomPoints for Sorted<'_, F> {
    #[inline(always)]
    fn take(&self, first: usize, count: usize, blocks: &mut [PointBlock], to: &mut Rows<MOST>) {
        match self.rows {
            Some(rows) => to.take(rows, first, count),
            None => to.take(&PointRows::in_blocks(blocks, count), first, count),
        }
    }
    #[inline(always)]
    fn id(&self, index: u32) -> u32 {
        (self.id_of)(index)
    }
}

/// The points that are in the blocks already, elsewhere.
struct Moved<'a> {
    /// The position of each id.
    at: &'a [[f32; 3]],
}

impl BottomPoints for Moved<'_> {
    #[inline(always)]
    fn take(&self, _first: usize, count: usize, blocks: &mut [PointBlock], to: &mut Rows<MOST>) {
        // A leaf is full before the next one has points.
        for (i, &id) in blocks.iter().flat_map(|block| &block.id).take(count).enumerate() {
            to.set(i, &Item { at: self.at[id as usize], index: id });
        }
    }
    /// Ids lie anywhere in memory: those of one node arrive while the points of the node before it are put in order.
    #[inline(always)]
    fn prefetch(&self, blocks: &[PointBlock]) {
        for id in blocks.iter().flat_map(|block| &block.id) {
            if let Some(at) = self.at.get(*id as usize) {
                prefetch(at);
            }
        }
    }
    #[inline(always)]
    fn id(&self, index: u32) -> u32 {
        index
    }
}

impl LeafView for &StaticTree {
    #[inline(always)]
    fn leaf_blocks(&self) -> usize {
        self.shape.leaf_blocks
    }
    #[inline(always)]
    fn target<S: Simd>(&self, s: S, q: Vec3) -> Target<S> {
        Target::static_point(s, q)
    }
    #[inline(always)]
    fn point_distances<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> S::F {
        let [x, y, z] = rows(s, &self.blocks[block].at);
        squared::<S>(x - target.point[0], y - target.point[1], z - target.point[2])
    }
    #[inline(always)]
    fn prefetch_leaf(&self, block: usize) {
        if let Some(blocks) = self.blocks.get(block..block + self.shape.leaf_blocks) {
            blocks.iter().for_each(prefetch);
        }
    }
    #[inline(always)]
    fn leaf_bytes(&self) -> usize {
        self.blocks.len() * size_of::<PointBlock>()
    }
    #[inline(always)]
    fn ids(&self, block: usize) -> &Lanes<u32> {
        &self.blocks[block].id
    }
}

impl View for &StaticTree {
    const BALL: f32 = 0.18;

    #[inline(always)]
    fn shape(&self) -> &Shape {
        &self.shape
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> (S::F, Mask) {
        let Boxes { lo, hi } = &self.nodes[node];
        outside(s, &target.point, rows(s, lo), rows(s, hi))
    }
    #[inline(always)]
    fn box_sizes<S: Simd>(&self, s: S, _target: &Target<S>, node: usize) -> S::F {
        let Boxes { lo, hi } = &self.nodes[node];
        diagonal::<S>(rows(s, lo), rows(s, hi))
    }
    #[inline(always)]
    fn prefetch_node(&self, node: usize) {
        prefetch(&self.nodes[node]);
    }
}

impl CoordinateView for &StaticTree {
    #[inline(always)]
    fn faces<S: Simd>(&self, s: S, _target: &Target<S>, node: usize) -> ([S::F; 3], [S::F; 3]) {
        let Boxes { lo, hi } = &self.nodes[node];
        (rows(s, lo), rows(s, hi))
    }
    #[inline(always)]
    fn positions<S: Simd>(&self, s: S, _target: &Target<S>, block: usize) -> [S::F; 3] {
        rows(s, &self.blocks[block].at)
    }
}

impl BoxTree for StaticTree {
    fn shape(&self) -> &Shape {
        &self.shape
    }
    #[inline(always)]
    fn times(&self, node: usize) -> [Lanes<f32>; 2] {
        throughout(&self.nodes[node].lo[0])
    }
    #[inline(always)]
    fn faces(&self, node: usize, _phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        let Boxes { lo, hi } = &self.nodes[node];
        let mut faces = [[[0.0; LANES]; 3]; 2];
        for (faces, rows) in faces.iter_mut().zip([lo, hi]) {
            for (to, row) in faces.iter_mut().zip(rows) {
                for (to, &x) in to.iter_mut().zip(row) {
                    *to = f64::from(x);
                }
            }
        }
        faces
    }
    fn is_active(&self, _block: usize, _lane: usize, _time: f32) -> bool {
        true
    }
}

impl BlockTree for StaticTree {
    type Coordinate = f32;
    #[inline(always)]
    fn rows(&self, block: usize) -> PathRows<f32> {
        let block = &self.blocks[block];
        PathRows::new(&block.at, &block.at, &block.id, None)
    }
    fn has_active_intervals(&self) -> bool {
        false
    }
    fn timed(&self) -> bool {
        false
    }
    fn begins_at(&self, _time: f32) -> bool {
        false
    }
}
