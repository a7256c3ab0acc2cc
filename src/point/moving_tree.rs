//! The tree over points that move or live for a while, for one part of the shutter.
//!
//! The same pyramid as the static tree, but faces of boxes are lines in time, points are interpolated
//! from two keys, and where references have intervals (lives, or pieces of a way that was cut), nodes
//! and leaves carry them. All leaves are on one level and hold at most sixteen references; nodes say
//! where their first child is, because cutting leaves subtrees unevenly full.

use super::linear_bounds::{Hull, LinearBoxes, Span};
use super::moving_reference::{Mover, Part, phase};
use super::order::{Item, join, order_with_time};
use super::over_interval::{Boxed, Flight};
use super::snapshot::{Placed, Target, View, diagonal, outside, rows, squared};
use super::static_tree::Shape;
use crate::geometry::{KeyTime, TimeInterval};
use crate::simd::{LANES, Lanes, Mask, Simd, huge_vec_of, prefetch};
use glam::Vec3;

/// Sixteen moving points in rows; absent ones stand where every squared distance is infinite.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Block {
    open: [Lanes<f32>; 3],
    close: [Lanes<f32>; 3],
    id: Lanes<u32>,
}

const EMPTY: Block = Block { open: [[f32::MAX; LANES]; 3], close: [[f32::MAX; LANES]; 3], id: [u32::MAX; LANES] };

/// When each of sixteen lanes counts: `begin <= t < end`.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Times {
    pub(super) begin: Lanes<f32>,
    pub(super) end: Lanes<f32>,
}

pub(super) const NEVER: Times = Times { begin: [f32::INFINITY; LANES], end: [f32::NEG_INFINITY; LANES] };

/// Points that move or live for a while, in a 16-ary tree for one part of the shutter.
#[derive(Clone)]
pub(super) struct MovingTree {
    part: Part,
    nodes: Vec<LinearBoxes>,
    /// Number of each node's first child (node, or block on level 0).
    first: Vec<u32>,
    blocks: Vec<Block>,
    /// Times of nodes and blocks; empty where everything counts throughout.
    node_times: Vec<Times>,
    block_times: Vec<Times>,
    /// Whole lives of the points in the blocks; empty where all live throughout.
    lives: Vec<Times>,
    levels: usize,
    references: usize,
}

/// A tree in the making, each level on its own, leaves in the order in which they come.
pub(super) struct Assembly {
    levels: Vec<Level>,
    blocks: Vec<Block>,
    block_times: Vec<Times>,
    lives: Vec<Times>,
    references: usize,
}

#[derive(Default)]
struct Level {
    nodes: Vec<LinearBoxes>,
    times: Vec<Times>,
    first: Vec<u32>,
}

impl Assembly {
    /// An empty tree of `levels` levels.
    pub(super) fn new(levels: usize) -> Assembly {
        let levels = (0..levels).map(|_| Level::default()).collect();
        Assembly { levels, blocks: Vec::new(), block_times: Vec::new(), lives: Vec::new(), references: 0 }
    }

    /// Number of the next node of a level, or of the next block for the level below 0.
    pub(super) fn next(&self, level: Option<usize>) -> u32 {
        level.map_or(self.blocks.len(), |level| self.levels[level].nodes.len()) as u32
    }

    /// Adds a leaf of at most sixteen references.
    pub(super) fn leaf(&mut self, part: &Part, movers: &[Mover]) -> Hull {
        let (mut block, mut times) = (EMPTY, NEVER);
        self.references += movers.len();
        let hull = fill(&mut block, &mut times, part, movers.iter());
        self.blocks.push(block);
        self.block_times.push(times);
        self.lives.push(lives(movers.iter()));
        hull
    }

    /// Adds a node above children that are on the level below already, beginning with `first`.
    pub(super) fn node(&mut self, level: usize, first: u32, children: &[Hull]) -> Hull {
        let (mut node, mut times) = (LinearBoxes::NONE, NEVER);
        set(&mut node, &mut times, children);
        let level = &mut self.levels[level];
        level.nodes.push(node);
        level.times.push(times);
        level.first.push(first);
        Hull::of_hulls(children)
    }

