//! Sixteen lanes with run-time dispatch, and the aligned memory they read.
//!
//! A query kernel is written once, generic over [`Simd`], as plain straight-line code. [`dispatch`]
//! compiles it three times (portable, AVX2, AVX-512) and runs the widest version that the CPU has, so
//! a default build reaches AVX-512 without compiler flags. The picture to have in mind: a token `s`
//! of type `S: Simd` is the proof that the CPU has the instructions, and every vector is born from it.
//!
//! All lane operations except [`Simd::mul_add`] give the same bits on every instruction set; answers
//! are computed with those. `mul_add` fuses where the hardware does and is for culling only, which
//! has to be conservative but not reproducible.
//!
//! This module holds the only `unsafe` code of the crate.
#![allow(unsafe_code)]

mod arena;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod huge_pages;
mod points;
mod portable;
mod stack;

use core::mem::MaybeUninit;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

pub(crate) use arena::Arena;
pub(crate) use huge_pages::{concat, huge_vec, huge_vec_of};
pub(crate) use points::{Item, PointBlock};
pub(crate) use stack::{Stack, StackMemory};

/// Number of lanes in every vector of this module.
pub(crate) const LANES: usize = 16;

/// Sixteen f32 or u32 lanes as they lie in memory.
pub(crate) type Lanes<T> = [T; LANES];

/// A mask: bit `i` belongs to lane `i`.
pub(crate) type Mask = u16;

/// Rows of up to sixteen floats, one right behind the other.
///
/// Their bounds are checked once, so that reading three of them costs one comparison.
pub(crate) struct Rows<'a> {
    words: &'a [f32],
    /// Floats per row, and the mask of that many lanes.
    n: usize,
    mask: Mask,
    count: usize,
}

impl<'a> Rows<'a> {
    /// `count` rows of `n` floats at the begin of `words`. Panics where they are not all there.
    #[inline(always)]
    pub(crate) fn new(words: &'a [f32], n: usize, count: usize) -> Rows<'a> {
        assert!((1..=LANES).contains(&n) && count <= 32 && words.len() >= n * count);
        Rows { words, n, mask: ((1u32 << n) - 1) as Mask, count }
    }

    /// Where row `i` begins; it has `n` floats from there.
    #[inline(always)]
    fn row(&self, i: usize) -> *const f32 {
        assert!(i < self.count);
        self.words.as_ptr().wrapping_add(i * self.n)
    }

    /// Where rows `first`, `first + 3` and `first + 6` begin; each has `n` floats from there.
    #[inline(always)]
    fn thirds(&self, first: usize) -> [*const f32; 3] {
        assert!(first + 6 < self.count);
        let at = self.words.as_ptr().wrapping_add(first * self.n);
        [at, at.wrapping_add(3 * self.n), at.wrapping_add(6 * self.n)]
    }
}

/// An instruction set as sixteen-lane operations.
///
/// Values of the implementing types exist only where the CPU has the instructions, which is what
/// makes the safe methods sound.
#[allow(clippy::wrong_self_convention)] // `self` is the token
pub(crate) trait Simd: Copy {
    /// Sixteen f32.
    type F: Copy + Add<Output = Self::F> + Sub<Output = Self::F> + Mul<Output = Self::F> + Div<Output = Self::F>;
    /// Sixteen u32.
    type U: Copy + BitAnd<Output = Self::U> + BitOr<Output = Self::U>;

