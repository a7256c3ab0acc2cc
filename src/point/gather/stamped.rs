//! Photons with a time stamp: a tree over space and time, looked at through a window or through a metric.
//!
//! The searches of this crate ask a [`View`] for squared distances to boxes and points. Here there are two of them:
//! through a *window* what lies outside is infinitely far away and the rest as far as it is in space; through a
//! *metric* the time difference, multiplied by a speed, is a fourth coordinate. Both are monotone in each coordinate
//! after rounding, so a box is never farther than what is in it (the proof in [`View`]'s module holds word for word).

use super::span_tree::{Span, SpanBlock, SpanTree, around};
use crate::point::snapshot::{Leaves, Target, View, diagonal, outside, rows, squared};
use crate::simd::{LANES, Lanes, Mask, Simd, prefetch};
use glam::Vec3;

/// Sixteen photons in rows.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct StampedBlock {
    at: [Lanes<f32>; 3],
    time: Lanes<f32>,
    place: Lanes<u32>,
}

impl StampedBlock {
    /// Writes a lane.
    pub(super) fn set(&mut self, lane: usize, at: Vec3, time: f32, place: u32) {
        for axis in 0..3 {
            self.at[axis][lane] = at[axis];
        }
        (self.time[lane], self.place[lane]) = (time, place);
    }
}

impl SpanBlock for StampedBlock {
    const EMPTY: StampedBlock =
        StampedBlock { at: [[f32::INFINITY; LANES]; 3], time: [f32::MAX; LANES], place: [u32::MAX; LANES] };

    fn span(&self) -> Span {
        around((0..LANES).filter(|&lane| self.place[lane] != u32::MAX).map(|lane| {
            let at = [self.at[0][lane], self.at[1][lane], self.at[2][lane], self.time[lane]];
            [at, at]
        }))
    }
}

/// Photons with time stamps.
pub(super) type StampedTree = SpanTree<StampedBlock>;

impl StampedTree {
    /// Where the photon at a place is.
    pub(super) fn position(&self, place: u32) -> Vec3 {
        let (block, lane) = (&self.blocks()[place as usize / LANES], place as usize % LANES);
        Vec3::new(block.at[0][lane], block.at[1][lane], block.at[2][lane])
    }

    /// The time stamp of the photon at a place.
    #[inline(always)]
    pub(super) fn stamp(&self, place: u32) -> f32 {
        self.blocks()[place as usize / LANES].time[place as usize % LANES]
    }
}

/// The tree through a window, or with `METRIC` through a metric of space and time.
#[derive(Clone, Copy)]
pub(super) struct StampedView<'a, const METRIC: bool> {
    tree: &'a StampedTree,
    time: f32,
    /// Half width of the window, or the metric's speed.
    scale: f32,
}

impl<'a, const METRIC: bool> StampedView<'a, METRIC> {
    /// What was stamped within `scale` of a time; through a metric everything, a time difference being as long as the
    /// way at the speed `scale` in it.
    #[inline(always)]
    pub(super) fn new(tree: &'a StampedTree, time: f32, scale: f32) -> Self {
        StampedView { tree, time, scale }
    }
}

impl<const METRIC: bool> StampedView<'_, METRIC> {
    /// Squared distances in space, and what the difference in time makes of them.
    #[inline(always)]
    fn far<S: Simd>(&self, s: S, in_space: S::F, in_time: S::F) -> S::F {
        let scale = s.splat(self.scale);
        if METRIC {
            let way = in_time * scale;
            in_space + way * way
        } else {
            s.select(s.le(in_time, scale), in_space, s.splat(f32::INFINITY))
        }
    }
}

impl<const METRIC: bool> Leaves for StampedView<'_, METRIC> {
    #[inline(always)]
    fn leaf_blocks(&self) -> usize {
        1
    }
    #[inline(always)]
    fn target<S: Simd>(&self, s: S, q: Vec3) -> Target<S> {
        Target { time: s.splat(self.time), ..Target::still(s, q) }
    }
    #[inline(always)]
    fn point_distances<S: Simd>(&self, s: S, target: &Target<S>, block: usize) -> S::F {
        let block = &self.tree.blocks()[block];
        let [x, y, z] = rows(s, &block.at);
        let in_space = squared::<S>(x - target.point[0], y - target.point[1], z - target.point[2]);
        let time = s.load(&block.time);
        self.far(s, in_space, s.max(time - target.time, target.time - time))
    }
    #[inline(always)]
    fn expect_leaf(&self, block: usize) {
        if let Some(block) = self.tree.blocks().get(block) {
            prefetch(block);
        }
    }
    #[inline(always)]
    fn leaf_bytes(&self) -> usize {
        size_of_val(self.tree.blocks())
    }
    #[inline(always)]
    fn ids(&self, block: usize) -> &Lanes<u32> {
        &self.tree.blocks()[block].place
    }
}

impl<const METRIC: bool> View for StampedView<'_, METRIC> {
    const BALL: f32 = 0.18;

    #[inline(always)]
    fn root(&self) -> (usize, usize) {
        self.tree.root()
    }
    #[inline(always)]
    fn first_child(&self, level: usize, node: usize) -> usize {
        self.tree.first_child(level, node)
    }
    #[inline(always)]
    fn first_block(&self, node: usize) -> usize {
        node * LANES
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> (S::F, Mask) {
        let node = self.tree.node(node);
        let (lo, hi) = (s.load(&node.lo[3]), s.load(&node.hi[3]));
        let ([lx, ly, lz, _], [hx, hy, hz, _]) = (&node.lo, &node.hi);
        let (lo_at, hi_at) = ([s.load(lx), s.load(ly), s.load(lz)], [s.load(hx), s.load(hy), s.load(hz)]);
        let (in_space, holding) = outside(s, &target.point, lo_at, hi_at);
        let in_time = s.max_with_zero(lo - target.time, target.time - hi);
        let near = if METRIC { s.splat(0.0) } else { s.splat(self.scale) };
        (self.far(s, in_space, in_time), holding & s.le(in_time, near))
    }
    /// Through a window only a part of a leaf is there, and a ball has to be larger to hold as many.
    #[inline(always)]
    fn box_sizes<S: Simd>(&self, s: S, target: &Target<S>, node: usize) -> S::F {
        let node = self.tree.node(node);
        let (lo, hi) = (s.load(&node.lo[3]), s.load(&node.hi[3]));
        let ([lx, ly, lz, _], [hx, hy, hz, _]) = (&node.lo, &node.hi);
        let size = diagonal::<S>([s.load(lx), s.load(ly), s.load(lz)], [s.load(hx), s.load(hy), s.load(hz)]);
        let (length, scale) = (hi - lo, s.splat(self.scale));
        if METRIC {
            let way = length * scale;
            return size + way * way;
        }
        let seen = s.min(hi, target.time + scale) - s.max(lo, target.time - scale);
        let least = length * s.splat(1.0 / LANES as f32) + s.splat(f32::MIN_POSITIVE);
        size * ((length + s.splat(f32::MIN_POSITIVE)) / s.max(seen, least))
    }
    #[inline(always)]
    fn expect_node(&self, node: usize) {
        prefetch(self.tree.node(node));
    }
}
