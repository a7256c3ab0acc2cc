//! Four f64 in two NEON registers.

use super::operators::operators;
use core::arch::aarch64::*;

/// Four f64, low half first.
#[derive(Clone, Copy)]
pub(super) struct Four(pub(super) float64x2_t, pub(super) float64x2_t);

/// An intrinsic of registers, without memory operands.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: NEON is part of AArch64.
        unsafe { $call }
    };
}

impl Four {
    #[inline(always)]
    pub(super) fn map(self, b: Four, f: impl Fn(float64x2_t, float64x2_t) -> float64x2_t) -> Four {
        Four(f(self.0, b.0), f(self.1, b.1))
    }

    #[inline(always)]
    pub(super) fn widened(four: float32x4_t) -> Four {
        Four(intrinsic!(vcvt_f64_f32(vget_low_f32(four))), intrinsic!(vcvt_high_f64_f32(four)))
    }

    #[inline(always)]
    pub(super) fn narrowed(self) -> float32x4_t {
        intrinsic!(vcvt_high_f32_f64(vcvt_f32_f64(self.0), self.1))
    }
}

operators!(Four:
    Add add |a, b| a.map(b, |a, b| intrinsic!(vaddq_f64(a, b)));
    Sub sub |a, b| a.map(b, |a, b| intrinsic!(vsubq_f64(a, b)));
    Mul mul |a, b| a.map(b, |a, b| intrinsic!(vmulq_f64(a, b)));
    Div div |a, b| a.map(b, |a, b| intrinsic!(vdivq_f64(a, b)));
);