    /// The finished tree.
    pub(super) fn finish(self, part: Part, timed: bool, mortal: bool) -> MovingTree {
        let levels = self.levels.len();
        let (mut nodes, mut first, mut node_times) = (Vec::new(), Vec::new(), Vec::new());
        let mut below = 0;
        for (number, level) in self.levels.into_iter().enumerate() {
            let here = nodes.len() as u32;
            first.extend(level.first.iter().map(|&f| if number == 0 { f } else { f + below }));
            nodes.extend(level.nodes);
            if timed {
                node_times.extend(level.times);
            }
            below = here;
        }
        let block_times = if timed { self.block_times } else { Vec::new() };
        let lives = if mortal { self.lives } else { Vec::new() };
        let (blocks, references) = (self.blocks, self.references);
        MovingTree { part, nodes, first, blocks, node_times, block_times, lives, levels, references }
    }
}

/// Writes the rows of a block and returns its hull.
fn fill<'a>(block: &mut Block, times: &mut Times, part: &Part, movers: impl Iterator<Item = &'a Mover>) -> Hull {
    let mut spans = [Span::default(); LANES];
    let mut count = 0;
    for (lane, mover) in movers.enumerate() {
        for axis in 0..3 {
            block.open[axis][lane] = mover.open[axis];
            block.close[axis][lane] = mover.close[axis];
        }
        block.id[lane] = mover.id;
        spans[lane] = mover.span(part);
        [times.begin[lane], times.end[lane]] = spans[lane].times;
        count += 1;
    }
    Hull::of_points(&spans[..count])
}

/// The rows of whole lives of a block.
fn lives<'a>(movers: impl Iterator<Item = &'a Mover>) -> Times {
    let mut times = NEVER;
    for (lane, mover) in movers.enumerate() {
        (times.begin[lane], times.end[lane]) = (mover.life.begin(), mover.life.end_bound());
    }
    times
}

/// Writes the rows of a node.
fn set(node: &mut LinearBoxes, times: &mut Times, children: &[Hull]) {
    for (lane, child) in children.iter().enumerate() {
        node.set(lane, child);
        [times.begin[lane], times.end[lane]] = child.times;
    }
}

impl MovingTree {
    /// The complete tree without any cut: each mover is in one leaf. The uppermost `time_levels` binary
    /// levels separate by the middle of life instead of by place.
    pub(super) fn complete(movers: &[Mover], part: Part, time_levels: usize) -> MovingTree {
        let phase = f64::from(part.phase(part.middle()));
        let place = |(index, mover): (usize, &Mover)| Item {
            at: core::array::from_fn(|axis| mover.at(axis, phase) as f32),
            index: index as u32,
        };
        let mut items: Vec<Item> = movers.iter().enumerate().map(place).collect();
        let life = |i: &Item| {
            let alive = movers[i.index as usize].alive;
            alive.begin() + alive.end_bound()
        };
        order_with_time(&mut items, LANES, time_levels, &life);
        let timed = movers.iter().any(|m| m.alive != part.interval);
        let shape = Shape::with_leaf(movers.len(), 1);
        let count = movers.len().div_ceil(LANES);
        let mut blocks = huge_vec_of(EMPTY, count);
        let mut block_times = vec![NEVER; if timed { count } else { 0 }];
        let mut hulls: Vec<Option<Hull>> = vec![None; count];
        let job = Fill { movers, part: &part };
        job.blocks(&items, &mut blocks, &mut block_times, &mut hulls);
        let mortal = movers.iter().any(|m| m.life != TimeInterval::FULL);
        let of_block = |items: &[Item]| lives(items.iter().map(|item| &movers[item.index as usize]));
        let lives = if mortal { items.chunks(LANES).map(of_block).collect() } else { Vec::new() };
        drop(items);
        let mut nodes = huge_vec_of(LinearBoxes::NONE, shape.nodes());
        let mut node_times = vec![NEVER; if timed { shape.nodes() } else { 0 }];
        let mut first = Vec::with_capacity(shape.nodes());
        let mut hulls: Vec<Hull> = hulls.into_iter().flatten().collect();
        for level in 0..shape.levels {
            let begin = shape.begin[level];
            let below = if level == 0 { 0 } else { shape.begin[level - 1] };
            let mut above = Vec::with_capacity(hulls.len().div_ceil(LANES));
            // Even a tree without references has its root.
            for i in 0..shape.begin[level + 1] - begin {
                let children = &hulls[(i * LANES).min(hulls.len())..((i + 1) * LANES).min(hulls.len())];
                let mut times = NEVER;
                set(&mut nodes[begin + i], &mut times, children);
                if timed {
                    node_times[begin + i] = times;
                }
                first.push((below + i * LANES) as u32);
                above.push(Hull::of_hulls(children));
            }
            hulls = above;
        }
        MovingTree {
            part,
            nodes,
            first,
            blocks,
            node_times,
            block_times,
            lives,
            levels: shape.levels,
            references: movers.len(),
        }
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<LinearBoxes>()
            + self.blocks.capacity() * size_of::<Block>()
            + (self.node_times.capacity() + self.block_times.capacity() + self.lives.capacity()) * size_of::<Times>()
            + self.first.capacity() * size_of::<u32>()
    }

