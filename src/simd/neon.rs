//! Sixteen lanes in four NEON registers, which every AArch64 CPU has.
//!
//! A table lookup (`tbl`) with four registers holds sixteen floats, so permuting all lanes is one instruction. NEON has no
//! mask registers: a comparison is narrowed to one bit per lane, and a mask is widened to all ones per lane. Compression
//! looks up the order of four lanes at a time.
//!
//! Source: Arm Architecture Reference Manual for A-profile, "Advanced SIMD and floating-point instructions".

use super::instructions::{Kernel, Simd};
use super::lanes::{LANES, Lanes, Mask, Rows};
use super::neon_doubles::Four;
use super::network::sort_network;
use super::operators::operators;
use core::arch::aarch64::*;
use core::mem::MaybeUninit;

/// Token of NEON.
#[derive(Clone, Copy)]
struct Neon;

/// Runs a kernel. A function of its own, so that each kernel is compiled once and not wherever it is dispatched.
#[inline(never)]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Neon)
}

/// Sixteen floats, lowest lanes first.
#[derive(Clone, Copy)]
struct F([float32x4_t; 4]);

/// Sixteen integers, lowest lanes first.
#[derive(Clone, Copy)]
struct U([uint32x4_t; 4]);

/// An intrinsic of registers, without memory operands.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: NEON is part of AArch64.
        unsafe { $call }
    };
}

/// The numbers 0 to 15.
const BYTES: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// For each mask of four lanes the bytes of those lanes, compressed to the front. The rest is unspecified.
const COMPRESS: [[u8; 16]; 16] = {
    let mut table = [[0; 16]; 16];
    let mut mask = 0;
    while mask < 16 {
        let (mut lane, mut n) = (0, 0);
        while lane < 4 {
            if mask >> lane & 1 != 0 {
                let mut byte = 0;
                while byte < 4 {
                    table[mask][4 * n + byte] = (4 * lane + byte) as u8;
                    byte += 1;
                }
                n += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

/// Reads a constant vector.
#[inline(always)]
fn bytes(from: &[u8; 16]) -> uint8x16_t {
    // SAFETY: sixteen bytes, at any alignment.
    unsafe { vld1q_u8(from.as_ptr()) }
}

/// One bit for each lane of four vectors of all ones or zeros.
#[inline(always)]
fn mask_of([a, b, c, d]: [uint32x4_t; 4]) -> Mask {
    let low = intrinsic!(vcombine_u16(vmovn_u32(a), vmovn_u32(b)));
    let high = intrinsic!(vcombine_u16(vmovn_u32(c), vmovn_u32(d)));
    let lanes = intrinsic!(vcombine_u8(vmovn_u16(low), vmovn_u16(high)));
    let bits = intrinsic!(vandq_u8(lanes, bytes(&[1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128])));
    let low = intrinsic!(vaddv_u8(vget_low_u8(bits)));
    let high = intrinsic!(vaddv_u8(vget_high_u8(bits)));
    Mask::from(low) | Mask::from(high) << 8
}

/// The lanes of a mask of four, compressed to the front.
#[inline(always)]
fn compressed(four: uint32x4_t, mask: Mask) -> uint32x4_t {
    let order = bytes(&COMPRESS[usize::from(mask) % 16]);
    intrinsic!(vreinterpretq_u32_u8(vqtbl1q_u8(vreinterpretq_u8_u32(four), order)))
}

impl F {
    #[inline(always)]
    fn map(self, F(b): F, f: impl Fn(float32x4_t, float32x4_t) -> float32x4_t) -> F {
        let F(a) = self;
        F([f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]), f(a[3], b[3])])
    }

    #[inline(always)]
    fn compare(self, F(b): F, f: impl Fn(float32x4_t, float32x4_t) -> uint32x4_t) -> Mask {
        let F(a) = self;
        mask_of([f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]), f(a[3], b[3])])
    }

    /// The same of the bits as signed integers.
    #[inline(always)]
    fn map_signed(self, b: F, f: impl Fn(int32x4_t, int32x4_t) -> int32x4_t) -> F {
        self.map(b, |a, b| {
            let of = f(intrinsic!(vreinterpretq_s32_f32(a)), intrinsic!(vreinterpretq_s32_f32(b)));
            intrinsic!(vreinterpretq_f32_s32(of))
        })
    }

    #[inline(always)]
    fn bits(self) -> U {
        let F([a, b, c, d]) = self;
        U([
            intrinsic!(vreinterpretq_u32_f32(a)),
            intrinsic!(vreinterpretq_u32_f32(b)),
            intrinsic!(vreinterpretq_u32_f32(c)),
            intrinsic!(vreinterpretq_u32_f32(d)),
        ])
    }

    #[inline(always)]
    fn of_bits(U([a, b, c, d]): U) -> F {
        F([
            intrinsic!(vreinterpretq_f32_u32(a)),
            intrinsic!(vreinterpretq_f32_u32(b)),
            intrinsic!(vreinterpretq_f32_u32(c)),
            intrinsic!(vreinterpretq_f32_u32(d)),
        ])
    }

    /// All lanes as the table of a lookup.
    #[inline(always)]
    fn table(self) -> uint8x16x4_t {
        let F([a, b, c, d]) = self;
        uint8x16x4_t(
            intrinsic!(vreinterpretq_u8_f32(a)),
            intrinsic!(vreinterpretq_u8_f32(b)),
            intrinsic!(vreinterpretq_u8_f32(c)),
            intrinsic!(vreinterpretq_u8_f32(d)),
        )
    }
}

