//! Sixteen lanes in four SSE2 registers, which every x86-64 CPU has.
//!
//! For CPUs without anything wider. The plain lanes ([`super::portable`]) would do as well, but kernels over them are
//! more machine code (docs/notes_rays_tried.md). The few operations that SSE2 has no instruction for go through memory, in
//! functions that are not inlined.

use super::instructions::{Kernel, Simd};
use super::lanes::{LANES, Lanes, Mask, Rows};
use super::network::sort_network;
use super::operators::operators;
use core::arch::x86_64::*;
use core::mem::MaybeUninit;

/// Token of SSE2.
#[derive(Clone, Copy)]
struct Sse2;

/// Runs a kernel. A function of its own, so that each kernel is compiled once and not wherever it is dispatched.
#[inline(never)]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Sse2)
}

/// Sixteen floats, lowest lanes first.
#[derive(Clone, Copy)]
pub(super) struct F([__m128; 4]);

/// Sixteen integers, lowest lanes first.
#[derive(Clone, Copy)]
pub(super) struct U([__m128i; 4]);

/// Four f64, low half first.
#[derive(Clone, Copy)]
pub(super) struct Four(__m128d, __m128d);

/// An intrinsic of registers, without memory operands.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: SSE2 is part of x86-64.
        unsafe { $call }
    };
}

impl Four {
    #[inline(always)]
    fn narrowed(self) -> __m128 {
        intrinsic!(_mm_movelh_ps(_mm_cvtpd_ps(self.0), _mm_cvtpd_ps(self.1)))
    }
}

impl F {
    #[inline(always)]
    fn map(self, F(b): F, f: impl Fn(__m128, __m128) -> __m128) -> F {
        let F(a) = self;
        F([f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]), f(a[3], b[3])])
    }

    /// The signs of the result of `f` on the registers.
    #[inline(always)]
    fn compare(self, F(b): F, f: impl Fn(__m128, __m128) -> __m128) -> Mask {
        let F(a) = self;
        let signs = |i: usize| intrinsic!(_mm_movemask_ps(f(a[i], b[i])));
        (signs(0) | signs(1) << 4 | signs(2) << 8 | signs(3) << 12) as Mask
    }

    #[inline(always)]
    fn bits(self) -> U {
        let F([a, b, c, d]) = self;
        U([
            intrinsic!(_mm_castps_si128(a)),
            intrinsic!(_mm_castps_si128(b)),
            intrinsic!(_mm_castps_si128(c)),
            intrinsic!(_mm_castps_si128(d)),
        ])
    }

    #[inline(always)]
    fn of_bits(U([a, b, c, d]): U) -> F {
        F([
            intrinsic!(_mm_castsi128_ps(a)),
            intrinsic!(_mm_castsi128_ps(b)),
            intrinsic!(_mm_castsi128_ps(c)),
            intrinsic!(_mm_castsi128_ps(d)),
        ])
    }
}