    /// Number of references.
    pub(super) fn references(&self) -> usize {
        self.references
    }

    /// Number of nodes.
    pub(super) fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// Number of levels of nodes.
    pub(super) fn levels(&self) -> usize {
        self.levels
    }

    /// Whether references have intervals.
    pub(super) fn timed(&self) -> bool {
        !self.node_times.is_empty()
    }

    /// The part of the shutter it answers for.
    pub(super) fn part(&self) -> &Part {
        &self.part
    }

    /// The tree at a time, which lies in its part.
    #[inline(always)]
    pub(super) fn at<const TIMED: bool>(&self, time: f32) -> MovingView<'_, TIMED> {
        let at = KeyTime::new(time, self.part.keys);
        MovingView { tree: self, at, phase: phase(at, self.part.segment), time }
    }
}

/// What filling blocks needs to know.
#[derive(Clone, Copy)]
struct Fill<'a> {
    movers: &'a [Mover],
    part: &'a Part,
}

impl Fill<'_> {
    /// Fills blocks from ordered items, halves in parallel.
    fn blocks(self, items: &[Item], blocks: &mut [Block], times: &mut [Times], hulls: &mut [Option<Hull>]) {
        if blocks.len() > 1024 {
            let half = blocks.len() / 2;
            let (items, more_items) = items.split_at(half * LANES);
            let (blocks, more_blocks) = blocks.split_at_mut(half);
            let (times, more_times) = times.split_at_mut(half.min(times.len()));
            let (hulls, more_hulls) = hulls.split_at_mut(half);
            return join(
                || self.blocks(items, blocks, times, hulls),
                || self.blocks(more_items, more_blocks, more_times, more_hulls),
            );
        }
        for (i, (items, block)) in items.chunks(LANES).zip(blocks).enumerate() {
            let mut unused = NEVER;
            let times = times.get_mut(i).unwrap_or(&mut unused);
            let movers = items.iter().map(|item| &self.movers[item.index as usize]);
            hulls[i] = Some(fill(block, times, self.part, movers));
        }
    }
}

/// A moving tree at a time.
#[derive(Clone, Copy)]
pub(super) struct MovingView<'a, const TIMED: bool> {
    tree: &'a MovingTree,
    at: KeyTime,
    phase: f32,
    time: f32,
}

/// Lanes that count at the time.
#[inline(always)]
pub(super) fn counting<S: Simd>(s: S, times: &Times, time: S::F) -> Mask {
    s.le(s.load(&times.begin), time) & s.lt(time, s.load(&times.end))
}

/// Three rows of lines at a phase.
#[inline(always)]
fn line<S: Simd>(s: S, at: &[Lanes<f32>; 3], slope: &[Lanes<f32>; 3], phase: S::F) -> [S::F; 3] {
    let ([x, y, z], [by_x, by_y, by_z]) = (rows(s, at), rows(s, slope));
    [x + by_x * phase, y + by_y * phase, z + by_z * phase]
}

