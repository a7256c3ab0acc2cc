//! The complete tree over boxes in space and time.
//!
//! Sixteen items in a block, sixteen blocks below a bottom node, sixteen nodes below each node above; no pointers. A
//! node has the boxes of its children in x, y, z and time. The contents of a block, and so its box, are generic
//! ([`SpanBlock`]): points with a time stamp, or balls of visible points. Boxes can be refitted when the contents of the
//! blocks have changed.

use super::span_order::{Item, Queries, order};
use crate::parallel;
use crate::point::layout::shape::Shape;
use crate::progress::Progress;
use crate::simd::{LANES, Lanes, Simd, huge_vec_of};

/// A box in space and time: lower and upper ends in x, y, z, time.
pub(super) type Span = [[f32; 4]; 2];

/// A block of sixteen items.
pub(super) trait SpanBlock: Copy + Send + Sync {
    /// A block without items.
    const EMPTY: Self;
    /// The box around its items.
    fn span(&self) -> Span;
    /// The ids of its items in answers.
    fn ids(&self) -> &Lanes<u32>;
}

/// Sixteen boxes in rows. Absent boxes have lower ends above the upper ones; their times are finite, so that products
/// with 0 are finite too.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct SpanNode {
    lo: [Lanes<f32>; 4],
    hi: [Lanes<f32>; 4],
}

/// The empty box.
const NOTHING: Span = [
    [f32::INFINITY, f32::INFINITY, f32::INFINITY, f32::MAX],
    [f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY, -f32::MAX],
];

impl SpanNode {
    const NONE: SpanNode = SpanNode {
        lo: [[NOTHING[0][0]; LANES], [NOTHING[0][1]; LANES], [NOTHING[0][2]; LANES], [NOTHING[0][3]; LANES]],
        hi: [[NOTHING[1][0]; LANES], [NOTHING[1][1]; LANES], [NOTHING[1][2]; LANES], [NOTHING[1][3]; LANES]],
    };

    fn set(&mut self, lane: usize, span: &Span) {
        for (rows, ends) in [(&mut self.lo, span[0]), (&mut self.hi, span[1])] {
            for (row, end) in rows.iter_mut().zip(ends) {
                row[lane] = end;
            }
        }
    }

    /// Lower and upper ends in space.
    #[inline(always)]
    pub(super) fn in_space<S: Simd>(&self, s: S) -> ([S::F; 3], [S::F; 3]) {
        let ([lx, ly, lz, _], [hx, hy, hz, _]) = (&self.lo, &self.hi);
        ([s.load(lx), s.load(ly), s.load(lz)], [s.load(hx), s.load(hy), s.load(hz)])
    }

    /// First and last times.
    #[inline(always)]
    pub(super) fn in_time<S: Simd>(&self, s: S) -> (S::F, S::F) {
        (s.load(&self.lo[3]), s.load(&self.hi[3]))
    }

    fn span(&self) -> Span {
        (0..LANES).fold(NOTHING, |all, lane| {
            let of = |rows: &[Lanes<f32>; 4]| core::array::from_fn(|axis| rows[axis][lane]);
            join(&all, &[of(&self.lo), of(&self.hi)])
        })
    }
}

/// The box around two.
pub(super) fn join(a: &Span, b: &Span) -> Span {
    let least = core::array::from_fn(|axis| a[0][axis].min(b[0][axis]));
    [least, core::array::from_fn(|axis| a[1][axis].max(b[1][axis]))]
}

/// The box around some lanes of a block, each given as a box.
pub(super) fn around(lanes: impl Iterator<Item = Span>) -> Span {
    lanes.fold(NOTHING, |all, lane| join(&all, &lane))
}

/// Blocks in a complete tree.
#[derive(Clone)]
pub(super) struct SpanTree<B> {
    pub(super) nodes: Vec<SpanNode>,
    pub(super) blocks: Vec<B>,
    pub(super) shape: Shape,
    /// Number of items.
    pub(super) count: usize,
}

/// Number of bottom nodes that one thread fits at a time.
const SHARE: usize = 32;

/// The fractions of building a tree that ordering takes, about, and filling its blocks.
const ORDERING: f64 = 0.7;
const FILLING: f64 = 0.2;

impl<B: SpanBlock> SpanTree<B> {
    /// Orders items and builds the tree. `put` writes an item into a lane of a block; items get
    /// slots in the order of the tree: sixteen times the index of the block, plus the lane.
    pub(super) fn build(
        items: &mut [Item],
        queries: &Queries,
        progress: &Progress,
        put: impl Fn(&mut B, usize, &Item, u32) + Sync,
    ) -> Self {
        order(items, queries, &progress.subtask(ORDERING));
        let shape = Shape::with_leaf(items.len(), 1);
        let mut blocks = huge_vec_of(B::EMPTY, items.len().div_ceil(LANES));
        let mut work: Vec<(usize, &mut [B])> = blocks.chunks_mut(SHARE * LANES).enumerate().collect();
        let (filling, shares) = (progress.subtask(FILLING), work.len() as f64);
        parallel::each(&mut work, |(share, blocks)| {
            filling.finished(1.0 / shares);
            let items = &items[*share * SHARE * LANES * LANES..];
            for (i, (block, items)) in blocks.iter_mut().zip(items.chunks(LANES)).enumerate() {
                for (lane, item) in items.iter().enumerate() {
                    let slot = ((*share * SHARE * LANES + i) * LANES + lane) as u32;
                    put(block, lane, item, slot);
                }
            }
        });
        let nodes = huge_vec_of(SpanNode::NONE, shape.nodes());
        let mut tree = SpanTree { nodes, blocks, shape, count: items.len() };
        tree.change(|_| ());
        tree
    }

    /// Changes blocks, and fits the boxes to them: O(n), without reordering.
    pub(super) fn change(&mut self, change: impl Fn(&mut B) + Sync) {
        let SpanTree { nodes, blocks, shape, .. } = self;
        let bottom = &mut nodes[..shape.begin[1]];
        let mut work: Vec<(&mut [SpanNode], &mut [B])> =
            bottom.chunks_mut(SHARE).zip(blocks.chunks_mut(SHARE * LANES)).collect();
        parallel::each(&mut work, |(nodes, blocks)| {
            for (node, blocks) in nodes.iter_mut().zip(blocks.chunks_mut(LANES)) {
                for (lane, block) in blocks.iter_mut().enumerate() {
                    change(block);
                    node.set(lane, &block.span());
                }
            }
        });
        for level in 1..shape.levels {
            let (below, above) = nodes.split_at_mut(shape.begin[level]);
            let children = &below[shape.begin[level - 1]..];
            for (node, children) in above.iter_mut().zip(children.chunks(LANES)) {
                for (lane, child) in children.iter().enumerate() {
                    node.set(lane, &child.span());
                }
            }
        }
    }

    /// The box around all items; reversed if there are none.
    pub(super) fn span(&self) -> Span {
        self.nodes.last().map_or(NOTHING, SpanNode::span)
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<SpanNode>() + self.blocks.capacity() * size_of::<B>()
    }
}