impl U {
    #[inline(always)]
    fn map(self, U(b): U, f: impl Fn(__m128i, __m128i) -> __m128i) -> U {
        let U(a) = self;
        U([f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]), f(a[3], b[3])])
    }

    #[inline(always)]
    fn signs(self) -> Mask {
        let of = F::of_bits(self);
        of.compare(of, |a, _| a)
    }

    /// All ones in the lanes of the mask.
    #[inline(always)]
    fn from_mask(mask: Mask) -> U {
        let all = intrinsic!(_mm_set1_epi32(i32::from(mask)));
        let four = |bits: __m128i| intrinsic!(_mm_cmpeq_epi32(_mm_and_si128(all, bits), bits));
        let low = intrinsic!(_mm_setr_epi32(1, 2, 4, 8));
        let [second, third] = [intrinsic!(_mm_slli_epi32::<4>(low)), intrinsic!(_mm_slli_epi32::<8>(low))];
        U([four(low), four(second), four(third), four(intrinsic!(_mm_slli_epi32::<12>(low)))])
    }

    /// `a` where `self` is all ones, `b` where it is zero.
    #[inline(always)]
    fn choose(self, a: U, b: U) -> U {
        let not_b = self.map(b, |m, b| intrinsic!(_mm_andnot_si128(m, b)));
        (self & a) | not_b
    }

    /// All ones where `self` is greater as a signed integer.
    #[inline(always)]
    fn above(self, b: U) -> U {
        self.map(b, |a, b| intrinsic!(_mm_cmpgt_epi32(a, b)))
    }

    /// With the topmost bits flipped, signed comparisons give the results of unsigned ones.
    #[inline(always)]
    fn turned(self) -> U {
        let top = intrinsic!(_mm_set1_epi32(i32::MIN));
        self.map(self, |a, _| intrinsic!(_mm_xor_si128(a, top)))
    }

    #[inline(always)]
    fn read(from: &Lanes<u32>) -> U {
        // SAFETY: each load reads four of the sixteen integers, at any alignment.
        let four = |i: usize| unsafe { _mm_loadu_si128(from.as_ptr().add(4 * i).cast()) };
        U([four(0), four(1), four(2), four(3)])
    }

    #[inline(always)]
    fn write(self, to: &mut Lanes<u32>) {
        let at: *mut __m128i = to.as_mut_ptr().cast();
        // SAFETY: each store writes four of the sixteen integers, at any alignment. (A loop takes the compiler far
        // longer, and this is all over the crate.)
        let four = |i: usize| unsafe { _mm_storeu_si128(at.add(i), self.0[i]) };
        four(0);
        four(1);
        four(2);
        four(3);
    }

    #[inline(always)]
    fn in_memory(self) -> Lanes<u32> {
        let mut lanes = [0; LANES];
        self.write(&mut lanes);
        lanes
    }
}

/// Compresses the lanes of the mask to the front.
#[inline(never)]
fn compress<T>(a: &Lanes<u32>, mask: Mask, to: &mut Lanes<T>, of: impl Fn(u32) -> T) {
    let (mut rest, mut n) = (mask, 0);
    while rest != 0 {
        to[n] = of(a[rest.trailing_zeros() as usize]);
        rest &= rest - 1;
        n += 1;
    }
}

/// Lane `i` becomes the lane of `a` that the lowest four bits of lane `i` of `index` select.
#[inline(never)]
fn permute(a: &Lanes<u32>, index: &Lanes<u32>, to: &mut Lanes<u32>) {
    for (to, &i) in to.iter_mut().zip(index) {
        *to = a[i as usize % LANES];
    }
}

/// The lanes in ascending order. Not inlined, since each of its many callers would contain the whole network.
#[inline(never)]
fn sort(a: &mut U) {
    *a = sort_network(Sse2, *a);
}

/// The least lane. Not inlined for the same reason.
#[inline(never)]
fn least(&a: &U) -> u32 {
    let eight = Sse2.min_u(a, Sse2.swap_lanes_u::<8>(a));
    let four = Sse2.min_u(eight, Sse2.swap_lanes_u::<4>(eight));
    let two = Sse2.min_u(four, Sse2.swap_lanes_u::<2>(four));
    let U([one, ..]) = Sse2.min_u(two, Sse2.swap_lanes_u::<1>(two));
    intrinsic!(_mm_cvtsi128_si32(one)) as u32
}

/// Row `i`, followed by zeros.
#[inline(never)]
fn row(rows: &Rows, i: usize, to: &mut Lanes<f32>) {
    to[..rows.n].copy_from_slice(&rows.words[i * rows.n..(i + 1) * rows.n]);
}

operators!(F:
    Add add |a, b| a.map(b, |a, b| intrinsic!(_mm_add_ps(a, b)));
    Sub sub |a, b| a.map(b, |a, b| intrinsic!(_mm_sub_ps(a, b)));
    Mul mul |a, b| a.map(b, |a, b| intrinsic!(_mm_mul_ps(a, b)));
    Div div |a, b| a.map(b, |a, b| intrinsic!(_mm_div_ps(a, b)));
);

