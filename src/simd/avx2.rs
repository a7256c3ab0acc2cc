//! Sixteen lanes in two AVX2 registers.

use super::doubles::{Four, operations_on_four};
use super::instructions::{Kernel, Simd};
use super::lanes::{Lanes, Mask, Rows};
use super::network::sort_network;
use super::operators::operators;
use core::arch::x86_64::*;
use core::mem::MaybeUninit;

/// Token of AVX2. Private field: only [`run`] makes one.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

/// Sixteen floats, low half first; made only from the token, so the CPU has AVX2.
#[derive(Clone, Copy)]
pub(super) struct F(__m256, __m256);

/// Sixteen integers, low half first; made only from the token.
#[derive(Clone, Copy)]
pub(super) struct U(__m256i, __m256i);

/// Whether all code of this build is compiled for CPUs with these features.
pub(super) const EVERYWHERE: bool = cfg!(all(
    target_feature = "avx2",
    target_feature = "fma",
    target_feature = "bmi1",
    target_feature = "bmi2",
    target_feature = "lzcnt",
    target_feature = "popcnt"
));

/// Whether this CPU has every feature that [`run`] enables.
pub(super) fn detected() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

/// Runs a kernel compiled for AVX2 with FMA.
///
/// # Safety
/// [`detected`] must have returned true on this CPU.
#[inline(never)]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(super) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx2(()))
}

/// An intrinsic behind a value that proves the CPU has it.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: all operands come from the token, which exists only after detection; memory
        // operands point into arrays of sixteen elements, or into a slice with the lanes beyond it masked,
        // and the unaligned forms are used.
        unsafe { $call }
    };
}

/// For every 8-bit mask the lanes it moves to the front, one nibble-sized index per byte.
static FRONT: [u64; 256] = front_table();

const fn front_table() -> [u64; 256] {
    let mut table = [0; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut to, mut row) = (0u64, 0, 0u64);
        while lane < 8 {
            if mask >> lane & 1 != 0 {
                row |= lane << (8 * to);
                to += 1;
            }
            lane += 1;
        }
        table[mask] = row;
        mask += 1;
    }
    table
}

impl F {
    #[inline(always)]
    fn compare<const OP: i32>(self, b: F) -> Mask {
        let low = intrinsic!(_mm256_movemask_ps(_mm256_cmp_ps::<OP>(self.0, b.0)));
        let high = intrinsic!(_mm256_movemask_ps(_mm256_cmp_ps::<OP>(self.1, b.1)));
        (low | high << 8) as Mask
    }
}

impl U {
    #[inline(always)]
    fn sign_mask(self) -> Mask {
        let low = intrinsic!(_mm256_movemask_ps(_mm256_castsi256_ps(self.0)));
        let high = intrinsic!(_mm256_movemask_ps(_mm256_castsi256_ps(self.1)));
        (low | high << 8) as Mask
    }

    /// All ones in the lanes of the mask.
    #[inline(always)]
    fn from_mask(mask: Mask) -> U {
        let low = intrinsic!(_mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128));
        let high = intrinsic!(_mm256_slli_epi32::<8>(low));
        let all = intrinsic!(_mm256_set1_epi32(i32::from(mask)));
        U(
            intrinsic!(_mm256_cmpeq_epi32(_mm256_and_si256(all, low), low)),
            intrinsic!(_mm256_cmpeq_epi32(_mm256_and_si256(all, high), high)),
        )
    }

    /// The lanes of either half of the mask moved to the half's front, and the number of those in the low half, where
    /// those of the high half go. Not joined in memory: a wide load after narrow stores is slow.
    #[inline(always)]
    fn packed_halves(self, mask: Mask) -> (__m256i, __m256i, usize) {
        let (low, high) = (mask & 0xff, mask >> 8);
        (U::pack_half(self.0, low), U::pack_half(self.1, high), low.count_ones() as usize)
    }

    /// The lanes of an eight-bit mask moved to the front.
    #[inline(always)]
    fn pack_half(x: __m256i, mask: Mask) -> __m256i {
        let lanes = intrinsic!(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(FRONT[usize::from(mask)] as i64)));
        intrinsic!(_mm256_permutevar8x32_epi32(x, lanes))
    }
}

/// The lanes of a mask loaded from `at`, 0 elsewhere; at least as many floats as the mask has bits, all of them the
/// lowest, must lie there. The mask came from the token.
#[inline(always)]
fn masked(lanes: U, at: *const f32) -> F {
    F(intrinsic!(_mm256_maskload_ps(at, lanes.0)), intrinsic!(_mm256_maskload_ps(at.wrapping_add(8), lanes.1)))
}

