//! Four f64 in one AVX register, for AVX2 and AVX-512 alike.

use super::lanes::Mask;
use core::arch::x86_64::*;
use core::ops::{Add, Div, Mul, Sub};

/// Four f64; made only by the methods of the tokens of AVX2 and AVX-512, so the CPU has AVX2.
#[derive(Clone, Copy)]
pub(super) struct Four(pub(super) __m256d);

impl Add for Four {
    type Output = Four;
    #[inline(always)]
    fn add(self, b: Four) -> Four {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        Four(unsafe { _mm256_add_pd(self.0, b.0) })
    }
}

impl Sub for Four {
    type Output = Four;
    #[inline(always)]
    fn sub(self, b: Four) -> Four {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        Four(unsafe { _mm256_sub_pd(self.0, b.0) })
    }
}

impl Mul for Four {
    type Output = Four;
    #[inline(always)]
    fn mul(self, b: Four) -> Four {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        Four(unsafe { _mm256_mul_pd(self.0, b.0) })
    }
}

impl Div for Four {
    type Output = Four;
    #[inline(always)]
    fn div(self, b: Four) -> Four {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        Four(unsafe { _mm256_div_pd(self.0, b.0) })
    }
}

impl Four {
    #[inline(always)]
    pub(super) fn narrowed(self) -> [f32; 4] {
        let mut lanes = [0.0; 4];
        // SAFETY: `Four` exists only where the CPU has AVX2; four floats fit into the lanes.
        unsafe { _mm_storeu_ps(lanes.as_mut_ptr(), _mm256_cvtpd_ps(self.0)) };
        lanes
    }

    #[inline(always)]
    pub(super) fn narrowed_pair(low: Four, high: Four) -> __m256 {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        unsafe { _mm256_set_m128(_mm256_cvtpd_ps(high.0), _mm256_cvtpd_ps(low.0)) }
    }

    #[inline(always)]
    pub(super) fn transposed([a, b, c, d]: [Four; 4]) -> [Four; 4] {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        unsafe {
            let (even, odd) = (_mm256_unpacklo_pd(a.0, b.0), _mm256_unpackhi_pd(a.0, b.0));
            let (more_even, more_odd) = (_mm256_unpacklo_pd(c.0, d.0), _mm256_unpackhi_pd(c.0, d.0));
            [
                Four(_mm256_permute2f128_pd::<0x20>(even, more_even)),
                Four(_mm256_permute2f128_pd::<0x20>(odd, more_odd)),
                Four(_mm256_permute2f128_pd::<0x31>(even, more_even)),
                Four(_mm256_permute2f128_pd::<0x31>(odd, more_odd)),
            ]
        }
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Four {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        Four(unsafe { _mm256_sqrt_pd(self.0) })
    }

    #[inline(always)]
    pub(super) fn min(self, b: Four) -> Four {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        Four(unsafe { _mm256_min_pd(self.0, b.0) })
    }

    #[inline(always)]
    pub(super) fn max(self, b: Four) -> Four {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        Four(unsafe { _mm256_max_pd(self.0, b.0) })
    }

    #[inline(always)]
    pub(super) fn le(self, b: Four) -> Mask {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        (unsafe { _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(self.0, b.0)) }) as Mask
    }

    /// `a` where `self` is at most `y`, `b` elsewhere.
    #[inline(always)]
    pub(super) fn select_le(self, y: Four, a: Four, b: Four) -> Four {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        Four(unsafe { _mm256_blendv_pd(b.0, a.0, _mm256_cmp_pd::<_CMP_LE_OQ>(self.0, y.0)) })
    }
}
