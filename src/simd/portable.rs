//! Sixteen lanes in plain Rust: for architectures without an implementation of their own, and as the reference that the
//! others are tested against.

use super::instructions::{Kernel, Simd};
use super::lanes::{LANES, Lanes, Mask, Rows};
use super::operators::operators;
use core::mem::MaybeUninit;

/// Token of the portable lanes; every CPU has them.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

/// Runs a kernel. A function of its own, so that each kernel is compiled once and not wherever it is dispatched.
#[inline(never)]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Portable)
}

/// Sixteen floats.
#[derive(Clone, Copy)]
pub(crate) struct F(Lanes<f32>);

/// Sixteen integers.
#[derive(Clone, Copy)]
pub(crate) struct U(Lanes<u32>);

/// Four f64.
#[derive(Clone, Copy)]
pub(crate) struct Four([f64; 4]);

#[inline]
fn zip<A: Copy, B: Copy, C: Copy + Default>(a: &Lanes<A>, b: &Lanes<B>, f: impl Fn(A, B) -> C) -> Lanes<C> {
    let mut out = [C::default(); LANES];
    for i in 0..LANES {
        out[i] = f(a[i], b[i]);
    }
    out
}

/// As `map` of arrays, which compiles more slowly.
#[inline]
fn each<A: Copy, C: Copy + Default>(a: &Lanes<A>, f: impl Fn(A) -> C) -> Lanes<C> {
    let mut out = [C::default(); LANES];
    for i in 0..LANES {
        out[i] = f(a[i]);
    }
    out
}

#[inline]
fn mask<A: Copy>(a: &Lanes<A>, b: &Lanes<A>, f: impl Fn(A, A) -> bool) -> Mask {
    let mut out = 0;
    for i in 0..LANES {
        out |= Mask::from(f(a[i], b[i])) << i;
    }
    out
}

#[inline]
fn compress<A: Copy>(a: &Lanes<A>, mask: Mask) -> Lanes<A> {
    let mut out = *a;
    let (mut rest, mut n) = (mask, 0);
    while rest != 0 {
        out[n] = a[rest.trailing_zeros() as usize];
        rest &= rest - 1;
        n += 1;
    }
    out
}

#[inline]
fn select<A: Copy + Default>(mask: Mask, a: &Lanes<A>, b: &Lanes<A>) -> Lanes<A> {
    let mut out = [A::default(); LANES];
    for i in 0..LANES {
        out[i] = if mask >> i & 1 != 0 { a[i] } else { b[i] };
    }
    out
}

/// Not inlined, since it has many callers.
#[inline(never)]
fn sort(a: &mut Lanes<u32>) {
    a.sort_unstable();
}

operators!(F:
    Add add |F(a), F(b)| F(zip(&a, &b, |a, b| a + b));
    Sub sub |F(a), F(b)| F(zip(&a, &b, |a, b| a - b));
    Mul mul |F(a), F(b)| F(zip(&a, &b, |a, b| a * b));
    Div div |F(a), F(b)| F(zip(&a, &b, |a, b| a / b));
);

operators!(Four:
    Add add |Four(a), Four(b)| Four([a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]]);
    Sub sub |Four(a), Four(b)| Four([a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]]);
    Div div |Four(a), Four(b)| Four([a[0] / b[0], a[1] / b[1], a[2] / b[2], a[3] / b[3]]);
    Mul mul |Four(a), Four(b)| Four([a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]]);
);

operators!(U:
    BitAnd bitand |U(a), U(b)| U(zip(&a, &b, |a, b| a & b));
    BitOr bitor |U(a), U(b)| U(zip(&a, &b, |a, b| a | b));
);

impl Simd for Portable {
    type F = F;
    type U = U;
    type D = Four;