/// Four lanes of a table, each selected by the lowest four bits of its index.
#[inline(always)]
fn look_up(table: uint8x16x4_t, index: uint32x4_t) -> float32x4_t {
    let lane = intrinsic!(vandq_u32(index, vdupq_n_u32(LANES as u32 - 1)));
    // The four bytes of lane `i` are at `4i`, `4i + 1`, `4i + 2` and `4i + 3`.
    let bytes = intrinsic!(vmlaq_u32(vdupq_n_u32(0x0302_0100), lane, vdupq_n_u32(0x0404_0404)));
    intrinsic!(vreinterpretq_f32_u8(vqtbl4q_u8(table, vreinterpretq_u8_u32(bytes))))
}

impl U {
    #[inline(always)]
    fn map(self, U(b): U, f: impl Fn(uint32x4_t, uint32x4_t) -> uint32x4_t) -> U {
        let U(a) = self;
        U([f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]), f(a[3], b[3])])
    }

    /// All ones in the lanes of the mask.
    #[inline(always)]
    fn from_mask(mask: Mask) -> U {
        let all = intrinsic!(vdupq_n_u32(u32::from(mask)));
        let first: [u32; 4] = [1, 2, 4, 8];
        // SAFETY: four integers, at any alignment.
        let first = unsafe { vld1q_u32(first.as_ptr()) };
        U([
            intrinsic!(vtstq_u32(all, first)),
            intrinsic!(vtstq_u32(all, vshlq_n_u32::<4>(first))),
            intrinsic!(vtstq_u32(all, vshlq_n_u32::<8>(first))),
            intrinsic!(vtstq_u32(all, vshlq_n_u32::<12>(first))),
        ])
    }

    /// `a` where `self` is all ones, `b` where it is zero.
    #[inline(always)]
    fn choose(self, U(a): U, U(b): U) -> U {
        let U(of) = self;
        let four = |i: usize| intrinsic!(vbslq_u32(of[i], a[i], b[i]));
        U([four(0), four(1), four(2), four(3)])
    }
}

/// Row `i`, followed by zeros.
#[inline(always)]
fn row(rows: &Rows, at: *const f32) -> F {
    let n = rows.n;
    if n < 4 {
        return short_row(n, at);
    }
    let four = |first: usize| {
        // The last four floats of the row, if it ends before the requested four.
        let begin = first.min(n - 4);
        // SAFETY: `begin + 4` is at most `n`, and `at` has as many floats.
        let window = unsafe { vld1q_u8(at.add(begin).cast()) };
        // Bytes beyond the sixteen of the window are zero.
        let from = intrinsic!(vaddq_u8(bytes(&BYTES), vdupq_n_u8((4 * (first - begin)) as u8)));
        intrinsic!(vreinterpretq_f32_u8(vqtbl1q_u8(window, from)))
    };
    F([four(0), four(4), four(8), four(12)])
}

