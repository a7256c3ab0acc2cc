//! Four f64 in one AVX register, for AVX2 and AVX-512 alike.

use super::operators::operators;
use core::arch::x86_64::*;

/// Four f64; made only by the methods of the tokens of AVX2 and AVX-512, so the CPU has AVX2.
#[derive(Clone, Copy)]
pub(super) struct Four(pub(super) __m256d);

/// An intrinsic of registers, without memory operands.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: `Four` exists only where the CPU has AVX2.
        unsafe { $call }
    };
}

operators!(Four:
    Add add |a, b| Four(intrinsic!(_mm256_add_pd(a.0, b.0)));
    Sub sub |a, b| Four(intrinsic!(_mm256_sub_pd(a.0, b.0)));
    Mul mul |a, b| Four(intrinsic!(_mm256_mul_pd(a.0, b.0)));
    Div div |a, b| Four(intrinsic!(_mm256_div_pd(a.0, b.0)));
);

impl Four {
    #[inline(always)]
    pub(super) fn narrowed_pair(low: Four, high: Four) -> __m256 {
        intrinsic!(_mm256_set_m128(_mm256_cvtpd_ps(high.0), _mm256_cvtpd_ps(low.0)))
    }
}

/// The operations of [`Simd`](super::instructions::Simd) on [`Four`] that are the same with AVX2 and AVX-512. The `intrinsic!` of
/// the token's file is meant.
macro_rules! operations_on_four {
    () => {
        #[inline(always)]
        fn splat_d(self, x: f64) -> Four {
            Four(intrinsic!(_mm256_set1_pd(x)))
        }
        #[inline(always)]
        fn load_d(self, from: &[f64; 4]) -> Four {
            Four(intrinsic!(_mm256_loadu_pd(from.as_ptr())))
        }
        #[inline(always)]
        fn widen(self, [a, b, c]: [f32; 3]) -> Four {
            Four(intrinsic!(_mm256_cvtps_pd(_mm_set_ps(0.0, c, b, a))))
        }
        #[inline(always)]
        fn rotate_left(self, a: Four) -> Four {
            Four(intrinsic!(_mm256_permute4x64_pd::<0b11_00_10_01>(a.0)))
        }
        #[inline(always)]
        fn rotate_right(self, a: Four) -> Four {
            Four(intrinsic!(_mm256_permute4x64_pd::<0b11_01_00_10>(a.0)))
        }
        #[inline(always)]
        fn lanes_d(self, a: Four) -> [f64; 4] {
            let mut lanes = [0.0; 4];
            intrinsic!(_mm256_storeu_pd(lanes.as_mut_ptr(), a.0));
            lanes
        }
        #[inline(always)]
        fn widen_four(self, from: &[f32; 4]) -> Four {
            Four(intrinsic!(_mm256_cvtps_pd(_mm_loadu_ps(from.as_ptr()))))
        }
        #[inline(always)]
        fn narrow(self, a: Four) -> [f32; 4] {
            let mut lanes = [0.0; 4];
            intrinsic!(_mm_storeu_ps(lanes.as_mut_ptr(), _mm256_cvtpd_ps(a.0)));
            lanes
        }
        #[inline(always)]
        fn transpose_d(self, [a, b, c, d]: [Four; 4]) -> [Four; 4] {
            intrinsic!({
                let (even, odd) = (_mm256_unpacklo_pd(a.0, b.0), _mm256_unpackhi_pd(a.0, b.0));
                let (more_even, more_odd) = (_mm256_unpacklo_pd(c.0, d.0), _mm256_unpackhi_pd(c.0, d.0));
                [
                    Four(_mm256_permute2f128_pd::<0x20>(even, more_even)),
                    Four(_mm256_permute2f128_pd::<0x20>(odd, more_odd)),
                    Four(_mm256_permute2f128_pd::<0x31>(even, more_even)),
                    Four(_mm256_permute2f128_pd::<0x31>(odd, more_odd)),
                ]
            })
        }
        #[inline(always)]
        fn sqrt_d(self, a: Four) -> Four {
            Four(intrinsic!(_mm256_sqrt_pd(a.0)))
        }
        #[inline(always)]
        fn min_d(self, a: Four, b: Four) -> Four {
            Four(intrinsic!(_mm256_min_pd(a.0, b.0)))
        }
        #[inline(always)]
        fn max_d(self, a: Four, b: Four) -> Four {
            Four(intrinsic!(_mm256_max_pd(a.0, b.0)))
        }
        #[inline(always)]
        fn le_d(self, a: Four, b: Four) -> Mask {
            intrinsic!(_mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(a.0, b.0))) as Mask
        }
        #[inline(always)]
        fn select_le(self, x: Four, y: Four, a: Four, b: Four) -> Four {
            Four(intrinsic!(_mm256_blendv_pd(b.0, a.0, _mm256_cmp_pd::<_CMP_LE_OQ>(x.0, y.0))))
        }
    };
}

pub(super) use operations_on_four;
