//! Merging keys: if all vertices of a mesh move on straight lines, fewer keys describe the same motion.
//!
//! Keys are spaced evenly, so keys are kept on a coarser grid that the given one refines: of 65 keys every second, fourth, … or the
//! first and the last; one if all of them are equal. The whole mesh keeps the same keys, so that triangles which share a vertex
//! still compute the same numbers for it; the same holds for a whole set of points, which has one tree for each segment.
//!
//! The rule, with u = 2^-24 for positions in f32 and 2^-53 for those in f64: every coordinate of a key that is dropped lies within
//! 4u of the line between the kept keys around it, relative to the larger coordinate of these two. This is what rounding does to a
//! straight motion that a program samples: `a (1 - w) + b w` is off by up to 3u, `a + (b - a) w` by up to 5u if signs differ,
//! mostly less than 2u. The line itself is computed in f64, which errs by less than 4 * 2^-53: so numbers in f64 lie within 8u =
//! 2^-50.
//!
//! The distance of the merged motion from the given one: both are linear between given keys, so their distance is greatest at one
//! of those: 4u. With n keys interpolation itself may err by (4 + 2 (n - 1))u, and with those that are kept by at least 4u less. So
//! the bound that `docs/accuracy.md` states for the keys as given holds for the merged motion too.

use crate::geometry::ULP;
use crate::parallel;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};
use core::ops::Range;

/// What numbers that a program computes in f32, or in f64, are rounded by.
pub(crate) const SINGLE: f64 = ULP as f64;
pub(crate) const DOUBLE: f64 = 0.5 * f64::EPSILON;

/// The number of keys that are kept of `keys`. `read` writes the coordinates of some vertices (or points) at a key, which are
/// rounded by `ulp`. `(keys - 1) / (kept - 1)` given segments become one.
///
/// Takes one pass over all positions if keys are merged, and usually much less otherwise.
pub(crate) fn kept_keys(
    keys: usize,
    vertices: usize,
    ulp: f64,
    read: impl Fn(usize, Range<usize>, &mut [f64]) + Sync,
) -> usize {
    if keys < 2 || all_equal(keys, vertices, &read) {
        return keys.min(1);
    }
    let segments = keys - 1;
    // A vertex that needs some keys usually needs others too.
    let mut bent = 0..0;
    for kept in (1..=segments / 2).filter(|&kept| segments.is_multiple_of(kept)) {
        let grid = Grid { segments, step: segments / kept, ulp };
        if grid.first_bent(bent.clone(), &read).is_some() {
            continue;
        }
        let found = parallel::parts(vertices, |range| grid.first_bent(range, &read));
        match found.flatten().next() {
            Some(vertex) => bent = vertex..vertex + 1,
            None => return kept + 1,
        }
    }
    keys
}

/// Number of linear segments of a motion with this many keys.
fn segments(keys: usize) -> usize {
    (keys - 1).max(1)
}

/// The index of the given key that is key `key` of the `kept` ones.
pub(in crate::primitive) fn given_key(given: usize, kept: usize, key: usize) -> usize {
    // If all keys are equal there may be fewer than are kept.
    (key * (segments(given) / segments(kept))).min(given - 1)
}

/// Number of vertices that are compared together at all keys: their positions at kept keys stay in the cache.
const BATCH: usize = 256;

/// The coordinates of a batch at one key.
type Coordinates = [f64; 3 * BATCH];

/// The ranges of a batch that make up some vertices.
fn batches(vertices: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    vertices.clone().step_by(BATCH).map(move |begin| begin..vertices.end.min(begin + BATCH))
}

/// Whether all keys are equal.
fn all_equal(keys: usize, vertices: usize, read: &(impl Fn(usize, Range<usize>, &mut [f64]) + Sync)) -> bool {
    let differs = |of: Range<usize>| {
        let mut at: [Coordinates; 2] = [[0.0; 3 * BATCH]; 2];
        batches(of).any(|some| {
            let [first, other] = at.each_mut().map(|at| &mut at[..3 * some.len()]);
            read(0, some.clone(), first);
            (1..keys).any(|key| {
                read(key, some.clone(), other);
                first != other
            })
        })
    };
    // Usually the first few vertices differ.
    let few = vertices.min(BATCH / 4);
    !differs(0..few) && !parallel::parts(vertices, differs).any(|differs| differs)
}

/// The kept keys: one after every `step` segments.
#[derive(Clone, Copy)]
struct Grid {
    segments: usize,
    step: usize,
    ulp: f64,
}

impl Grid {
    /// The first batch with a vertex that leaves the lines between kept keys, and this vertex.
    fn first_bent(self, vertices: Range<usize>, read: &impl Fn(usize, Range<usize>, &mut [f64])) -> Option<usize> {
        let Grid { segments, step, ulp } = self;
        let level = SimdLevel::best();
        let mut at: [Coordinates; 3] = [[0.0; 3 * BATCH]; 3];
        for some in batches(vertices) {
            let [begin, end, inner] = at.each_mut().map(|at| &mut at[..3 * some.len()]);
            for first in (0..segments).step_by(step) {
                read(first, some.clone(), begin);
                read(first + step, some.clone(), end);
                for key in 1..step {
                    read(first + key, some.clone(), inner);
                    let w = key as f64 / step as f64;
                    if dispatch(level, OffLine { inner, begin, end, w, ulp }) {
                        let at = |i: &usize| !on_line(inner[*i], [begin[*i], end[*i]], w, ulp);
                        return (0..inner.len()).find(at).map(|coordinate| some.start + coordinate / 3);
                    }
                }
            }
        }
        None
    }
}

