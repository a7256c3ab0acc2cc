//! Sixteen lanes in one AVX-512 register.

use super::doubles::{Four, operations_on_four};
use super::instructions::{Kernel, Simd};
use super::lanes::{Lanes, Mask, Rows};
use super::network::sort_network;
use super::operators::operators;
use core::arch::x86_64::*;
use core::mem::MaybeUninit;

/// Token of AVX-512. Private field: only [`run`] makes one.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

/// Sixteen floats; made only from the token, so the CPU has AVX-512.
#[derive(Clone, Copy)]
pub(super) struct F(__m512);

/// Sixteen integers; made only from the token.
#[derive(Clone, Copy)]
pub(super) struct U(__m512i);

/// Whether all code of this build is compiled for CPUs with these features.
pub(super) const EVERYWHERE: bool = super::avx2::EVERYWHERE
    && cfg!(all(
        target_feature = "avx512f",
        target_feature = "avx512bw",
        target_feature = "avx512dq",
        target_feature = "avx512vl"
    ));

/// Whether this CPU has every feature that [`run`] enables.
pub(super) fn detected() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

/// Runs a kernel compiled for AVX-512.
///
/// # Safety
/// [`detected`] must have returned true on this CPU.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(super) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx512(()))
}

/// An intrinsic behind a value that proves the CPU has it.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: all operands come from the token, which exists only after detection; memory
        // operands have at least as many elements as are used, by the unaligned forms.
        unsafe { $call }
    };
}

impl Avx512 {
    /// Squared distances of the first or the last eight points.
    #[inline(always)]
    fn eight_distances(self, [x, y, z]: [&Lanes<f64>; 3], from: [f64; 3], half: usize) -> __m256 {
        let (x, y, z) = (&x.as_chunks::<8>().0[half], &y.as_chunks::<8>().0[half], &z.as_chunks::<8>().0[half]);
        intrinsic!({
            let x = _mm512_sub_pd(_mm512_loadu_pd(x.as_ptr()), _mm512_set1_pd(from[0]));
            let y = _mm512_sub_pd(_mm512_loadu_pd(y.as_ptr()), _mm512_set1_pd(from[1]));
            let z = _mm512_sub_pd(_mm512_loadu_pd(z.as_ptr()), _mm512_set1_pd(from[2]));
            let square = _mm512_add_pd(_mm512_mul_pd(x, x), _mm512_mul_pd(y, y));
            _mm512_cvtpd_ps(_mm512_add_pd(square, _mm512_mul_pd(z, z)))
        })
    }
}

operators!(F:
    Add add |a, b| F(intrinsic!(_mm512_add_ps(a.0, b.0)));
    Sub sub |a, b| F(intrinsic!(_mm512_sub_ps(a.0, b.0)));
    Mul mul |a, b| F(intrinsic!(_mm512_mul_ps(a.0, b.0)));
    Div div |a, b| F(intrinsic!(_mm512_div_ps(a.0, b.0)));
);

operators!(U:
    BitAnd bitand |a, b| U(intrinsic!(_mm512_and_si512(a.0, b.0)));
    BitOr bitor |a, b| U(intrinsic!(_mm512_or_si512(a.0, b.0)));
);

impl Simd for Avx512 {
    type F = F;
    type U = U;
    type D = Four;

