//! Sixteen boxes side by side: a node over points that do not move.

use crate::simd::{LANES, Lanes};

/// Sixteen boxes in rows; of absent boxes `lo` is infinite and `hi` is negative infinite.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(in crate::point) struct Boxes {
    pub(in crate::point) lo: [Lanes<f32>; 3],
    pub(in crate::point) hi: [Lanes<f32>; 3],
}

impl Boxes {
    /// Sixteen absent boxes.
    pub(in crate::point) const NONE: Boxes =
        Boxes { lo: [[f32::INFINITY; LANES]; 3], hi: [[f32::NEG_INFINITY; LANES]; 3] };

    /// Grows lane `lane` to hold a box.
    #[inline(always)]
    pub(in crate::point) fn include(&mut self, lane: usize, lo: [f32; 3], hi: [f32; 3]) {
        for axis in 0..3 {
            self.lo[axis][lane] = self.lo[axis][lane].min(lo[axis]);
            self.hi[axis][lane] = self.hi[axis][lane].max(hi[axis]);
        }
    }

    /// The box around all sixteen.
    pub(in crate::point) fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let least = |row: &Lanes<f32>| row.iter().copied().fold(f32::INFINITY, f32::min);
        let most = |row: &Lanes<f32>| row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        (core::array::from_fn(|a| least(&self.lo[a])), core::array::from_fn(|a| most(&self.hi[a])))
    }
}