/// Whether any of some coordinates is not on its line; compiled for each instruction set.
struct OffLine<'a> {
    inner: &'a [f64],
    begin: &'a [f64],
    end: &'a [f64],
    w: f64,
    ulp: f64,
}

impl Kernel for OffLine<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> bool {
        let lines = self.begin.iter().zip(self.end);
        self.inner.iter().zip(lines).fold(false, |off, (&p, (&a, &b))| off | !on_line(p, [a, b], self.w, self.ulp))
    }
}

/// Of the keys of a single thing, given by some numbers, every how many are kept: all others lie on the lines between these.
/// Numbers that f32 has at all keys count as f32 ones if `single`.
pub(crate) fn widest_step<const N: usize>(keys: usize, single: bool, numbers: impl Fn(usize) -> [f64; N]) -> usize {
    let segments = keys.saturating_sub(1);
    if segments < 2 {
        return 1;
    }
    let mut ulps = [if single { SINGLE } else { DOUBLE }; N];
    for (i, x) in (0..keys).flat_map(|key| (0..N).zip(numbers(key))) {
        if f64::from(x as f32) != x {
            ulps[i] = DOUBLE;
        }
    }
    let is_straight = |step: usize| {
        (step..keys).step_by(step).all(|last| {
            let (begin, end) = (numbers(last - step), numbers(last));
            (1..step).all(|key| {
                let (inner, w) = (numbers(last - step + key), key as f64 / step as f64);
                (0..N).all(|i| on_line(inner[i], [begin[i], end[i]], w, ulps[i]))
            })
        })
    };
    let mut steps = (1..=segments / 2).filter(|&kept| segments.is_multiple_of(kept)).map(|kept| segments / kept);
    steps.find(|&step| is_straight(step)).unwrap_or(1)
}

/// Whether `p` lies on the line from `a` to `b` at the fraction `w`, up to 4u.
#[inline(always)]
fn on_line(p: f64, [a, b]: [f64; 2], w: f64, ulp: f64) -> bool {
    (p - (a * (1.0 - w) + b * w)).abs() <= a.abs().max(b.abs()) * (4.0 * ulp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use glam::Vec3;

    /// Kept keys of vertices that go through random places at `places` keys, sampled at `keys` keys, and moved by
    /// `off` of their coordinate at one of the inner keys.
    fn kept(places: usize, keys: usize, off: f32) -> usize {
        let mut random = Random(7);
        let vertices = 1000;
        let path: Vec<Vec<Vec3>> = (0..places).map(|_| (0..vertices).map(|_| random.vec()).collect()).collect();
        let step = if places > 1 { (keys - 1) / (places - 1) } else { usize::MAX };
        let at = |key: usize, v: usize| {
            let (segment, inner) = (key / step, key % step);
            let p = path[segment][v];
            if inner == 0 || places == 1 {
                return p;
            }
            let q = path[segment + 1][v];
            let p = p.lerp(q, inner as f32 / step as f32);
            if v == 700 && key == 1 { p * (1.0 + off) } else { p }
        };
        kept_keys(keys, vertices, SINGLE, |key, of, out| {
            of.zip(out.as_chunks_mut().0).for_each(|(v, out)| *out = at(key, v).as_dvec3().to_array());
        })
    }

    #[test]
    fn straight_motion_keeps_two_keys_and_piecewise_straight_motion_its_bends() {
        for keys in [2, 3, 5, 9, 17, 65] {
            assert_eq!(kept(1, keys, 0.0), 1, "{keys} equal keys");
            assert_eq!(kept(2, keys, 0.0), 2, "{keys} keys on a line");
        }
        assert_eq!((kept(3, 9, 0.0), kept(3, 65, 0.0), kept(5, 9, 0.0), kept(9, 9, 0.0)), (3, 3, 5, 9));
        // The given keys must refine the kept ones.
        assert_eq!((kept(4, 10, 0.0), kept(4, 4, 0.0), kept_keys(0, 3, SINGLE, |_, _, _| ())), (4, 4, 0));
    }

    #[test]
    fn a_key_beside_the_line_is_kept() {
        assert_eq!(kept(2, 9, 1e-4), 9);
        assert_eq!(kept(2, 3, 1e-5), 3);
        assert_eq!(kept(3, 65, 1e-4), 65);
    }

    #[test]
    fn what_merges_is_within_four_ulp_of_the_line() {
        let (mut random, mut merged, mut far) = (Random(3), 0, 0);
        for _ in 0..200_000 {
            let (a, b) = (random.signed(), random.signed());
            let w = f64::from(random.signed() * 0.5 + 0.5);
            let exact = f64::from(a) * (1.0 - w) + f64::from(b) * w;
            let size = f64::from(a.abs().max(b.abs()));
            let p = (exact + size * f64::from(random.signed() * 8.0 * ULP)) as f32;
            let off = (f64::from(p) - exact).abs() / (size * f64::from(ULP));
            let taken = on_line(p.into(), [a.into(), b.into()], w, SINGLE);
            assert!(taken == (off <= 4.0) || (off - 4.0).abs() < 1e-6, "{off}");
            merged += u32::from(taken);
            far += u32::from(!taken);
        }
        assert!(merged > 10_000 && far > 10_000, "{merged} {far}");
    }
}