    #[inline(always)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        // SAFETY: the token exists only after detection.
        unsafe { run(kernel) }
    }

    #[inline(always)]
    fn splat(self, x: f32) -> F {
        F(intrinsic!(_mm512_set1_ps(x)))
    }
    #[inline(always)]
    fn load(self, from: &Lanes<f32>) -> F {
        F(intrinsic!(_mm512_loadu_ps(from.as_ptr())))
    }
    #[inline(always)]
    fn load_row(self, rows: &Rows, i: usize) -> F {
        F(intrinsic!(_mm512_maskz_loadu_ps(rows.mask, rows.row(i))))
    }
    #[inline(always)]
    fn load_thirds(self, rows: &Rows, first: usize) -> [F; 3] {
        let [a, b, c] = rows.thirds(first);
        [
            F(intrinsic!(_mm512_maskz_loadu_ps(rows.mask, a))),
            F(intrinsic!(_mm512_maskz_loadu_ps(rows.mask, b))),
            F(intrinsic!(_mm512_maskz_loadu_ps(rows.mask, c))),
        ]
    }
    #[inline(always)]
    fn store(self, x: F, to: &mut Lanes<f32>) {
        intrinsic!(_mm512_storeu_ps(to.as_mut_ptr(), x.0))
    }
    #[inline(always)]
    fn mul_add(self, a: F, b: F, c: F) -> F {
        F(intrinsic!(_mm512_fmadd_ps(a.0, b.0, c.0)))
    }
    #[inline(always)]
    fn negated_mul_add(self, a: F, b: F, c: F) -> F {
        F(intrinsic!(_mm512_fnmadd_ps(a.0, b.0, c.0)))
    }
    #[inline(always)]
    fn mul_add_one(self, a: f32, b: f32, c: f32) -> f32 {
        // One instruction here, a call where the CPU has none.
        a.mul_add(b, c)
    }
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        F(intrinsic!(_mm512_sqrt_ps(a.0)))
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        F(intrinsic!(_mm512_min_ps(a.0, b.0)))
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        F(intrinsic!(_mm512_max_ps(a.0, b.0)))
    }
    #[inline(always)]
    fn max_signed(self, a: F, b: F) -> F {
        let [a, b] = [intrinsic!(_mm512_castps_si512(a.0)), intrinsic!(_mm512_castps_si512(b.0))];
        F(intrinsic!(_mm512_castsi512_ps(_mm512_max_epi32(a, b))))
    }
    #[inline(always)]
    fn min_signed(self, a: F, b: F) -> F {
        let [a, b] = [intrinsic!(_mm512_castps_si512(a.0)), intrinsic!(_mm512_castps_si512(b.0))];
        F(intrinsic!(_mm512_castsi512_ps(_mm512_min_epi32(a, b))))
    }
    #[inline(always)]
    fn le_signed(self, a: F, b: F) -> Mask {
        let [a, b] = [intrinsic!(_mm512_castps_si512(a.0)), intrinsic!(_mm512_castps_si512(b.0))];
        intrinsic!(_mm512_cmple_epi32_mask(a, b))
    }
    #[inline(always)]
    fn max_with_zero(self, a: F, b: F) -> F {
        // Compared as signed integers, positive floats keep their order, and all others are at most zero: a quarter of
        // the latency.
        let [a, b] = [intrinsic!(_mm512_castps_si512(a.0)), intrinsic!(_mm512_castps_si512(b.0))];
        let most = intrinsic!(_mm512_max_epi32(_mm512_max_epi32(a, b), _mm512_setzero_si512()));
        F(intrinsic!(_mm512_castsi512_ps(most)))
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> Mask {
        intrinsic!(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0))
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> Mask {
        intrinsic!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a.0, b.0))
    }
    #[inline(always)]
    fn eq(self, a: F, b: F) -> Mask {
        intrinsic!(_mm512_cmp_ps_mask::<_CMP_EQ_OQ>(a.0, b.0))
    }
    #[inline(always)]
    fn select(self, mask: Mask, a: F, b: F) -> F {
        F(intrinsic!(_mm512_mask_blend_ps(mask, b.0, a.0)))
    }
    #[inline(always)]
    fn permute(self, a: F, index: U) -> F {
        F(intrinsic!(_mm512_permutexvar_ps(index.0, a.0)))
    }
    #[inline(always)]
    fn lane(self, a: F, i: usize) -> f32 {
        intrinsic!(_mm512_cvtss_f32(_mm512_permutexvar_ps(_mm512_set1_epi32(i as i32), a.0)))
    }
    #[inline(always)]
    fn store_compressed(self, a: F, mask: Mask, to: &mut Lanes<f32>) {
        // Through a register: some CPUs take a hundred cycles to compress to memory.
        self.store(F(intrinsic!(_mm512_maskz_compress_ps(mask, a.0))), to);
    }
    #[inline(always)]
    fn to_bits(self, a: F) -> U {
        U(intrinsic!(_mm512_castps_si512(a.0)))
    }
    #[inline(always)]
    fn from_bits(self, a: U) -> F {
        F(intrinsic!(_mm512_castsi512_ps(a.0)))
    }

    #[inline(always)]
    fn splat_u(self, x: u32) -> U {
        U(intrinsic!(_mm512_set1_epi32(x as i32)))
    }
    #[inline(always)]
    fn load_u(self, from: &Lanes<u32>) -> U {
        U(intrinsic!(_mm512_loadu_si512(from.as_ptr().cast())))
    }
    #[inline(always)]
    fn store_u(self, x: U, to: &mut Lanes<u32>) {
        intrinsic!(_mm512_storeu_si512(to.as_mut_ptr().cast(), x.0))
    }
    #[inline(always)]
    fn shift_right<const BITS: u32>(self, a: U) -> U {
        U(intrinsic!(_mm512_srli_epi32::<BITS>(a.0)))
    }
    #[inline(always)]
    fn min_u(self, a: U, b: U) -> U {
        U(intrinsic!(_mm512_min_epu32(a.0, b.0)))
    }
    #[inline(always)]
    fn max_u(self, a: U, b: U) -> U {
        U(intrinsic!(_mm512_max_epu32(a.0, b.0)))
    }
    #[inline(always)]
    fn swap_lanes_u<const D: usize>(self, a: U) -> U {
        // Within quarters it takes one cycle, across them three.
        match D {
            1 => U(intrinsic!(_mm512_shuffle_epi32::<0b10_11_00_01>(a.0))),
            2 => U(intrinsic!(_mm512_shuffle_epi32::<0b01_00_11_10>(a.0))),
            3 => U(intrinsic!(_mm512_shuffle_epi32::<0b00_01_10_11>(a.0))),
            _ => {
                let lanes: &Lanes<u32> = const { &super::lanes::swapped(D) };
                let lanes = intrinsic!(_mm512_loadu_si512(lanes.as_ptr().cast()));
                U(intrinsic!(_mm512_permutexvar_epi32(lanes, a.0)))
            }
        }
    }
    #[inline(always)]
    fn sort_u(self, a: U) -> U {
        sort_network(self, a)
    }
    #[inline(always)]
    fn add_u(self, a: U, b: U) -> U {
        U(intrinsic!(_mm512_add_epi32(a.0, b.0)))
    }
    #[inline(always)]
    fn eq_u(self, a: U, b: U) -> Mask {
        intrinsic!(_mm512_cmpeq_epi32_mask(a.0, b.0))
    }
    #[inline(always)]
    fn lt_u(self, a: U, b: U) -> Mask {
        intrinsic!(_mm512_cmplt_epu32_mask(a.0, b.0))
    }
    #[inline(always)]
    fn select_u(self, mask: Mask, a: U, b: U) -> U {
        U(intrinsic!(_mm512_mask_blend_epi32(mask, b.0, a.0)))
    }
    #[inline(always)]
    fn reduce_min_u(self, a: U) -> u32 {
        intrinsic!(_mm512_reduce_min_epu32(a.0))
    }
    #[inline(always)]
    fn store_compressed_u(self, a: U, mask: Mask, to: &mut Lanes<u32>) {
        self.store_u(U(intrinsic!(_mm512_maskz_compress_epi32(mask, a.0))), to);
    }
    #[inline(always)]
    fn store_compressed_wide(self, a: U, mask: Mask, to: &mut Lanes<MaybeUninit<u64>>) {
        let lanes = intrinsic!(_mm512_maskz_compress_epi32(mask, a.0));
        let low = intrinsic!(_mm512_cvtepu32_epi64(_mm512_castsi512_si256(lanes)));
        let high = intrinsic!(_mm512_cvtepu32_epi64(_mm512_extracti64x4_epi64::<1>(lanes)));
        let at = to.as_mut_ptr();
        intrinsic!(_mm512_storeu_si512(at.cast(), low));
        intrinsic!(_mm512_storeu_si512(at.add(8).cast(), high));
    }

    operations_on_four!();

    #[inline(always)]
    fn pick_four(self, a: F, numbers: u32) -> Four {
        let shifts = intrinsic!(_mm_setr_epi32(0, 4, 8, 12));
        let index = intrinsic!(_mm_srlv_epi32(_mm_set1_epi32(numbers as i32), shifts));
        let picked = intrinsic!(_mm512_permutexvar_ps(_mm512_castsi128_si512(index), a.0));
        Four(intrinsic!(_mm256_cvtps_pd(_mm512_castps512_ps128(picked))))
    }
    #[inline(always)]
    fn narrow_all(self, [a, b, c, d]: [Four; 4]) -> F {
        let (low, high) = (Four::narrowed_pair(a, b), Four::narrowed_pair(c, d));
        F(intrinsic!(_mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)))
    }
    #[inline(always)]
    fn store_compressed_d(self, row: &Lanes<f64>, mask: Mask, to: &mut Lanes<f64>) {
        let (from, to) = (row.as_ptr(), to.as_mut_ptr());
        let (low, high) = ((mask & 255) as u8, (mask >> 8) as u8);
        let behind = low.count_ones() as usize;
        intrinsic!({
            _mm512_storeu_pd(to, _mm512_maskz_compress_pd(low, _mm512_loadu_pd(from)));
            // At most eight behind the begin.
            _mm512_storeu_pd(to.add(behind), _mm512_maskz_compress_pd(high, _mm512_loadu_pd(from.add(8))));
        });
    }
    #[inline(always)]
    fn squared_distances(self, rows: [&Lanes<f64>; 3], from: [f64; 3]) -> F {
        let (low, high) = (self.eight_distances(rows, from, 0), self.eight_distances(rows, from, 1));
        F(intrinsic!(_mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)))
    }
}
