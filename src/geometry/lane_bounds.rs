//! Linear bounds in sixteen lanes, so that a union is one minimum.

use super::box3::{Box3, LinearBox3};
use crate::simd::{LANES, Lanes};
use glam::{Vec3, Vec4};

/// Linear bounds as four groups of lanes: lower faces at the beginning and at the end, negated upper faces at the beginning and at
/// the end. The last lane of each group means nothing.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct LaneBounds(pub Lanes<f32>);

impl LaneBounds {
    pub const EMPTY: LaneBounds = LaneBounds([f32::INFINITY; LANES]);

    #[inline(always)]
    pub fn new(low: [Vec4; 2], negated_high: [Vec4; 2]) -> LaneBounds {
        let mut lanes = [0.0; LANES];
        low[0].write_to_slice(&mut lanes[..4]);
        low[1].write_to_slice(&mut lanes[4..8]);
        negated_high[0].write_to_slice(&mut lanes[8..12]);
        negated_high[1].write_to_slice(&mut lanes[12..]);
        LaneBounds(lanes)
    }

    pub fn of(bounds: &LinearBox3) -> LaneBounds {
        let LinearBox3 { begin, end } = bounds;
        let lanes = |v: Vec3| v.extend(0.0);
        LaneBounds::new([begin.min, end.min].map(lanes), [-begin.max, -end.max].map(lanes))
    }

    pub fn bounds(&self) -> LinearBox3 {
        let at = |group: usize| self.group(group).truncate();
        LinearBox3 { begin: Box3 { min: at(0), max: -at(2) }, end: Box3 { min: at(1), max: -at(3) } }
    }

    /// Four times the centre at mid-time; the last lane means nothing.
    #[inline(always)]
    pub fn centre(&self) -> Vec4 {
        (self.group(0) - self.group(3)) + (self.group(1) - self.group(2))
    }

    #[inline(always)]
    fn group(&self, group: usize) -> Vec4 {
        Vec4::from_slice(&self.0[4 * group..])
    }

    /// The minimum in each lane: the union.
    pub fn union(self, other: LaneBounds) -> LaneBounds {
        LaneBounds(core::array::from_fn(|i| if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] }))
    }
}
