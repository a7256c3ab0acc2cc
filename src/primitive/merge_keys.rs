//! Merging keys: if all vertices of a mesh move on straight lines, fewer keys describe the same motion.
//!
//! Keys are spaced evenly, so keys are kept on a coarser grid that the given one refines: of 65 keys every second, fourth, …
//! or the first and the last; one if all of them are equal. The whole mesh keeps the same keys, so that triangles which
//! share a vertex still compute the same numbers for it; the same holds for a whole set of points, which has one tree for each segment.
//!
//! The rule, with u = 2^-24: every coordinate of a key that is dropped lies within 4u of the line between the kept keys around it,
//! relative to the larger coordinate of these two. This is what rounding does to a straight motion that a program samples in
//! f32: `a (1 - w) + b w` is off by up to 3u, `a + (b - a) w` by up to 5u if signs differ, mostly less than 2u.
//!
//! The distance of the merged motion from the given one: both are linear between given keys, so their distance is greatest at one of
//! those: 4u. With n keys interpolation itself may err by (4 + 2 (n - 1))u, and with those that are kept by at least 4u less. So
//! the bound that `docs/accuracy.md` states for the keys as given holds for the merged motion too.

use crate::geometry::ULP;
use crate::parallel;
use core::ops::Range;
use glam::Vec3;

/// The number of keys that are kept of `keys`; `at` is the position of a vertex (or point) at a key. `(keys - 1) / (kept -
/// 1)` given segments become one.
///
/// Takes one pass over all positions if keys are merged, and usually much less otherwise.
pub(crate) fn kept_keys(keys: usize, vertices: usize, at: impl Fn(usize, usize) -> Vec3 + Sync) -> usize {
    if keys < 2 || all_equal(keys, vertices, &at) {
        return keys.min(1);
    }
    let segments = keys - 1;
    // A vertex that needs some keys usually needs others too.
    let mut bent = 0..0;
    for kept in (1..=segments / 2).filter(|&kept| segments.is_multiple_of(kept)) {
        let grid = Grid { segments, step: segments / kept };
        if grid.first_bent(bent.clone(), &at).is_some() {
            continue;
        }
        let found = parallel::parts(vertices, |range| grid.first_bent(range, &at));
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
pub(super) fn given_key(given: usize, kept: usize, key: usize) -> usize {
    // If all keys are equal there may be fewer than are kept.
    (key * (segments(given) / segments(kept))).min(given - 1)
}

/// Whether all keys are equal.
pub(super) fn all_equal<P: PartialEq>(keys: usize, vertices: usize, at: &(impl Fn(usize, usize) -> P + Sync)) -> bool {
    let differs = |mut of: Range<usize>| of.any(|v| (1..keys).any(|key| at(key, v) != at(0, v)));
    // Usually the first few vertices differ.
    let few = vertices.min(64);
    !differs(0..few) && !parallel::parts(vertices, differs).any(|differs| differs)
}

/// The kept keys: one after every `step` segments.
#[derive(Clone, Copy)]
struct Grid {
    segments: usize,
    step: usize,
}

/// Number of vertices that are tested together at all keys: their positions at kept keys stay in the cache.
const BATCH: usize = 256;

impl Grid {
    /// The first vertex among these that leaves the lines between kept keys.
    fn first_bent(self, vertices: Range<usize>, at: &(impl Fn(usize, usize) -> Vec3 + Sync)) -> Option<usize> {
        let Grid { segments, step } = self;
        for begin in vertices.clone().step_by(BATCH) {
            let some = begin..vertices.end.min(begin + BATCH);
            for first in (0..segments).step_by(step) {
                for inner in 1..step {
                    let w = inner as f64 / step as f64;
                    let bent = |v: &usize| !on_line(at(first + inner, *v), at(first, *v), at(first + step, *v), w);
                    if let Some(vertex) = some.clone().find(bent) {
                        return Some(vertex);
                    }
                }
            }
        }
        None
    }
}

/// Whether `p` lies on the line from `a` to `b` at the fraction `w`, up to 4u.
#[inline(always)]
fn on_line(p: Vec3, a: Vec3, b: Vec3, w: f64) -> bool {
    let size = a.abs().max(b.abs());
    // In f32 this errs by 3u: both weights and products, and the sum, are rounded.
    let line = a * (1.0 - w) as f32 + b * w as f32;
    (p - line).abs().cmple(size * ULP).all() || {
        let line = a.as_dvec3() * (1.0 - w) + b.as_dvec3() * w;
        (p.as_dvec3() - line).abs().cmple(size.as_dvec3() * f64::from(4.0 * ULP)).all()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Kept keys of vertices that go through random places at `places` keys, sampled at `keys` keys, and moved by
    /// `off` of their coordinate at one of the inner keys.
    fn kept(places: usize, keys: usize, off: f32) -> usize {
        let mut random = Random(7);
        let vertices = 1000;
        let path: Vec<Vec<Vec3>> = (0..places).map(|_| (0..vertices).map(|_| random.vec()).collect()).collect();
        let step = if places > 1 { (keys - 1) / (places - 1) } else { usize::MAX };
        kept_keys(keys, vertices, |key, v| {
            let (segment, inner) = (key / step, key % step);
            let p = path[segment][v];
            if inner == 0 || places == 1 {
                return p;
            }
            let q = path[segment + 1][v];
            let p = p.lerp(q, inner as f32 / step as f32);
            if v == 700 && key == 1 { p * (1.0 + off) } else { p }
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
        assert_eq!((kept(4, 10, 0.0), kept(4, 4, 0.0), kept_keys(0, 3, |_, _| Vec3::ZERO)), (4, 4, 0));
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
            let taken = on_line(Vec3::splat(p), Vec3::splat(a), Vec3::splat(b), w);
            assert!(taken == (off <= 4.0) || (off - 4.0).abs() < 1e-6, "{off}");
            merged += u32::from(taken);
            far += u32::from(!taken);
        }
        assert!(merged > 10_000 && far > 10_000, "{merged} {far}");
    }
}