    /// The same value in every lane.
    fn splat(self, x: f32) -> Self::F;
    /// Reads sixteen floats, at any alignment.
    fn load(self, from: &Lanes<f32>) -> Self::F;
    /// Reads sixteen bytes and makes floats of them.
    fn load_bytes(self, from: &Lanes<u8>) -> Self::F;
    /// Reads row `i`; the lanes beyond its length are 0. What lies behind it in memory is not looked at (read as
    /// numbers it might be denormal, which is slow).
    fn load_row(self, rows: &Rows, i: usize) -> Self::F;
    /// Reads rows `first`, `first + 3` and `first + 6` likewise.
    fn load_thirds(self, rows: &Rows, first: usize) -> [Self::F; 3];
    /// Writes sixteen floats, at any alignment.
    fn store(self, x: Self::F, to: &mut Lanes<f32>);
    /// `a * b + c`, fused or not: for culling only, never for an answer.
    fn mul_add(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `if a < b { a } else { b }`: the second operand where either is NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// `if a > b { a } else { b }`: the second operand where either is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// The greater of the bits as signed integers: a quarter of the latency of `max`. Of numbers it is the greater one
    /// where one of them is above zero; otherwise one or the other.
    fn max_signed(self, a: Self::F, b: Self::F) -> Self::F;
    /// The lesser likewise: below zero where one of the numbers is, otherwise the lesser number.
    fn min_signed(self, a: Self::F, b: Self::F) -> Self::F;
    /// Lanes where `a <= b` likewise: of numbers of which one is above zero it says what `le` says.
    fn le_signed(self, a: Self::F, b: Self::F) -> Mask;
    /// The greatest of `a`, `b` and +0; none of them may be NaN.
    fn max_with_zero(self, a: Self::F, b: Self::F) -> Self::F;
    /// Lanes where `a < b`; false for NaN.
    fn lt(self, a: Self::F, b: Self::F) -> Mask;
    /// Lanes where `a <= b`; false for NaN.
    fn le(self, a: Self::F, b: Self::F) -> Mask;
    /// Lanes where `a == b`; false for NaN.
    fn eq(self, a: Self::F, b: Self::F) -> Mask;
    /// `a` where the mask has its bit, `b` elsewhere.
    fn select(self, mask: Mask, a: Self::F, b: Self::F) -> Self::F;
    /// In each lane the lane of `a` that the lowest four bits of `index` there say.
    fn permute(self, a: Self::F, index: Self::U) -> Self::F;
    /// Lane `i`, at most 15.
    fn lane(self, a: Self::F, i: usize) -> f32;
    /// Lane `i` becomes lane `i ^ D`; `D` is at most 15.
    fn swap_lanes<const D: usize>(self, a: Self::F) -> Self::F;
    /// The lanes of the mask moved together at the front; what follows them is unspecified.
    fn compress(self, a: Self::F, mask: Mask) -> Self::F;
    /// The bits of the lanes.
    fn to_bits(self, a: Self::F) -> Self::U;
    /// The floats with these bits.
    #[allow(clippy::wrong_self_convention)] // `self` is the token, as everywhere here
    fn from_bits(self, a: Self::U) -> Self::F;

    /// The same value in every lane.
    fn splat_u(self, x: u32) -> Self::U;
    /// Reads sixteen integers, at any alignment.
    fn load_u(self, from: &Lanes<u32>) -> Self::U;
    /// Writes sixteen integers, at any alignment.
    fn store_u(self, x: Self::U, to: &mut Lanes<u32>);
    /// Writes sixteen integers, each as 64 bits.
    fn store_wide(self, x: Self::U, to: &mut Lanes<MaybeUninit<u64>>);
    /// The lanes shifted right by `BITS`, zeros from the left.
    fn shift_right<const BITS: u32>(self, a: Self::U) -> Self::U;
    /// The lesser.
    fn min_u(self, a: Self::U, b: Self::U) -> Self::U;
    /// The greater.
    fn max_u(self, a: Self::U, b: Self::U) -> Self::U;
    /// Lane `i` becomes lane `i ^ D`; `D` is at most 15.
    fn swap_lanes_u<const D: usize>(self, a: Self::U) -> Self::U;
    /// The sum, modulo 2^32.
    fn add_u(self, a: Self::U, b: Self::U) -> Self::U;
    /// Lanes where `a < b`, unsigned.
    fn lt_u(self, a: Self::U, b: Self::U) -> Mask;
    /// `a` where the mask has its bit, `b` elsewhere.
    fn select_u(self, mask: Mask, a: Self::U, b: Self::U) -> Self::U;
    /// The least lane, unsigned.
    fn reduce_min_u(self, a: Self::U) -> u32;
    /// The lanes of the mask moved together at the front; what follows them is unspecified.
    fn compress_u(self, a: Self::U, mask: Mask) -> Self::U;
}

/// A computation that [`dispatch`] can compile for every instruction set.
///
/// Mark `run` and all it calls `#[inline(always)]`: whatever stays a call of its own is compiled
/// without the instruction set, and every vector then travels through memory.
pub(crate) trait Kernel {
    /// What the computation returns.
    type Output;
    /// The computation.
    fn run<S: Simd>(self, s: S) -> Self::Output;
}

/// An instruction set of this CPU, for choosing the code path of queries.
///
/// Values exist only for what the CPU really has. Answers do not depend on the choice; it is there
/// for tests and measurements.
///
/// ```
/// use mbkd::SimdLevel;
/// let best = SimdLevel::best();
/// assert!(SimdLevel::available().contains(&best));
/// println!("queries run on {best}");
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash)]
pub struct SimdLevel(Isa);