impl<const TIMED: bool> MovingView<'_, TIMED> {
    /// Where the points of a block are, whether they count at this time or not.
    #[inline(always)]
    fn interpolated<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> [S::F; 3] {
        let Block { open, close, .. } = &self.tree.blocks[block];
        let base = rows(s, if self.at.from_end { close } else { open });
        let ([ax, ay, az], [bx, by, bz]) = (rows(s, open), rows(s, close));
        [base[0] + (bx - ax) * target.step, base[1] + (by - ay) * target.step, base[2] + (bz - az) * target.step]
    }
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
    fn leaf_blocks(&self) -> usize {
        1
    }
    #[inline(always)]
    fn target<S: Simd>(&self, s: S, q: Vec3) -> Target<S> {
        let point = [s.splat(q.x), s.splat(q.y), s.splat(q.z)];
        Target { point, step: s.splat(self.at.s), phase: s.splat(self.phase), time: s.splat(self.time) }
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> (S::F, Mask) {
        let boxes = &self.tree.nodes[node];
        // Not fused: then every instruction set visits the same nodes, and approximate answers agree too.
        let lo = line(s, &boxes.lo, &boxes.lo_slope, target.phase);
        let hi = line(s, &boxes.hi, &boxes.hi_slope, target.phase);
        let (distances, holding) = outside(s, &target.point, lo, hi);
        if !TIMED {
            return (distances, holding);
        }
        let counting = counting(s, &self.tree.node_times[node], target.time);
        (s.select(counting, distances, s.splat(f32::INFINITY)), holding & counting)
    }
    #[inline(always)]
    fn box_sizes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> S::F {
        let boxes = &self.tree.nodes[node];
        let lo = line(s, &boxes.lo, &boxes.lo_slope, target.phase);
        diagonal::<S>(lo, line(s, &boxes.hi, &boxes.hi_slope, target.phase))
    }
    #[inline(always)]
    fn point_distances<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> S::F {
        let [x, y, z] = self.interpolated(s, target, block);
        let distances = squared::<S>(x - target.point[0], y - target.point[1], z - target.point[2]);
        if !TIMED {
            return distances;
        }
        let counting = counting(s, &self.tree.block_times[block], target.time);
        s.select(counting, distances, s.splat(f32::INFINITY))
    }
    #[inline(always)]
    fn expect_node(&self, node: usize) {
        prefetch(&self.tree.nodes[node]);
    }
    #[inline(always)]
    fn expect_leaf(&self, block: usize) {
        if let Some(block) = self.tree.blocks.get(block) {
            prefetch(block);
        }
    }
    #[inline(always)]
    fn leaf_bytes(&self) -> usize {
        self.tree.blocks.len() * size_of::<Block>()
    }
    #[inline(always)]
    fn ids(&self, block: usize) -> &Lanes<u32> {
        &self.tree.blocks[block].id
    }
}

impl<const TIMED: bool> Placed for MovingView<'_, TIMED> {
    #[inline(always)]
    fn faces<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> ([S::F; 3], [S::F; 3]) {
        let boxes = &self.tree.nodes[node];
        let mut lo = line(s, &boxes.lo, &boxes.lo_slope, target.phase);
        let hi = line(s, &boxes.hi, &boxes.hi_slope, target.phase);
        if TIMED {
            let counting = counting(s, &self.tree.node_times[node], target.time);
            lo[0] = s.select(counting, lo[0], s.splat(f32::INFINITY));
        }
        (lo, hi)
    }
    #[inline(always)]
    fn positions<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> [S::F; 3] {
        let mut at = self.interpolated(s, target, block);
        if TIMED {
            let counting = counting(s, &self.tree.block_times[block], target.time);
            at[0] = s.select(counting, at[0], s.splat(f32::INFINITY));
        }
        at
    }
}

impl Boxed for MovingTree {
    fn part(&self) -> (usize, usize, [f64; 2]) {
        let times = [self.part.interval.begin(), self.part.interval.end()];
        (self.part.keys, self.part.segment, times.map(f64::from))
    }
    fn top(&self) -> (usize, usize) {
        (self.levels - 1, self.nodes.len() - 1)
    }
    fn behind(&self, _level: usize, node: usize) -> (usize, usize) {
        (self.first[node] as usize, 1)
    }
    #[inline(always)]
    fn times(&self, node: usize) -> [Lanes<f64>; 2] {
        if let Some(times) = self.node_times.get(node) {
            return [times.begin.map(f64::from), times.end.map(f64::from)];
        }
        [self.nodes[node].lo[0].map(|x| if x < f32::INFINITY { 0.0 } else { f64::INFINITY }), [1.0; LANES]]
    }
    #[inline(always)]
    fn faces(&self, node: usize, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        self.nodes[node].faces(phase)
    }
    fn counts(&self, block: usize, lane: usize, time: f32) -> bool {
        self.block_times.get(block).is_none_or(|times| times.begin[lane] <= time && time < times.end[lane])
    }
    fn flight(&self, block: usize, lane: usize) -> Option<Flight> {
        let rows = &self.blocks[block];
        let life = self.lives.get(block).map(|t| TimeInterval::half_open(t.begin[lane], t.end[lane]));
        let life = life.unwrap_or(Some(TimeInterval::FULL))?;
        let [open, close] = [rows.open, rows.close].map(|rows| rows.map(|row| f64::from(row[lane])));
        (rows.id[lane] != u32::MAX).then_some(Flight { id: rows.id[lane], open, close, life })
    }
}
