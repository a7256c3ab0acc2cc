//! The operations of an instruction set on sixteen lanes, and kernels that are generic over it.

use super::lanes::{LANES, Lanes, Mask, Rows};
use core::mem::MaybeUninit;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

/// An instruction set as sixteen-lane operations.
///
/// Values of the implementing types exist only where the CPU has the instructions, which makes the safe methods sound.
#[allow(clippy::wrong_self_convention)] // `self` is the token
pub(crate) trait Simd: Copy {
    /// Sixteen f32.
    type F: Copy + Add<Output = Self::F> + Sub<Output = Self::F> + Mul<Output = Self::F> + Div<Output = Self::F>;
    /// Sixteen u32.
    type U: Copy + BitAnd<Output = Self::U> + BitOr<Output = Self::U>;
    /// Four f64.
    type D: Copy + Add<Output = Self::D> + Sub<Output = Self::D> + Mul<Output = Self::D> + Div<Output = Self::D>;

    /// Whether the upper eight lanes are in registers of their own, so that the compiler can remove computations on
    /// them if their results are not used.
    const HALVES: bool = false;

    /// Runs a kernel in a function of its own, compiled for this instruction set once and shared by its callers: for parts of
    /// kernels that are large beside what a call costs. Its vectors pass through memory.
    fn call<K: Kernel>(self, kernel: K) -> K::Output;
    /// The same value in every lane.
    fn splat(self, x: f32) -> Self::F;
    /// Reads sixteen floats, at any alignment.
    fn load(self, from: &Lanes<f32>) -> Self::F;
    /// Keeps the lower eight lanes; the upper ones are unspecified.
    #[inline(always)]
    fn lower_half(self, a: Self::F) -> Self::F {
        a
    }
    /// Reads row `i`; the lanes beyond its length are 0. Memory behind the row is not read as numbers (they might be
    /// denormal, which is slow).
    fn load_row(self, rows: &Rows, i: usize) -> Self::F;
    /// Reads rows `first`, `first + 3` and `first + 6`, as [`Simd::load_row`].
    #[inline(always)]
    fn load_thirds(self, rows: &Rows, first: usize) -> [Self::F; 3] {
        [self.load_row(rows, first), self.load_row(rows, first + 3), self.load_row(rows, first + 6)]
    }
    /// Writes sixteen floats, at any alignment.
    fn store(self, x: Self::F, to: &mut Lanes<f32>);
    /// `a * b + c`, fused or not: for culling only, never for an answer.
    #[inline(always)]
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        a * b + c
    }
    /// `c - a * b`, fused or not: for culling only, never for an answer.
    #[inline(always)]
    fn negated_mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        c - a * b
    }
    /// [`Simd::mul_add`] of one number: for culling only.
    #[inline(always)]
    fn mul_add_one(self, a: f32, b: f32, c: f32) -> f32 {
        a * b + c
    }
    /// `if a < b { a } else { b }`: the second operand where either is NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// `if a > b { a } else { b }`: the second operand where either is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// The maximum of the bits as signed integers: a quarter of the latency of `max`. For numbers it is the greater one
    /// if one of them is above zero; otherwise one or the other.
    fn max_signed(self, a: Self::F, b: Self::F) -> Self::F;
    /// The minimum of the bits as signed integers: below zero if one of the numbers is, otherwise the lesser number.
    fn min_signed(self, a: Self::F, b: Self::F) -> Self::F;
    /// Lanes where `a <= b` as signed integers: equal to `le` for numbers of which one is above zero.
    fn le_signed(self, a: Self::F, b: Self::F) -> Mask;
    /// The greatest of `a`, `b` and +0; none of them may be NaN.
    #[inline(always)]
    fn max_with_zero(self, a: Self::F, b: Self::F) -> Self::F {
        self.max(self.max(a, b), self.splat(0.0))
    }
    /// The square roots, correctly rounded.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// Lanes where `a < b`; false for NaN.
    fn lt(self, a: Self::F, b: Self::F) -> Mask;
    /// Lanes where `a <= b`; false for NaN.
    fn le(self, a: Self::F, b: Self::F) -> Mask;
    /// Lanes where `a == b`; false for NaN.
    fn eq(self, a: Self::F, b: Self::F) -> Mask;
    /// `a` where the mask has its bit set, `b` elsewhere.
    fn select(self, mask: Mask, a: Self::F, b: Self::F) -> Self::F;
    /// Lane `i` becomes the lane of `a` that the lowest four bits of lane `i` of `index` select.
    fn permute(self, a: Self::F, index: Self::U) -> Self::F;
    /// Lane `i`, at most 15.
    fn lane(self, a: Self::F, i: usize) -> f32;
    /// Lane `i` becomes lane `i ^ D`; `D` is at most 15.
    #[inline(always)]
    fn swap_lanes<const D: usize>(self, a: Self::F) -> Self::F {
        self.from_bits(self.swap_lanes_u::<D>(self.to_bits(a)))
    }
    /// Writes the lanes of the mask, compressed to the front; the elements after them are unspecified.
    fn store_compressed(self, a: Self::F, mask: Mask, to: &mut Lanes<f32>);
    /// The bits of the lanes.
    fn to_bits(self, a: Self::F) -> Self::U;
    /// The floats with these bits.
    fn from_bits(self, a: Self::U) -> Self::F;

    /// The same value in every lane.
    fn splat_u(self, x: u32) -> Self::U;
    /// Reads sixteen integers, at any alignment.
    fn load_u(self, from: &Lanes<u32>) -> Self::U;
    /// Writes sixteen integers, at any alignment.
    fn store_u(self, x: Self::U, to: &mut Lanes<u32>);
    /// The lanes shifted right by `BITS`, with zeros from the left.
    fn shift_right<const BITS: u32>(self, a: Self::U) -> Self::U;
    /// The lesser of each pair of lanes, unsigned.
    fn min_u(self, a: Self::U, b: Self::U) -> Self::U;
    /// The greater of each pair of lanes, unsigned.
    fn max_u(self, a: Self::U, b: Self::U) -> Self::U;
    /// Lane `i` becomes lane `i ^ D`; `D` is at most 15.
    fn swap_lanes_u<const D: usize>(self, a: Self::U) -> Self::U;
    /// The lanes in ascending order, unsigned.
    fn sort_u(self, a: Self::U) -> Self::U;
    /// The sum, modulo 2^32.
    fn add_u(self, a: Self::U, b: Self::U) -> Self::U;
    /// Lanes where `a == b`.
    fn eq_u(self, a: Self::U, b: Self::U) -> Mask;
    /// Lanes where `a < b`, unsigned.
    fn lt_u(self, a: Self::U, b: Self::U) -> Mask;
    /// `a` where the mask has its bit set, `b` elsewhere.
    fn select_u(self, mask: Mask, a: Self::U, b: Self::U) -> Self::U;
    /// The least lane, unsigned.
    fn reduce_min_u(self, a: Self::U) -> u32;
    /// Writes the lanes of the mask, compressed to the front; the elements after them are unspecified.
    fn store_compressed_u(self, a: Self::U, mask: Mask, to: &mut Lanes<u32>);
    /// As [`Simd::store_compressed_u`], with each lane as 64 bits.
    fn store_compressed_wide(self, a: Self::U, mask: Mask, to: &mut Lanes<MaybeUninit<u64>>);

    /// The same f64 in all four lanes.
    fn splat_d(self, x: f64) -> Self::D;
    /// Reads four f64, at any alignment.
    fn load_d(self, from: &[f64; 4]) -> Self::D;
    /// Three floats as f64, and 0.
    fn widen(self, x: [f32; 3]) -> Self::D;
    /// The lanes of `a` that the lowest four groups of four bits of `numbers` select, as f64.
    fn pick_four(self, a: Self::F, numbers: u32) -> Self::D;
    /// The lanes 1, 2, 0, 3.
    fn rotate_left(self, a: Self::D) -> Self::D;
    /// The lanes 2, 0, 1, 3.
    fn rotate_right(self, a: Self::D) -> Self::D;
    /// All four lanes.
    fn lanes_d(self, a: Self::D) -> [f64; 4];
    /// Four floats as f64.
    fn widen_four(self, from: &[f32; 4]) -> Self::D;
    /// Four f64 rounded to floats.
    fn narrow(self, a: Self::D) -> [f32; 4];
    /// Sixteen f64 rounded to floats.
    fn narrow_all(self, a: [Self::D; 4]) -> Self::F;
    /// Squared distances of sixteen points in rows from one point, in f64 as `(dx·dx + dy·dy) + dz·dz`, each rounded to
    /// a float.
    #[inline(always)]
    fn squared_distances(self, [x, y, z]: [&Lanes<f64>; 3], from: [f64; 3]) -> Self::F {
        let mut squares = [self.splat_d(0.0); 4];
        for (four, square) in squares.iter_mut().enumerate() {
            let x = self.load_d(&x.as_chunks().0[four]) - self.splat_d(from[0]);
            let y = self.load_d(&y.as_chunks().0[four]) - self.splat_d(from[1]);
            let z = self.load_d(&z.as_chunks().0[four]) - self.splat_d(from[2]);
            *square = (x * x + y * y) + z * z;
        }
        self.narrow_all(squares)
    }
    /// Writes the lanes of a mask one behind the other. What follows them is unspecified.
    #[inline(always)]
    fn store_compressed_d(self, row: &Lanes<f64>, mask: Mask, to: &mut Lanes<f64>) {
        let mut end = 0;
        for (lane, &x) in row.iter().enumerate() {
            to[end % LANES] = x;
            end += usize::from(mask >> lane & 1 != 0);
        }
    }
    /// Lane `j` of vector `i` becomes lane `i` of vector `j`.
    fn transpose_d(self, rows: [Self::D; 4]) -> [Self::D; 4];
    /// The square roots, correctly rounded.
    fn sqrt_d(self, a: Self::D) -> Self::D;
    /// `if a < b { a } else { b }`: the second operand where either is NaN.
    fn min_d(self, a: Self::D, b: Self::D) -> Self::D;
    /// `if a > b { a } else { b }`: the second operand where either is NaN.
    fn max_d(self, a: Self::D, b: Self::D) -> Self::D;
    /// Lanes where `a <= b`, in the lowest four bits; false for NaN.
    fn le_d(self, a: Self::D, b: Self::D) -> Mask;
    /// `a` where `x <= y`, `b` elsewhere.
    fn select_le(self, x: Self::D, y: Self::D, a: Self::D, b: Self::D) -> Self::D;
}

/// A computation that [`dispatch`](super::dispatch()) can compile for every instruction set.
///
/// Mark `run` and all functions it calls `#[inline(always)]`, or use [`Simd::call`]: a function that is not inlined is compiled
/// without the instruction set, and each of its lane operations is a call then. That includes closures that are called in more than
/// one place, by an iterator for instance, and recursion.
pub(crate) trait Kernel {
    /// The result of the computation.
    type Output;
    /// The computation.
    fn run<S: Simd>(self, s: S) -> Self::Output;
}