/// Permutes eight lanes of `a` by the lowest four bits of `index`; both came from the token.
#[inline(always)]
fn permuted(a: F, index: __m256i) -> __m256 {
    // The permutation uses three bits, the blend the topmost.
    let (low, high) =
        (intrinsic!(_mm256_permutevar8x32_ps(a.0, index)), intrinsic!(_mm256_permutevar8x32_ps(a.1, index)));
    let upper = intrinsic!(_mm256_castsi256_ps(_mm256_slli_epi32::<28>(index)));
    intrinsic!(_mm256_blendv_ps(low, high, upper))
}

operators!(F:
    Add add |a, b| F(intrinsic!(_mm256_add_ps(a.0, b.0)), intrinsic!(_mm256_add_ps(a.1, b.1)));
    Sub sub |a, b| F(intrinsic!(_mm256_sub_ps(a.0, b.0)), intrinsic!(_mm256_sub_ps(a.1, b.1)));
    Mul mul |a, b| F(intrinsic!(_mm256_mul_ps(a.0, b.0)), intrinsic!(_mm256_mul_ps(a.1, b.1)));
    Div div |a, b| F(intrinsic!(_mm256_div_ps(a.0, b.0)), intrinsic!(_mm256_div_ps(a.1, b.1)));
);

operators!(U:
    BitAnd bitand |a, b| U(intrinsic!(_mm256_and_si256(a.0, b.0)), intrinsic!(_mm256_and_si256(a.1, b.1)));
    BitOr bitor |a, b| U(intrinsic!(_mm256_or_si256(a.0, b.0)), intrinsic!(_mm256_or_si256(a.1, b.1)));
);

impl Simd for Avx2 {
    type F = F;
    type U = U;
    type D = Four;
    const HALVES: bool = true;

