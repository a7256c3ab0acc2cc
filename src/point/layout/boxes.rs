//! Nodes: sixteen boxes side by side, at rest and moving.

use super::linear_bounds::LinearBox;
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

/// Rows of sixteen boxes whose faces are `a + b·s`.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(in crate::point) struct LinearBoxes {
    pub(in crate::point) lo: [Lanes<f32>; 3],
    pub(in crate::point) lo_slope: [Lanes<f32>; 3],
    pub(in crate::point) hi: [Lanes<f32>; 3],
    pub(in crate::point) hi_slope: [Lanes<f32>; 3],
}

impl LinearBoxes {
    /// Sixteen absent boxes.
    pub(in crate::point) const NONE: LinearBoxes = LinearBoxes {
        lo: [[f32::INFINITY; LANES]; 3],
        lo_slope: [[0.0; LANES]; 3],
        hi: [[f32::NEG_INFINITY; LANES]; 3],
        hi_slope: [[0.0; LANES]; 3],
    };

    /// Lower and upper faces, each lane at a phase of its own.
    #[inline(always)]
    pub(in crate::point) fn faces(&self, phase: &Lanes<f64>) -> [[Lanes<f64>; 3]; 2] {
        let mut faces = [[[0.0; LANES]; 3]; 2];
        for (faces, (at, slope)) in faces.iter_mut().zip([(&self.lo, &self.lo_slope), (&self.hi, &self.hi_slope)]) {
            for axis in 0..3 {
                for lane in 0..LANES {
                    faces[axis][lane] = f64::from(at[axis][lane]) + f64::from(slope[axis][lane]) * phase[lane];
                }
            }
        }
        faces
    }

    /// Sets one lane.
    #[inline(always)]
    pub(in crate::point) fn set(&mut self, lane: usize, linear_box: &LinearBox) {
        for axis in 0..3 {
            self.lo[axis][lane] = linear_box.lo[axis].at_zero;
            self.lo_slope[axis][lane] = linear_box.lo[axis].slope;
            self.hi[axis][lane] = linear_box.hi[axis].at_zero;
            self.hi_slope[axis][lane] = linear_box.hi[axis].slope;
        }
    }
}
