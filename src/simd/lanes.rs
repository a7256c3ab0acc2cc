//! Sixteen lanes in memory, and reading them.

use glam::Vec3;

/// Number of lanes in every vector of this module.
pub(crate) const LANES: usize = 16;

/// Sixteen f32 or u32 lanes in memory.
pub(crate) type Lanes<T> = [T; LANES];

/// A mask: bit `i` belongs to lane `i`.
pub(crate) type Mask = u16;

/// Contiguous rows of up to sixteen floats.
///
/// Their bounds are checked once, so that reading three of them costs one comparison.
pub(crate) struct Rows<'a> {
    pub(super) words: &'a [f32],
    /// Floats per row.
    pub(super) n: usize,
    /// The mask of that many lanes.
    #[cfg(target_arch = "x86_64")]
    pub(super) mask: Mask,
    count: usize,
}

impl<'a> Rows<'a> {
    /// `count` rows of `n` floats at the beginning of `words`. Panics if `words` is too short.
    #[inline(always)]
    pub(crate) fn new(words: &'a [f32], n: usize, count: usize) -> Rows<'a> {
        assert!((1..=LANES).contains(&n) && count <= 32 && words.len() >= n * count);
        Rows {
            words,
            n,
            #[cfg(target_arch = "x86_64")]
            mask: ((1u32 << n) - 1) as Mask,
            count,
        }
    }

    /// The beginning of row `i`; it has `n` floats from there.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    #[inline(always)]
    pub(super) fn row(&self, i: usize) -> *const f32 {
        assert!(i < self.count);
        self.words.as_ptr().wrapping_add(i * self.n)
    }

    /// The beginnings of rows `first`, `first + 3` and `first + 6`; each has `n` floats from there.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    #[inline(always)]
    pub(super) fn thirds(&self, first: usize) -> [*const f32; 3] {
        assert!(first + 6 < self.count);
        let at = self.words.as_ptr().wrapping_add(first * self.n);
        [at, at.wrapping_add(3 * self.n), at.wrapping_add(6 * self.n)]
    }

    /// One lane of rows `first`, `first + 3` and `first + 6`. Panics if they are out of range.
    #[inline(always)]
    pub(crate) fn lane_of_thirds(&self, first: usize, lane: usize) -> [f32; 3] {
        assert!((first + 6 < self.count) & (lane < self.n));
        let (at, third) = (first * self.n + lane, 3 * self.n);
        // SAFETY: the last row is one of `count` and the lane of `n`; `new` found as many words.
        unsafe {
            [
                *self.words.get_unchecked(at),
                *self.words.get_unchecked(at + third),
                *self.words.get_unchecked(at + 2 * third),
            ]
        }
    }
}

/// Sixteen elements of `from`, beginning at `at`. Panics if they are out of range.
#[inline(always)]
pub(crate) fn lanes_at<T>(from: &[T], at: usize) -> &Lanes<T> {
    from[at..at + LANES].try_into().expect("a slice of sixteen")
}

/// The first `count` elements, at most sixteen; those of other lanes are unspecified.
#[inline(always)]
pub(crate) fn lanes_of(from: &[u32], count: usize) -> Lanes<u32> {
    if let Some(lanes) = from.first_chunk() {
        return *lanes;
    }
    let mut lanes = [0; LANES];
    for (lane, &x) in lanes.iter_mut().zip(&from[..count]) {
        *lane = x;
    }
    lanes
}

/// Words as the floats with these bits.
#[inline(always)]
pub(crate) fn as_floats(words: &[u32]) -> &[f32] {
    // SAFETY: both types have the same size and alignment, and every bit pattern is a float.
    unsafe { core::slice::from_raw_parts(words.as_ptr().cast(), words.len()) }
}

/// The coordinates of points, one after the other.
#[inline(always)]
pub(crate) fn as_coordinates(points: &[Vec3]) -> &[f32] {
    const { assert!(size_of::<Vec3>() == size_of::<[f32; 3]>()) };
    // SAFETY: a point is `repr(C)` and has the size of its three floats, so they follow each other without padding.
    unsafe { core::slice::from_raw_parts(points.as_ptr().cast(), 3 * points.len()) }
}

/// Sixteen elements of `to`, beginning at `at`, to be written. Panics where they are not all there.
#[inline(always)]
pub(crate) fn lanes_at_mut<T>(to: &mut [T], at: usize) -> &mut Lanes<T> {
    (&mut to[at..at + LANES]).try_into().expect("a slice of sixteen")
}

/// The mask of the first `count` lanes; of all lanes if `count` is larger.
#[inline(always)]
pub(crate) fn first_lanes(count: usize) -> Mask {
    if count < LANES { (1 << count) - 1 } else { Mask::MAX }
}

/// The lanes `i ^ d`.
#[cfg(target_arch = "x86_64")]
pub(super) const fn swapped(d: usize) -> Lanes<u32> {
    let mut lanes = [0; LANES];
    let mut i = 0;
    while i < LANES {
        lanes[i] = (i ^ d) as u32;
        i += 1;
    }
    lanes
}