    #[inline(always)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        // SAFETY: the token exists only after detection.
        unsafe { run(kernel) }
    }

    #[inline(always)]
    fn splat(self, x: f32) -> F {
        let half = intrinsic!(_mm256_set1_ps(x));
        F(half, half)
    }
    #[inline(always)]
    fn load(self, from: &Lanes<f32>) -> F {
        let at = from.as_ptr();
        F(intrinsic!(_mm256_loadu_ps(at)), intrinsic!(_mm256_loadu_ps(at.add(8))))
    }
    #[inline(always)]
    fn lower_half(self, a: F) -> F {
        F(a.0, a.0)
    }
    #[inline(always)]
    fn load_row(self, rows: &Rows, i: usize) -> F {
        masked(U::from_mask(rows.mask), rows.row(i))
    }
    #[inline(always)]
    fn load_thirds(self, rows: &Rows, first: usize) -> [F; 3] {
        let lanes = U::from_mask(rows.mask);
        let [a, b, c] = rows.thirds(first);
        [masked(lanes, a), masked(lanes, b), masked(lanes, c)]
    }
    #[inline(always)]
    fn store(self, x: F, to: &mut Lanes<f32>) {
        let at = to.as_mut_ptr();
        intrinsic!(_mm256_storeu_ps(at, x.0));
        intrinsic!(_mm256_storeu_ps(at.add(8), x.1));
    }
    #[inline(always)]
    fn mul_add(self, a: F, b: F, c: F) -> F {
        F(intrinsic!(_mm256_fmadd_ps(a.0, b.0, c.0)), intrinsic!(_mm256_fmadd_ps(a.1, b.1, c.1)))
    }
    #[inline(always)]
    fn negated_mul_add(self, a: F, b: F, c: F) -> F {
        F(intrinsic!(_mm256_fnmadd_ps(a.0, b.0, c.0)), intrinsic!(_mm256_fnmadd_ps(a.1, b.1, c.1)))
    }
    #[inline(always)]
    fn mul_add_one(self, a: f32, b: f32, c: f32) -> f32 {
        // One instruction here, a call where the CPU has none.
        a.mul_add(b, c)
    }
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        F(intrinsic!(_mm256_sqrt_ps(a.0)), intrinsic!(_mm256_sqrt_ps(a.1)))
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        F(intrinsic!(_mm256_min_ps(a.0, b.0)), intrinsic!(_mm256_min_ps(a.1, b.1)))
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        F(intrinsic!(_mm256_max_ps(a.0, b.0)), intrinsic!(_mm256_max_ps(a.1, b.1)))
    }
    #[inline(always)]
    fn max_signed(self, a: F, b: F) -> F {
        let (a, b) = (self.to_bits(a), self.to_bits(b));
        let max = U(intrinsic!(_mm256_max_epi32(a.0, b.0)), intrinsic!(_mm256_max_epi32(a.1, b.1)));
        self.from_bits(max)
    }
    #[inline(always)]
    fn min_signed(self, a: F, b: F) -> F {
        let (a, b) = (self.to_bits(a), self.to_bits(b));
        let min = U(intrinsic!(_mm256_min_epi32(a.0, b.0)), intrinsic!(_mm256_min_epi32(a.1, b.1)));
        self.from_bits(min)
    }
    #[inline(always)]
    fn le_signed(self, a: F, b: F) -> Mask {
        let (a, b) = (self.to_bits(a), self.to_bits(b));
        let gt = U(intrinsic!(_mm256_cmpgt_epi32(a.0, b.0)), intrinsic!(_mm256_cmpgt_epi32(a.1, b.1)));
        !gt.sign_mask()
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> Mask {
        a.compare::<_CMP_LT_OQ>(b)
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> Mask {
        a.compare::<_CMP_LE_OQ>(b)
    }
    #[inline(always)]
    fn eq(self, a: F, b: F) -> Mask {
        a.compare::<_CMP_EQ_OQ>(b)
    }
    #[inline(always)]
    fn select(self, mask: Mask, a: F, b: F) -> F {
        let m = U::from_mask(mask);
        F(
            intrinsic!(_mm256_blendv_ps(b.0, a.0, _mm256_castsi256_ps(m.0))),
            intrinsic!(_mm256_blendv_ps(b.1, a.1, _mm256_castsi256_ps(m.1))),
        )
    }
    #[inline(always)]
    fn permute(self, a: F, index: U) -> F {
        F(permuted(a, index.0), permuted(a, index.1))
    }
    #[inline(always)]
    fn lane(self, a: F, i: usize) -> f32 {
        // The index counts modulo 8 within a half.
        let half = if i < 8 { a.0 } else { a.1 };
        intrinsic!(_mm256_cvtss_f32(_mm256_permutevar8x32_ps(half, _mm256_set1_epi32(i as i32))))
    }
    #[inline(always)]
    fn store_compressed(self, a: F, mask: Mask, to: &mut Lanes<f32>) {
        let (low, high, behind) = self.to_bits(a).packed_halves(mask);
        let at = to.as_mut_ptr();
        intrinsic!(_mm256_storeu_ps(at, _mm256_castsi256_ps(low)));
        intrinsic!(_mm256_storeu_ps(at.add(behind), _mm256_castsi256_ps(high)));
    }
    #[inline(always)]
    fn to_bits(self, a: F) -> U {
        U(intrinsic!(_mm256_castps_si256(a.0)), intrinsic!(_mm256_castps_si256(a.1)))
    }
    #[inline(always)]
    fn from_bits(self, a: U) -> F {
        F(intrinsic!(_mm256_castsi256_ps(a.0)), intrinsic!(_mm256_castsi256_ps(a.1)))
    }

    #[inline(always)]
    fn splat_u(self, x: u32) -> U {
        let half = intrinsic!(_mm256_set1_epi32(x as i32));
        U(half, half)
    }
    #[inline(always)]
    fn load_u(self, from: &Lanes<u32>) -> U {
        let at = from.as_ptr();
        U(intrinsic!(_mm256_loadu_si256(at.cast())), intrinsic!(_mm256_loadu_si256(at.add(8).cast())))
    }
    #[inline(always)]
    fn store_u(self, x: U, to: &mut Lanes<u32>) {
        let at = to.as_mut_ptr();
        intrinsic!(_mm256_storeu_si256(at.cast(), x.0));
        intrinsic!(_mm256_storeu_si256(at.add(8).cast(), x.1));
    }
    #[inline(always)]
    fn shift_right<const BITS: u32>(self, a: U) -> U {
        // The intrinsic takes its count in a register, since the trait has it as another type.
        let count = intrinsic!(_mm_cvtsi32_si128(BITS as i32));
        U(intrinsic!(_mm256_srl_epi32(a.0, count)), intrinsic!(_mm256_srl_epi32(a.1, count)))
    }
    #[inline(always)]
    fn min_u(self, a: U, b: U) -> U {
        U(intrinsic!(_mm256_min_epu32(a.0, b.0)), intrinsic!(_mm256_min_epu32(a.1, b.1)))
    }
    #[inline(always)]
    fn max_u(self, a: U, b: U) -> U {
        U(intrinsic!(_mm256_max_epu32(a.0, b.0)), intrinsic!(_mm256_max_epu32(a.1, b.1)))
    }
    #[inline(always)]
    fn swap_lanes_u<const D: usize>(self, a: U) -> U {
        let lanes: &Lanes<u32> = const { &super::lanes::swapped(D & 7) };
        let lanes = intrinsic!(_mm256_loadu_si256(lanes.as_ptr().cast()));
        let low = intrinsic!(_mm256_permutevar8x32_epi32(a.0, lanes));
        let high = intrinsic!(_mm256_permutevar8x32_epi32(a.1, lanes));
        if D < 8 { U(low, high) } else { U(high, low) }
    }
    #[inline(always)]
    fn sort_u(self, a: U) -> U {
        sort_network(self, a)
    }
    #[inline(always)]
    fn add_u(self, a: U, b: U) -> U {
        U(intrinsic!(_mm256_add_epi32(a.0, b.0)), intrinsic!(_mm256_add_epi32(a.1, b.1)))
    }
    #[inline(always)]
    fn eq_u(self, a: U, b: U) -> Mask {
        U(intrinsic!(_mm256_cmpeq_epi32(a.0, b.0)), intrinsic!(_mm256_cmpeq_epi32(a.1, b.1))).sign_mask()
    }
    #[inline(always)]
    fn lt_u(self, a: U, b: U) -> Mask {
        // a < b exactly where max(a, b) is not a.
        let ge = U(
            intrinsic!(_mm256_cmpeq_epi32(_mm256_max_epu32(a.0, b.0), a.0)),
            intrinsic!(_mm256_cmpeq_epi32(_mm256_max_epu32(a.1, b.1), a.1)),
        );
        !ge.sign_mask()
    }
    #[inline(always)]
    fn select_u(self, mask: Mask, a: U, b: U) -> U {
        self.to_bits(self.select(mask, self.from_bits(a), self.from_bits(b)))
    }
    #[inline(always)]
    fn reduce_min_u(self, a: U) -> u32 {
        let eight = intrinsic!(_mm256_min_epu32(a.0, a.1));
        let four = intrinsic!(_mm_min_epu32(_mm256_castsi256_si128(eight), _mm256_extracti128_si256::<1>(eight)));
        let two = intrinsic!(_mm_min_epu32(four, _mm_shuffle_epi32::<0b01_00_11_10>(four)));
        intrinsic!(_mm_cvtsi128_si32(_mm_min_epu32(two, _mm_shuffle_epi32::<0b10_11_00_01>(two)))) as u32
    }
    #[inline(always)]
    fn store_compressed_u(self, a: U, mask: Mask, to: &mut Lanes<u32>) {
        let (low, high, behind) = a.packed_halves(mask);
        let at = to.as_mut_ptr();
        intrinsic!(_mm256_storeu_si256(at.cast(), low));
        intrinsic!(_mm256_storeu_si256(at.add(behind).cast(), high));
    }
    #[inline(always)]
    fn store_compressed_wide(self, a: U, mask: Mask, to: &mut Lanes<MaybeUninit<u64>>) {
        let (low, high, behind) = a.packed_halves(mask);
        let at = to.as_mut_ptr();
        let four = |place: usize, lanes: __m128i| {
            intrinsic!(_mm256_storeu_si256(at.add(place).cast(), _mm256_cvtepu32_epi64(lanes)));
        };
        four(0, intrinsic!(_mm256_castsi256_si128(low)));
        four(4, intrinsic!(_mm256_extracti128_si256::<1>(low)));
        four(behind, intrinsic!(_mm256_castsi256_si128(high)));
        four(behind + 4, intrinsic!(_mm256_extracti128_si256::<1>(high)));
    }

    operations_on_four!();

    #[inline(always)]
    fn pick_four(self, a: F, numbers: u32) -> Four {
        let shifts = intrinsic!(_mm_setr_epi32(0, 4, 8, 12));
        let index = intrinsic!(_mm_srlv_epi32(_mm_set1_epi32(numbers as i32), shifts));
        let picked = permuted(a, intrinsic!(_mm256_castsi128_si256(index)));
        Four(intrinsic!(_mm256_cvtps_pd(_mm256_castps256_ps128(picked))))
    }
    #[inline(always)]
    fn narrow_all(self, [a, b, c, d]: [Four; 4]) -> F {
        F(Four::narrowed_pair(a, b), Four::narrowed_pair(c, d))
    }
}