    #[inline]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        run(kernel)
    }

    #[inline]
    fn splat(self, x: f32) -> F {
        F([x; LANES])
    }
    #[inline]
    fn load(self, from: &Lanes<f32>) -> F {
        F(*from)
    }
    #[inline]
    fn load_row(self, rows: &Rows, i: usize) -> F {
        let mut out = [0.0; LANES];
        out[..rows.n].copy_from_slice(&rows.words[i * rows.n..(i + 1) * rows.n]);
        F(out)
    }
    #[inline]
    fn store(self, x: F, to: &mut Lanes<f32>) {
        *to = x.0;
    }
    #[inline]
    fn sqrt(self, F(a): F) -> F {
        F(a.map(f32::sqrt))
    }
    #[inline]
    fn min(self, a: F, b: F) -> F {
        F(zip(&a.0, &b.0, |a, b| if a < b { a } else { b }))
    }
    #[inline]
    fn max(self, a: F, b: F) -> F {
        F(zip(&a.0, &b.0, |a, b| if a > b { a } else { b }))
    }
    #[inline]
    fn max_signed(self, a: F, b: F) -> F {
        F(zip(&a.0, &b.0, |a, b| if a.to_bits() as i32 > b.to_bits() as i32 { a } else { b }))
    }
    #[inline]
    fn min_signed(self, a: F, b: F) -> F {
        F(zip(&a.0, &b.0, |a, b| if (a.to_bits() as i32) < b.to_bits() as i32 { a } else { b }))
    }
    #[inline]
    fn le_signed(self, a: F, b: F) -> Mask {
        mask(&a.0, &b.0, |a, b| a.to_bits() as i32 <= b.to_bits() as i32)
    }
    #[inline]
    fn lt(self, a: F, b: F) -> Mask {
        mask(&a.0, &b.0, |a, b| a < b)
    }
    #[inline]
    fn le(self, a: F, b: F) -> Mask {
        mask(&a.0, &b.0, |a, b| a <= b)
    }
    #[inline]
    fn eq(self, a: F, b: F) -> Mask {
        mask(&a.0, &b.0, |a, b| a == b)
    }
    #[inline]
    fn select(self, mask: Mask, a: F, b: F) -> F {
        F(select(mask, &a.0, &b.0))
    }
    #[inline]
    fn permute(self, a: F, index: U) -> F {
        F(each(&index.0, |i| a.0[i as usize % LANES]))
    }
    #[inline]
    fn lane(self, a: F, i: usize) -> f32 {
        a.0[i]
    }
    #[inline]
    fn store_compressed(self, a: F, mask: Mask, to: &mut Lanes<f32>) {
        *to = compress(&a.0, mask);
    }
    #[inline]
    fn to_bits(self, a: F) -> U {
        U(each(&a.0, f32::to_bits))
    }
    #[inline]
    fn from_bits(self, a: U) -> F {
        F(each(&a.0, f32::from_bits))
    }

    #[inline]
    fn splat_u(self, x: u32) -> U {
        U([x; LANES])
    }
    #[inline]
    fn load_u(self, from: &Lanes<u32>) -> U {
        U(*from)
    }
    #[inline]
    fn store_u(self, x: U, to: &mut Lanes<u32>) {
        *to = x.0;
    }
    #[inline]
    fn shift_right<const BITS: u32>(self, a: U) -> U {
        U(each(&a.0, |lane| lane >> BITS))
    }
    #[inline]
    fn min_u(self, a: U, b: U) -> U {
        U(zip(&a.0, &b.0, u32::min))
    }
    #[inline]
    fn max_u(self, a: U, b: U) -> U {
        U(zip(&a.0, &b.0, u32::max))
    }
    #[inline]
    fn swap_lanes_u<const D: usize>(self, a: U) -> U {
        let mut out = [0; LANES];
        for (i, to) in out.iter_mut().enumerate() {
            *to = a.0[i ^ D];
        }
        U(out)
    }
    #[inline(always)]
    fn sort_u(self, mut a: U) -> U {
        sort(&mut a.0);
        a
    }
    #[inline]
    fn add_u(self, a: U, b: U) -> U {
        U(zip(&a.0, &b.0, u32::wrapping_add))
    }
    #[inline]
    fn eq_u(self, a: U, b: U) -> Mask {
        mask(&a.0, &b.0, |a, b| a == b)
    }
    #[inline]
    fn lt_u(self, a: U, b: U) -> Mask {
        mask(&a.0, &b.0, |a, b| a < b)
    }
    #[inline]
    fn select_u(self, mask: Mask, a: U, b: U) -> U {
        U(select(mask, &a.0, &b.0))
    }
    #[inline]
    fn reduce_min_u(self, a: U) -> u32 {
        a.0.into_iter().fold(u32::MAX, u32::min)
    }
    #[inline]
    fn store_compressed_u(self, a: U, mask: Mask, to: &mut Lanes<u32>) {
        *to = compress(&a.0, mask);
    }
    #[inline]
    fn store_compressed_wide(self, a: U, mask: Mask, to: &mut Lanes<MaybeUninit<u64>>) {
        *to = compress(&a.0, mask).map(|lane| MaybeUninit::new(u64::from(lane)));
    }

    #[inline(always)]
    fn splat_d(self, x: f64) -> Four {
        Four([x; 4])
    }
    #[inline(always)]
    fn load_d(self, from: &[f64; 4]) -> Four {
        Four(*from)
    }
    #[inline(always)]
    fn widen(self, [a, b, c]: [f32; 3]) -> Four {
        Four([f64::from(a), f64::from(b), f64::from(c), 0.0])
    }
    #[inline(always)]
    fn pick_four(self, a: F, numbers: u32) -> Four {
        let lane = |i: u32| f64::from(a.0[(numbers >> (4 * i)) as usize % LANES]);
        Four([lane(0), lane(1), lane(2), lane(3)])
    }
    #[inline(always)]
    fn rotate_left(self, Four([a, b, c, d]): Four) -> Four {
        Four([b, c, a, d])
    }
    #[inline(always)]
    fn rotate_right(self, Four([a, b, c, d]): Four) -> Four {
        Four([c, a, b, d])
    }
    #[inline(always)]
    fn lanes_d(self, a: Four) -> [f64; 4] {
        a.0
    }
    #[inline]
    fn widen_four(self, from: &[f32; 4]) -> Four {
        Four(from.map(f64::from))
    }
    #[inline]
    fn narrow(self, Four(a): Four) -> [f32; 4] {
        a.map(|x| x as f32)
    }
    #[inline]
    fn narrow_all(self, a: [Four; 4]) -> F {
        F(core::array::from_fn(|i| a[i / 4].0[i % 4] as f32))
    }
    #[inline]
    fn transpose_d(self, rows: [Four; 4]) -> [Four; 4] {
        core::array::from_fn(|j| Four(rows.map(|Four(row)| row[j])))
    }
    #[inline]
    fn sqrt_d(self, Four(a): Four) -> Four {
        Four(a.map(f64::sqrt))
    }
    #[inline]
    fn min_d(self, Four(a): Four, Four(b): Four) -> Four {
        Four(core::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] }))
    }
    #[inline]
    fn max_d(self, Four(a): Four, Four(b): Four) -> Four {
        Four(core::array::from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] }))
    }
    #[inline]
    fn le_d(self, Four(a): Four, Four(b): Four) -> Mask {
        (0..4).fold(0, |mask, i| mask | Mask::from(a[i] <= b[i]) << i)
    }
    #[inline]
    fn select_le(self, Four(x): Four, Four(y): Four, Four(a): Four, Four(b): Four) -> Four {
        Four(core::array::from_fn(|i| if x[i] <= y[i] { a[i] } else { b[i] }))
    }
}
