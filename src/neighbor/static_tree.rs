//! The complete tree over points that stand still.
//!
//! The picture to have in mind: leaves of 16 or 32 points in a row, nodes of sixteen boxes above
//! them, and nothing else, no pointers and no time. Children of the j-th node of a level are the
//! nodes 16j to 16j + 15 of the level below. Which of the two leaf sizes is taken depends on which
//! fills the levels better.

use super::approach::{Boxed, Flight};
use super::order::{Item, include, order};
use super::view::{Boxes, MAX_LEVELS, Target, View, outside, rows, squared};
use crate::motion::TimeInterval;
use crate::simd::{LANES, Lanes, Simd, huge_vec_of, prefetch};
use glam::{DVec3, Vec3};

/// Sixteen points in rows; where there is none, the coordinates are infinite.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Block {
    at: [Lanes<f32>; 3],
    id: Lanes<u32>,
}

const EMPTY: Block = Block { at: [[f32::INFINITY; LANES]; 3], id: [u32::MAX; LANES] };

/// Points that stand still, in a complete 16-ary tree.
#[derive(Clone)]
pub(super) struct StaticTree {
    nodes: Vec<Boxes>,
    blocks: Vec<Block>,
    shape: Shape,
}

/// Sizes of a complete tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Blocks per leaf.
    pub(super) leaf_blocks: usize,
    /// Number of levels of nodes, at least one.
    pub(super) levels: usize,
    /// Number of the first node of each level; behind the last level, the number of nodes.
    pub(super) begin: [usize; MAX_LEVELS + 1],
}

impl Shape {
    /// The shape of the tree over `count` points: the leaf size that leaves fewer lanes empty near
    /// the root, with fewer levels first.
    pub(super) fn of(count: usize) -> Shape {
        let (one, two) = (Shape::with_leaf(count, 1), Shape::with_leaf(count, 2));
        if two.levels < one.levels { two } else { one }
    }

    /// The shape with a given number of blocks per leaf.
    pub(super) fn with_leaf(count: usize, leaf_blocks: usize) -> Shape {
        let mut shape = Shape { leaf_blocks, levels: 0, begin: [0; MAX_LEVELS + 1] };
        let mut wide = count.div_ceil(leaf_blocks * LANES).max(1);
        while shape.levels == 0 || wide > 1 {
            wide = wide.div_ceil(LANES);
            shape.begin[shape.levels + 1] = shape.begin[shape.levels] + wide;
            shape.levels += 1;
        }
        shape
    }

    /// Points per leaf.
    pub(super) fn leaf(&self) -> usize {
        self.leaf_blocks * LANES
    }

    /// Number of nodes.
    pub(super) fn nodes(&self) -> usize {
        self.begin[self.levels]
    }
}

impl StaticTree {
    /// Builds the tree. `id_of` turns an item's index into the id that answers carry.
    pub(super) fn build(mut items: Vec<Item>, id_of: impl Fn(u32) -> u32 + Sync) -> StaticTree {
        let shape = Shape::of(items.len());
        order(&mut items, shape.leaf());
        let mut blocks = huge_vec_of(EMPTY, items.len().div_ceil(shape.leaf()) * shape.leaf_blocks);
        let mut nodes = huge_vec_of(Boxes::NONE, shape.nodes());
        let share = LANES * shape.leaf_blocks;
        fill(&items, &mut blocks, &mut nodes[..shape.begin[1]], share, &id_of);
        for level in 1..shape.levels {
            let (below, here) = nodes.split_at_mut(shape.begin[level]);
            let below = &below[shape.begin[level - 1]..];
            for (node, children) in here.iter_mut().zip(below.chunks(LANES)) {
                for (lane, child) in children.iter().enumerate() {
                    let (lo, hi) = child.hull();
                    node.include(lane, lo, hi);
                }
            }
        }
        StaticTree { nodes, blocks, shape }
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Boxes>() + self.blocks.capacity() * size_of::<Block>()
    }

    /// Number of nodes.
    pub(super) fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// Number of levels of nodes.
    pub(super) fn levels(&self) -> usize {
        self.shape.levels
    }
}

/// Nodes that one thread fills at a time.
const SHARE: usize = 64;

