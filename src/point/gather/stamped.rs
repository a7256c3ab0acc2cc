//! Photons with a time stamp: a tree over space and time, searched with a window or with a metric.
//!
//! The searches of this crate need squared distances to boxes and points. There are two measures:
//! with a *window*, photons outside of it are infinitely far away and the others have their distance in space; with a
//! *metric* the time difference, multiplied by a speed, is a fourth coordinate. Both are monotone in each coordinate
//! after rounding, so a box is never farther than its photons (the proof in [`crate::point::layout::view`] applies unchanged).

use super::span_tree::{Span, SpanBlock, SpanNode, SpanTree, around};
use super::span_view::{Measure, SpanView};
use crate::point::layout::view::{Target, outside, rows, squared};
use crate::simd::{LANES, Lanes, Mask, Simd};
use glam::Vec3;

/// Sixteen photons in rows.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct StampedBlock {
    at: [Lanes<f32>; 3],
    time: Lanes<f32>,
    slot: Lanes<u32>,
}

impl StampedBlock {
    /// Writes a lane.
    pub(super) fn set(&mut self, lane: usize, at: Vec3, time: f32, slot: u32) {
        for axis in 0..3 {
            self.at[axis][lane] = at[axis];
        }
        (self.time[lane], self.slot[lane]) = (time, slot);
    }
}

impl SpanBlock for StampedBlock {
    const EMPTY: StampedBlock =
        StampedBlock { at: [[f32::INFINITY; LANES]; 3], time: [f32::MAX; LANES], slot: [u32::MAX; LANES] };

    fn span(&self) -> Span {
        around((0..LANES).filter(|&lane| self.slot[lane] != u32::MAX).map(|lane| {
            let at = [self.at[0][lane], self.at[1][lane], self.at[2][lane], self.time[lane]];
            [at, at]
        }))
    }

    #[inline(always)]
    fn ids(&self) -> &Lanes<u32> {
        &self.slot
    }
}

/// Photons with time stamps.
pub(super) type StampedTree = SpanTree<StampedBlock>;

impl StampedTree {
    /// The position of the photon at a slot.
    pub(super) fn position(&self, slot: u32) -> Vec3 {
        let (block, lane) = (&self.blocks[slot as usize / LANES], slot as usize % LANES);
        Vec3::new(block.at[0][lane], block.at[1][lane], block.at[2][lane])
    }

    /// The time stamp of the photon at a slot.
    #[inline(always)]
    pub(super) fn stamp(&self, slot: u32) -> f32 {
        self.blocks[slot as usize / LANES].time[slot as usize % LANES]
    }
}

/// The tree with a window, or with `METRIC` with a metric of space and time.
pub(super) type StampedView<'a, const METRIC: bool> = SpanView<'a, StampedBlock, Scale<METRIC>>;

/// Half the width of the window: photons stamped within it of the time count. With `METRIC` the speed of the metric:
/// all photons count, and a time difference is as long as the distance covered in it at that speed.
#[derive(Clone, Copy)]
pub(super) struct Scale<const METRIC: bool>(pub(super) f32);

impl<const METRIC: bool> Scale<METRIC> {
    /// Squared distances from those in space and the differences in time.
    #[inline(always)]
    fn far<S: Simd>(&self, s: S, in_space: S::F, in_time: S::F) -> S::F {
        let scale = s.splat(self.0);
        if METRIC {
            let time_distance = in_time * scale;
            in_space + time_distance * time_distance
        } else {
            s.select(s.le(in_time, scale), in_space, s.splat(f32::INFINITY))
        }
    }
}

impl<const METRIC: bool> Measure<StampedBlock> for Scale<METRIC> {
    const BALL: f32 = 0.18;

    #[inline(always)]
    fn distances<S: Simd>(&self, s: S, target: &Target<S>, block: &StampedBlock) -> S::F {
        let [x, y, z] = rows(s, &block.at);
        let in_space = squared::<S>(x - target.point[0], y - target.point[1], z - target.point[2]);
        let time = s.load(&block.time);
        self.far(s, in_space, s.max(time - target.time, target.time - time))
    }
    #[inline(always)]
    fn boxes<S: Simd>(&self, s: S, target: &Target<S>, node: &SpanNode) -> (S::F, Mask) {
        let (lo_at, hi_at) = node.in_space(s);
        let (in_space, holding) = outside(s, &target.point, lo_at, hi_at);
        let (lo, hi) = node.in_time(s);
        let in_time = s.max_with_zero(lo - target.time, target.time - hi);
        let near = if METRIC { s.splat(0.0) } else { s.splat(self.0) };
        (self.far(s, in_space, in_time), holding & s.le(in_time, near))
    }
    /// With a window only a part of a leaf counts, and a ball has to be larger to hold as many.
    #[inline(always)]
    fn sizes<S: Simd>(&self, s: S, target: &Target<S>, node: &SpanNode, in_space: S::F) -> S::F {
        let (lo, hi) = node.in_time(s);
        let (length, scale) = (hi - lo, s.splat(self.0));
        if METRIC {
            let time_distance = length * scale;
            return in_space + time_distance * time_distance;
        }
        let seen = s.min(hi, target.time + scale) - s.max(lo, target.time - scale);
        let least = length * s.splat(1.0 / LANES as f32) + s.splat(f32::MIN_POSITIVE);
        in_space * ((length + s.splat(f32::MIN_POSITIVE)) / s.max(seen, least))
    }
}