/// Likewise for a row of fewer than four floats.
#[inline(never)]
fn short_row(n: usize, at: *const f32) -> F {
    let mut lanes = [0.0f32; LANES];
    for (i, lane) in lanes.iter_mut().enumerate().take(n) {
        // SAFETY: `at` has `n` floats.
        *lane = unsafe { *at.add(i) };
    }
    Neon.load(&lanes)
}

/// The lanes in ascending order. Not inlined, since each of its many callers would contain the whole network.
#[inline(never)]
fn sort(a: &mut U) {
    *a = sort_network(Neon, *a);
}

operators!(F:
    Add add |a, b| a.map(b, |a, b| intrinsic!(vaddq_f32(a, b)));
    Sub sub |a, b| a.map(b, |a, b| intrinsic!(vsubq_f32(a, b)));
    Mul mul |a, b| a.map(b, |a, b| intrinsic!(vmulq_f32(a, b)));
    Div div |a, b| a.map(b, |a, b| intrinsic!(vdivq_f32(a, b)));
);

operators!(U:
    BitAnd bitand |a, b| a.map(b, |a, b| intrinsic!(vandq_u32(a, b)));
    BitOr bitor |a, b| a.map(b, |a, b| intrinsic!(vorrq_u32(a, b)));
);

impl Simd for Neon {
    type F = F;
    type U = U;
    type D = Four;

    const HALVES: bool = true;