/// Writes blocks and bottom nodes, `share` blocks to a node.
fn fill(items: &[Item], blocks: &mut [Block], nodes: &mut [Boxes], share: usize, id_of: &(impl Fn(u32) -> u32 + Sync)) {
    if nodes.len() > SHARE {
        let half = nodes.len() / 2;
        let (nodes, more_nodes) = nodes.split_at_mut(half);
        let (blocks, more_blocks) = blocks.split_at_mut((half * share).min(blocks.len()));
        let (items, more_items) = items.split_at(half * share * LANES);
        return super::order::join(
            || fill(items, blocks, nodes, share, id_of),
            || fill(more_items, more_blocks, more_nodes, share, id_of),
        );
    }
    let leaf_blocks = share / LANES;
    for (number, (block, items)) in blocks.iter_mut().zip(items.chunks(LANES)).enumerate() {
        for (lane, item) in items.iter().enumerate() {
            for axis in 0..3 {
                block.at[axis][lane] = item.at[axis];
            }
            block.id[lane] = id_of(item.index);
        }
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for item in items {
            include(&mut lo, &mut hi, item.at);
        }
        nodes[number / share].include(number % share / leaf_blocks, lo, hi);
    }
}

impl View for &StaticTree {
    #[inline(always)]
    fn root(&self) -> (usize, usize) {
        (self.shape.levels - 1, self.nodes.len() - 1)
    }
    #[inline(always)]
    fn first_child(&self, level: usize, node: usize) -> usize {
        self.shape.begin[level - 1] + (node - self.shape.begin[level]) * LANES
    }
    #[inline(always)]
    fn first_block(&self, node: usize) -> usize {
        node * LANES * self.shape.leaf_blocks
    }
    #[inline(always)]
    fn leaf_blocks(&self) -> usize {
        self.shape.leaf_blocks
    }
    #[inline(always)]
    fn target<S: Simd>(&self, s: S, q: Vec3) -> Target<S> {
        Target::still(s, q)
    }
    #[inline(always)]
    fn box_distances<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> S::F {
        let node = &self.nodes[node];
        outside(s, &target.point, rows(s, &node.lo), rows(s, &node.hi))
    }
    #[inline(always)]
    fn point_distances<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> S::F {
        let [x, y, z] = rows(s, &self.blocks[block].at);
        squared::<S>(x - target.point[0], y - target.point[1], z - target.point[2])
    }
    #[inline(always)]
    fn expect_node(&self, node: usize) {
        prefetch(&self.nodes[node]);
    }
    #[inline(always)]
    fn expect_leaf(&self, block: usize) {
        if let Some(blocks) = self.blocks.get(block..block + self.shape.leaf_blocks) {
            blocks.iter().for_each(prefetch);
        }
    }
    #[inline(always)]
    fn ids(&self, block: usize) -> &Lanes<u32> {
        &self.blocks[block].id
    }
}

impl Boxed for StaticTree {
    fn part(&self) -> (usize, usize, [f64; 2]) {
        (1, 0, [0.0, 1.0])
    }
    fn top(&self) -> (usize, usize) {
        View::root(&self)
    }
    fn behind(&self, level: usize, node: usize) -> (usize, usize) {
        if level == 0 { (self.first_block(node), self.shape.leaf_blocks) } else { (self.first_child(level, node), 1) }
    }
    fn times(&self, node: usize, lane: usize) -> Option<[f64; 2]> {
        let node = &self.nodes[node];
        (node.lo[0][lane] <= node.hi[0][lane]).then_some([0.0, 1.0])
    }
    fn corners(&self, node: usize, lane: usize, _phase: f64) -> [DVec3; 2] {
        let node = &self.nodes[node];
        [node.lo, node.hi].map(|rows| Vec3::from_array(rows.map(|row| row[lane])).as_dvec3())
    }
    fn flight(&self, block: usize, lane: usize) -> Option<Flight> {
        let block = &self.blocks[block];
        let at = block.at.map(|row| row[lane]);
        let id = block.id[lane];
        (id != u32::MAX).then_some(Flight { id, open: at, close: at, life: TimeInterval::FULL })
    }
}
