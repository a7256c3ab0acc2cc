//! Four f64 in one AVX register, for AVX2 and AVX-512 alike.

use core::arch::x86_64::*;
use core::ops::{Add, Mul, Sub};

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