    #[inline(always)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        run(kernel)
    }

    #[inline(always)]
    fn splat(self, x: f32) -> F {
        F([intrinsic!(vdupq_n_f32(x)); 4])
    }
    #[inline(always)]
    fn load(self, from: &Lanes<f32>) -> F {
        // SAFETY: each load reads four of the sixteen floats, at any alignment.
        let four = |i: usize| unsafe { vld1q_f32(from.as_ptr().add(4 * i)) };
        F([four(0), four(1), four(2), four(3)])
    }
    #[inline(always)]
    fn lower_half(self, F([a, b, ..]): F) -> F {
        F([a, b, a, b])
    }
    #[inline(always)]
    fn load_row(self, rows: &Rows, i: usize) -> F {
        row(rows, rows.row(i))
    }
    #[inline(always)]
    fn load_thirds(self, rows: &Rows, first: usize) -> [F; 3] {
        let [a, b, c] = rows.thirds(first);
        [row(rows, a), row(rows, b), row(rows, c)]
    }
    #[inline(always)]
    fn store(self, F(x): F, to: &mut Lanes<f32>) {
        let at = to.as_mut_ptr();
        // SAFETY: each store writes four of the sixteen floats, at any alignment.
        let four = |i: usize| unsafe { vst1q_f32(at.add(4 * i), x[i]) };
        four(0);
        four(1);
        four(2);
        four(3);
    }
    #[inline(always)]
    fn mul_add(self, F(a): F, F(b): F, F(c): F) -> F {
        let four = |i: usize| intrinsic!(vfmaq_f32(c[i], a[i], b[i]));
        F([four(0), four(1), four(2), four(3)])
    }
    #[inline(always)]
    fn negated_mul_add(self, F(a): F, F(b): F, F(c): F) -> F {
        let four = |i: usize| intrinsic!(vfmsq_f32(c[i], a[i], b[i]));
        F([four(0), four(1), four(2), four(3)])
    }
    #[inline(always)]
    fn mul_add_one(self, a: f32, b: f32, c: f32) -> f32 {
        a.mul_add(b, c)
    }
    // Not `fmin` and `fmax`, which differ for NaN and zeros of both signs.
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        a.map(a, |a, _| intrinsic!(vsqrtq_f32(a)))
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        a.map(b, |a, b| intrinsic!(vbslq_f32(vcltq_f32(a, b), a, b)))
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        a.map(b, |a, b| intrinsic!(vbslq_f32(vcgtq_f32(a, b), a, b)))
    }
    #[inline(always)]
    fn max_signed(self, a: F, b: F) -> F {
        a.map_signed(b, |a, b| intrinsic!(vmaxq_s32(a, b)))
    }
    #[inline(always)]
    fn min_signed(self, a: F, b: F) -> F {
        a.map_signed(b, |a, b| intrinsic!(vminq_s32(a, b)))
    }
    #[inline(always)]
    fn le_signed(self, a: F, b: F) -> Mask {
        a.compare(b, |a, b| intrinsic!(vcleq_s32(vreinterpretq_s32_f32(a), vreinterpretq_s32_f32(b))))
    }
    #[inline(always)]
    fn max_with_zero(self, a: F, b: F) -> F {
        self.max_signed(self.max_signed(a, b), self.splat(0.0))
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> Mask {
        a.compare(b, |a, b| intrinsic!(vcltq_f32(a, b)))
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> Mask {
        a.compare(b, |a, b| intrinsic!(vcleq_f32(a, b)))
    }
    #[inline(always)]
    fn eq(self, a: F, b: F) -> Mask {
        a.compare(b, |a, b| intrinsic!(vceqq_f32(a, b)))
    }
    #[inline(always)]
    fn select(self, mask: Mask, a: F, b: F) -> F {
        F::of_bits(U::from_mask(mask).choose(a.bits(), b.bits()))
    }
    #[inline(always)]
    fn permute(self, a: F, U(index): U) -> F {
        let table = a.table();
        let four = |i: usize| look_up(table, index[i]);
        F([four(0), four(1), four(2), four(3)])
    }
    #[inline(always)]
    fn lane(self, a: F, i: usize) -> f32 {
        let mut lanes = [0.0; LANES];
        self.store(a, &mut lanes);
        lanes[i]
    }
    #[inline(always)]
    fn store_compressed(self, a: F, mask: Mask, to: &mut Lanes<f32>) {
        let U(from) = a.bits();
        let at = to.as_mut_ptr();
        let mut n = 0;
        for (i, four) in from.into_iter().enumerate() {
            let of = mask >> (4 * i) & 15;
            // SAFETY: `n` is at most four for each vector before this one, so that four lanes more are inside.
            unsafe { vst1q_f32(at.add(n), vreinterpretq_f32_u32(compressed(four, of))) };
            n += of.count_ones() as usize;
        }
    }
    #[inline(always)]
    fn to_bits(self, a: F) -> U {
        a.bits()
    }
    #[inline(always)]
    fn from_bits(self, a: U) -> F {
        F::of_bits(a)
    }

    #[inline(always)]
    fn splat_u(self, x: u32) -> U {
        U([intrinsic!(vdupq_n_u32(x)); 4])
    }
    #[inline(always)]
    fn load_u(self, from: &Lanes<u32>) -> U {
        // SAFETY: each load reads four of the sixteen integers, at any alignment.
        let four = |i: usize| unsafe { vld1q_u32(from.as_ptr().add(4 * i)) };
        U([four(0), four(1), four(2), four(3)])
    }
    #[inline(always)]
    fn store_u(self, U(x): U, to: &mut Lanes<u32>) {
        let at = to.as_mut_ptr();
        // SAFETY: each store writes four of the sixteen integers, at any alignment.
        let four = |i: usize| unsafe { vst1q_u32(at.add(4 * i), x[i]) };
        four(0);
        four(1);
        four(2);
        four(3);
    }
    #[inline(always)]
    fn shift_right<const BITS: u32>(self, a: U) -> U {
        // A left shift by a negative count is a right shift.
        let by = intrinsic!(vdupq_n_s32(-(BITS as i32)));
        a.map(a, |a, _| intrinsic!(vshlq_u32(a, by)))
    }
    #[inline(always)]
    fn min_u(self, a: U, b: U) -> U {
        a.map(b, |a, b| intrinsic!(vminq_u32(a, b)))
    }
    #[inline(always)]
    fn max_u(self, a: U, b: U) -> U {
        a.map(b, |a, b| intrinsic!(vmaxq_u32(a, b)))
    }
    #[inline(always)]
    fn swap_lanes_u<const D: usize>(self, a: U) -> U {
        let neighbors = |a| intrinsic!(vrev64q_u32(a));
        let pairs = |a| intrinsic!(vextq_u32::<2>(a, a));
        let U(within) = match D % 4 {
            0 => a,
            1 => a.map(a, |a, _| neighbors(a)),
            2 => a.map(a, |a, _| pairs(a)),
            _ => a.map(a, |a, _| pairs(neighbors(a))),
        };
        U([within[D / 4], within[1 ^ (D / 4)], within[2 ^ (D / 4)], within[3 ^ (D / 4)]])
    }
    #[inline(always)]
    fn sort_u(self, mut a: U) -> U {
        sort(&mut a);
        a
    }
    #[inline(always)]
    fn add_u(self, a: U, b: U) -> U {
        a.map(b, |a, b| intrinsic!(vaddq_u32(a, b)))
    }
    #[inline(always)]
    fn eq_u(self, U(a): U, U(b): U) -> Mask {
        let four = |i: usize| intrinsic!(vceqq_u32(a[i], b[i]));
        mask_of([four(0), four(1), four(2), four(3)])
    }
    #[inline(always)]
    fn lt_u(self, U(a): U, U(b): U) -> Mask {
        let four = |i: usize| intrinsic!(vcltq_u32(a[i], b[i]));
        mask_of([four(0), four(1), four(2), four(3)])
    }
    #[inline(always)]
    fn select_u(self, mask: Mask, a: U, b: U) -> U {
        U::from_mask(mask).choose(a, b)
    }
    #[inline(always)]
    fn reduce_min_u(self, U([a, b, c, d]): U) -> u32 {
        intrinsic!(vminvq_u32(vminq_u32(vminq_u32(a, b), vminq_u32(c, d))))
    }
    #[inline(always)]
    fn store_compressed_u(self, U(from): U, mask: Mask, to: &mut Lanes<u32>) {
        let at = to.as_mut_ptr();
        let mut n = 0;
        for (i, four) in from.into_iter().enumerate() {
            let of = mask >> (4 * i) & 15;
            // SAFETY: as in `store_compressed`.
            unsafe { vst1q_u32(at.add(n), compressed(four, of)) };
            n += of.count_ones() as usize;
        }
    }
    #[inline(always)]
    fn store_compressed_wide(self, U(from): U, mask: Mask, to: &mut Lanes<MaybeUninit<u64>>) {
        let at: *mut u64 = to.as_mut_ptr().cast();
        let mut n = 0;
        for (i, four) in from.into_iter().enumerate() {
            let of = mask >> (4 * i) & 15;
            let lanes = compressed(four, of);
            // SAFETY: as in `store_compressed`.
            unsafe {
                vst1q_u64(at.add(n), vmovl_u32(vget_low_u32(lanes)));
                vst1q_u64(at.add(n + 2), vmovl_high_u32(lanes));
            }
            n += of.count_ones() as usize;
        }
    }

    #[inline(always)]
    fn splat_d(self, x: f64) -> Four {
        Four(intrinsic!(vdupq_n_f64(x)), intrinsic!(vdupq_n_f64(x)))
    }
    #[inline(always)]
    fn load_d(self, from: &[f64; 4]) -> Four {
        // SAFETY: each load reads two of the four, at any alignment.
        unsafe { Four(vld1q_f64(from.as_ptr()), vld1q_f64(from.as_ptr().add(2))) }
    }
    #[inline(always)]
    fn widen(self, [a, b, c]: [f32; 3]) -> Four {
        self.widen_four(&[a, b, c, 0.0])
    }
    #[inline(always)]
    fn pick_four(self, a: F, numbers: u32) -> Four {
        let places: [i32; 4] = [0, -4, -8, -12];
        // SAFETY: four integers, at any alignment.
        let places = unsafe { vld1q_s32(places.as_ptr()) };
        Four::widened(look_up(a.table(), intrinsic!(vshlq_u32(vdupq_n_u32(numbers), places))))
    }
    #[inline(always)]
    fn rotate_left(self, Four(ab, cd): Four) -> Four {
        Four(intrinsic!(vextq_f64::<1>(ab, cd)), intrinsic!(vcombine_f64(vget_low_f64(ab), vget_high_f64(cd))))
    }
    #[inline(always)]
    fn rotate_right(self, Four(ab, cd): Four) -> Four {
        Four(intrinsic!(vzip1q_f64(cd, ab)), intrinsic!(vzip2q_f64(ab, cd)))
    }
    #[inline(always)]
    fn lanes_d(self, a: Four) -> [f64; 4] {
        let mut lanes = [0.0; 4];
        // SAFETY: each store writes two of the four, at any alignment.
        unsafe {
            vst1q_f64(lanes.as_mut_ptr(), a.0);
            vst1q_f64(lanes.as_mut_ptr().add(2), a.1);
        }
        lanes
    }
    #[inline(always)]
    fn widen_four(self, from: &[f32; 4]) -> Four {
        // SAFETY: four floats, at any alignment.
        Four::widened(unsafe { vld1q_f32(from.as_ptr()) })
    }
    #[inline(always)]
    fn narrow(self, a: Four) -> [f32; 4] {
        let mut lanes = [0.0; 4];
        // SAFETY: four floats, at any alignment.
        unsafe { vst1q_f32(lanes.as_mut_ptr(), a.narrowed()) };
        lanes
    }
    #[inline(always)]
    fn narrow_all(self, [a, b, c, d]: [Four; 4]) -> F {
        F([a.narrowed(), b.narrowed(), c.narrowed(), d.narrowed()])
    }
    #[inline(always)]
    fn transpose_d(self, [a, b, c, d]: [Four; 4]) -> [Four; 4] {
        let first = |a, b| intrinsic!(vzip1q_f64(a, b));
        let second = |a, b| intrinsic!(vzip2q_f64(a, b));
        [
            Four(first(a.0, b.0), first(c.0, d.0)),
            Four(second(a.0, b.0), second(c.0, d.0)),
            Four(first(a.1, b.1), first(c.1, d.1)),
            Four(second(a.1, b.1), second(c.1, d.1)),
        ]
    }
    #[inline(always)]
    fn sqrt_d(self, a: Four) -> Four {
        a.map(a, |a, _| intrinsic!(vsqrtq_f64(a)))
    }
    #[inline(always)]
    fn min_d(self, a: Four, b: Four) -> Four {
        a.map(b, |a, b| intrinsic!(vbslq_f64(vcltq_f64(a, b), a, b)))
    }
    #[inline(always)]
    fn max_d(self, a: Four, b: Four) -> Four {
        a.map(b, |a, b| intrinsic!(vbslq_f64(vcgtq_f64(a, b), a, b)))
    }
    #[inline(always)]
    fn le_d(self, a: Four, b: Four) -> Mask {
        let low = intrinsic!(vmovn_u64(vcleq_f64(a.0, b.0)));
        let high = intrinsic!(vmovn_u64(vcleq_f64(a.1, b.1)));
        let bits: [u32; 4] = [1, 2, 4, 8];
        // SAFETY: four integers, at any alignment.
        let bits = unsafe { vld1q_u32(bits.as_ptr()) };
        intrinsic!(vaddvq_u32(vandq_u32(vcombine_u32(low, high), bits))) as Mask
    }
    #[inline(always)]
    fn select_le(self, x: Four, y: Four, a: Four, b: Four) -> Four {
        Four(intrinsic!(vbslq_f64(vcleq_f64(x.0, y.0), a.0, b.0)), intrinsic!(vbslq_f64(vcleq_f64(x.1, y.1), a.1, b.1)))
    }
}