#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash)]
enum Isa {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl SimdLevel {
    /// Plain code that every CPU runs.
    pub const PORTABLE: SimdLevel = SimdLevel(Isa::Portable);

    /// All levels of this CPU, narrowest first; the first is always [`SimdLevel::PORTABLE`].
    pub fn available() -> Vec<SimdLevel> {
        #[allow(unused_mut)]
        let mut levels = vec![SimdLevel::PORTABLE];
        #[cfg(target_arch = "x86_64")]
        {
            if avx2::detected() {
                levels.push(SimdLevel(Isa::Avx2));
            }
            if avx512::detected() {
                levels.push(SimdLevel(Isa::Avx512));
            }
        }
        levels
    }

    /// The widest level of this CPU.
    pub fn best() -> SimdLevel {
        #[cfg(target_arch = "x86_64")]
        {
            if avx512::detected() {
                return SimdLevel(Isa::Avx512);
            }
            if avx2::detected() {
                return SimdLevel(Isa::Avx2);
            }
        }
        SimdLevel::PORTABLE
    }

    /// `"portable"`, `"avx2"` or `"avx512"`.
    pub fn name(self) -> &'static str {
        match self.0 {
            Isa::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => "avx512",
        }
    }
}

impl Default for SimdLevel {
    fn default() -> Self {
        SimdLevel::best()
    }
}

impl core::fmt::Display for SimdLevel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name())
    }
}

/// Runs a kernel compiled for `level`.
#[inline(always)]
pub(crate) fn dispatch<K: Kernel>(level: SimdLevel, kernel: K) -> K::Output {
    match level.0 {
        Isa::Portable => kernel.run(portable::Portable),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a `SimdLevel` of AVX2 is only made after detection found it on this CPU.
        Isa::Avx2 => unsafe { avx2::run(kernel) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a `SimdLevel` of AVX-512 is only made after detection found it on this CPU.
        Isa::Avx512 => unsafe { avx512::run(kernel) },
    }
}

/// Asks for the cache lines of an item that will be read soon; a hint without any other effect.
#[inline(always)]
pub(crate) fn prefetch<T>(item: &T) {
    #[cfg(target_arch = "x86_64")]
    for line in 0..size_of::<T>().div_ceil(64) {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let at = core::ptr::from_ref(item).cast::<i8>().wrapping_add(64 * line);
        // SAFETY: every x86-64 CPU has the instruction; it reads nothing that a program could see and
        // ignores addresses that are not mapped.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = item;
}

/// Sixteen elements of `from`, beginning at `at`. Panics where they are not all there.
#[inline(always)]
pub(crate) fn lanes_at<T>(from: &[T], at: usize) -> &Lanes<T> {
    from[at..at + LANES].try_into().expect("a slice of sixteen")
}

/// The lanes `i ^ d`.
#[cfg(target_arch = "x86_64")]
const fn swapped(d: usize) -> Lanes<u32> {
    let mut lanes = [0; LANES];
    let mut i = 0;
    while i < LANES {
        lanes[i] = (i ^ d) as u32;
        i += 1;
    }
    lanes
}

#[cfg(test)]
mod tests;