operators!(U:
    BitAnd bitand |a, b| a.map(b, |a, b| intrinsic!(_mm_and_si128(a, b)));
    BitOr bitor |a, b| a.map(b, |a, b| intrinsic!(_mm_or_si128(a, b)));
);

operators!(Four:
    Add add |a, b| Four(intrinsic!(_mm_add_pd(a.0, b.0)), intrinsic!(_mm_add_pd(a.1, b.1)));
    Sub sub |a, b| Four(intrinsic!(_mm_sub_pd(a.0, b.0)), intrinsic!(_mm_sub_pd(a.1, b.1)));
    Div div |a, b| Four(intrinsic!(_mm_div_pd(a.0, b.0)), intrinsic!(_mm_div_pd(a.1, b.1)));
    Mul mul |a, b| Four(intrinsic!(_mm_mul_pd(a.0, b.0)), intrinsic!(_mm_mul_pd(a.1, b.1)));
);

impl Simd for Sse2 {
    type F = F;
    type U = U;
    type D = Four;

    #[inline(always)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        run(kernel)
    }

    #[inline(always)]
    fn splat(self, x: f32) -> F {
        F([intrinsic!(_mm_set1_ps(x)); 4])
    }
    #[inline(always)]
    fn load(self, from: &Lanes<f32>) -> F {
        // SAFETY: each load reads four of the sixteen floats, at any alignment.
        let four = |i: usize| unsafe { _mm_loadu_ps(from.as_ptr().add(4 * i)) };
        F([four(0), four(1), four(2), four(3)])
    }
    #[inline(always)]
    fn load_row(self, rows: &Rows, i: usize) -> F {
        let mut lanes = [0.0; LANES];
        row(rows, i, &mut lanes);
        self.load(&lanes)
    }
    #[inline(always)]
    fn store(self, x: F, to: &mut Lanes<f32>) {
        let at = to.as_mut_ptr();
        // SAFETY: each store writes four of the sixteen floats, at any alignment.
        let four = |i: usize| unsafe { _mm_storeu_ps(at.add(4 * i), x.0[i]) };
        four(0);
        four(1);
        four(2);
        four(3);
    }
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        a.map(a, |a, _| intrinsic!(_mm_sqrt_ps(a)))
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        a.map(b, |a, b| intrinsic!(_mm_min_ps(a, b)))
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        a.map(b, |a, b| intrinsic!(_mm_max_ps(a, b)))
    }
    #[inline(always)]
    fn max_signed(self, a: F, b: F) -> F {
        let (a, b) = (a.bits(), b.bits());
        F::of_bits(a.above(b).choose(a, b))
    }
    #[inline(always)]
    fn min_signed(self, a: F, b: F) -> F {
        let (a, b) = (a.bits(), b.bits());
        F::of_bits(b.above(a).choose(a, b))
    }
    #[inline(always)]
    fn le_signed(self, a: F, b: F) -> Mask {
        !a.bits().above(b.bits()).signs()
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> Mask {
        a.compare(b, |a, b| intrinsic!(_mm_cmplt_ps(a, b)))
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> Mask {
        a.compare(b, |a, b| intrinsic!(_mm_cmple_ps(a, b)))
    }
    #[inline(always)]
    fn eq(self, a: F, b: F) -> Mask {
        a.compare(b, |a, b| intrinsic!(_mm_cmpeq_ps(a, b)))
    }
    #[inline(always)]
    fn select(self, mask: Mask, a: F, b: F) -> F {
        F::of_bits(U::from_mask(mask).choose(a.bits(), b.bits()))
    }
    #[inline(always)]
    fn permute(self, a: F, index: U) -> F {
        let mut to = [0; LANES];
        permute(&a.bits().in_memory(), &index.in_memory(), &mut to);
        F::of_bits(U::read(&to))
    }
    #[inline(always)]
    fn lane(self, a: F, i: usize) -> f32 {
        f32::from_bits(a.bits().in_memory()[i])
    }
    #[inline(always)]
    fn store_compressed(self, a: F, mask: Mask, to: &mut Lanes<f32>) {
        compress(&a.bits().in_memory(), mask, to, f32::from_bits);
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
        U([intrinsic!(_mm_set1_epi32(x as i32)); 4])
    }
    #[inline(always)]
    fn load_u(self, from: &Lanes<u32>) -> U {
        U::read(from)
    }
    #[inline(always)]
    fn store_u(self, x: U, to: &mut Lanes<u32>) {
        x.write(to);
    }
    #[inline(always)]
    fn shift_right<const BITS: u32>(self, a: U) -> U {
        let count = intrinsic!(_mm_cvtsi32_si128(BITS as i32));
        a.map(a, |a, _| intrinsic!(_mm_srl_epi32(a, count)))
    }
    #[inline(always)]
    fn min_u(self, a: U, b: U) -> U {
        b.turned().above(a.turned()).choose(a, b)
    }
    #[inline(always)]
    fn max_u(self, a: U, b: U) -> U {
        a.turned().above(b.turned()).choose(a, b)
    }
    #[inline(always)]
    fn swap_lanes_u<const D: usize>(self, a: U) -> U {
        let U(within) = match D % 4 {
            0 => a,
            1 => a.map(a, |a, _| intrinsic!(_mm_shuffle_epi32::<0b10_11_00_01>(a))),
            2 => a.map(a, |a, _| intrinsic!(_mm_shuffle_epi32::<0b01_00_11_10>(a))),
            _ => a.map(a, |a, _| intrinsic!(_mm_shuffle_epi32::<0b00_01_10_11>(a))),
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
        a.map(b, |a, b| intrinsic!(_mm_add_epi32(a, b)))
    }
    #[inline(always)]
    fn eq_u(self, a: U, b: U) -> Mask {
        a.map(b, |a, b| intrinsic!(_mm_cmpeq_epi32(a, b))).signs()
    }
    #[inline(always)]
    fn lt_u(self, a: U, b: U) -> Mask {
        b.turned().above(a.turned()).signs()
    }
    #[inline(always)]
    fn select_u(self, mask: Mask, a: U, b: U) -> U {
        U::from_mask(mask).choose(a, b)
    }
    #[inline(always)]
    fn reduce_min_u(self, a: U) -> u32 {
        least(&a)
    }
    #[inline(always)]
    fn store_compressed_u(self, a: U, mask: Mask, to: &mut Lanes<u32>) {
        compress(&a.in_memory(), mask, to, |lane| lane);
    }
    #[inline(always)]
    fn store_compressed_wide(self, a: U, mask: Mask, to: &mut Lanes<MaybeUninit<u64>>) {
        compress(&a.in_memory(), mask, to, |lane| MaybeUninit::new(u64::from(lane)));
    }

    #[inline(always)]
    fn splat_d(self, x: f64) -> Four {
        Four(intrinsic!(_mm_set1_pd(x)), intrinsic!(_mm_set1_pd(x)))
    }
    #[inline(always)]
    fn load_d(self, from: &[f64; 4]) -> Four {
        Four(intrinsic!(_mm_setr_pd(from[0], from[1])), intrinsic!(_mm_setr_pd(from[2], from[3])))
    }
    #[inline(always)]
    fn widen(self, [a, b, c]: [f32; 3]) -> Four {
        Four(intrinsic!(_mm_setr_pd(f64::from(a), f64::from(b))), intrinsic!(_mm_setr_pd(f64::from(c), 0.0)))
    }
    #[inline(always)]
    fn pick_four(self, a: F, numbers: u32) -> Four {
        let from = a.bits().in_memory();
        let lane = |i: u32| f64::from(f32::from_bits(from[(numbers >> (4 * i)) as usize % LANES]));
        Four(intrinsic!(_mm_setr_pd(lane(0), lane(1))), intrinsic!(_mm_setr_pd(lane(2), lane(3))))
    }
    #[inline(always)]
    fn rotate_left(self, Four(ab, cd): Four) -> Four {
        Four(intrinsic!(_mm_shuffle_pd::<0b01>(ab, cd)), intrinsic!(_mm_shuffle_pd::<0b10>(ab, cd)))
    }
    #[inline(always)]
    fn rotate_right(self, Four(ab, cd): Four) -> Four {
        Four(intrinsic!(_mm_shuffle_pd::<0b00>(cd, ab)), intrinsic!(_mm_shuffle_pd::<0b11>(ab, cd)))
    }
    #[inline(always)]
    fn lanes_d(self, Four(ab, cd): Four) -> [f64; 4] {
        [
            intrinsic!(_mm_cvtsd_f64(ab)),
            intrinsic!(_mm_cvtsd_f64(_mm_unpackhi_pd(ab, ab))),
            intrinsic!(_mm_cvtsd_f64(cd)),
            intrinsic!(_mm_cvtsd_f64(_mm_unpackhi_pd(cd, cd))),
        ]
    }
    #[inline(always)]
    fn widen_four(self, from: &[f32; 4]) -> Four {
        let x = intrinsic!(_mm_loadu_ps(from.as_ptr()));
        Four(intrinsic!(_mm_cvtps_pd(x)), intrinsic!(_mm_cvtps_pd(_mm_movehl_ps(x, x))))
    }
    #[inline(always)]
    fn narrow(self, a: Four) -> [f32; 4] {
        let mut lanes = [0.0; 4];
        intrinsic!(_mm_storeu_ps(lanes.as_mut_ptr(), a.narrowed()));
        lanes
    }
    #[inline(always)]
    fn narrow_all(self, [a, b, c, d]: [Four; 4]) -> F {
        F([a.narrowed(), b.narrowed(), c.narrowed(), d.narrowed()])
    }
    #[inline(always)]
    fn transpose_d(self, [a, b, c, d]: [Four; 4]) -> [Four; 4] {
        [
            Four(intrinsic!(_mm_unpacklo_pd(a.0, b.0)), intrinsic!(_mm_unpacklo_pd(c.0, d.0))),
            Four(intrinsic!(_mm_unpackhi_pd(a.0, b.0)), intrinsic!(_mm_unpackhi_pd(c.0, d.0))),
            Four(intrinsic!(_mm_unpacklo_pd(a.1, b.1)), intrinsic!(_mm_unpacklo_pd(c.1, d.1))),
            Four(intrinsic!(_mm_unpackhi_pd(a.1, b.1)), intrinsic!(_mm_unpackhi_pd(c.1, d.1))),
        ]
    }
    #[inline(always)]
    fn sqrt_d(self, a: Four) -> Four {
        Four(intrinsic!(_mm_sqrt_pd(a.0)), intrinsic!(_mm_sqrt_pd(a.1)))
    }
    #[inline(always)]
    fn min_d(self, a: Four, b: Four) -> Four {
        Four(intrinsic!(_mm_min_pd(a.0, b.0)), intrinsic!(_mm_min_pd(a.1, b.1)))
    }
    #[inline(always)]
    fn max_d(self, a: Four, b: Four) -> Four {
        Four(intrinsic!(_mm_max_pd(a.0, b.0)), intrinsic!(_mm_max_pd(a.1, b.1)))
    }
    #[inline(always)]
    fn le_d(self, a: Four, b: Four) -> Mask {
        let low = intrinsic!(_mm_movemask_pd(_mm_cmple_pd(a.0, b.0)));
        let high = intrinsic!(_mm_movemask_pd(_mm_cmple_pd(a.1, b.1)));
        (low | high << 2) as Mask
    }
    #[inline(always)]
    fn select_le(self, x: Four, y: Four, a: Four, b: Four) -> Four {
        let half = |x, y, a, b| {
            let le = intrinsic!(_mm_cmple_pd(x, y));
            intrinsic!(_mm_or_pd(_mm_and_pd(le, a), _mm_andnot_pd(le, b)))
        };
        Four(half(x.0, y.0, a.0, b.0), half(x.1, y.1, a.1, b.1))
    }
}
