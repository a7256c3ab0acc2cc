//! Selecting the lowest of some keys, a vector of them at a time: a bound is guessed, and what is below it is counted.

use crate::simd::{LANES, Lanes, Mask, Simd};

/// What divides the `count` lowest keys from the others: those below a bound, and so many of those equal to it. `least`
/// and `most` are the least and the greatest key, which must be numbers.
#[inline(always)]
pub(in crate::point) fn threshold<S: Simd>(
    s: S,
    keys: &[Lanes<f32>],
    count: usize,
    (least, most): (f32, f32),
) -> (f32, usize) {
    let mut lo = match guess(s, keys, count, (least, most)) {
        Ok(found) => return found,
        Err(lo) => lo,
    };
    // One key after the other: it ends with the greatest one at the latest.
    loop {
        let key = next_key(s, keys, lo);
        let (found, with_equal) = counted(s, keys, key);
        if with_equal >= count || key >= most {
            return (key, count - found);
        }
        lo = key.next_up();
    }
}

/// A bound that is a key: `wanted` of the `equal` keys that are equal to it are on the left.
#[inline]
pub(in crate::point) fn with_ties(key: f32, wanted: usize, equal: usize) -> (f32, usize) {
    if wanted == equal && key.next_up() < f32::INFINITY { (key.next_up(), 0) } else { (key, wanted) }
}

/// Guesses of a key that divides a range.
///
/// Evenly spread keys take four to six.
const GUESSES: usize = 10;

/// What divides the `count` lowest keys from the others: those below a bound, and so many of those equal to it. `least` and `most`
/// are the least and the greatest finite key. If [`GUESSES`] do not suffice, the error is the greatest number tried that too few
/// are below.
///
/// A guess may separate no others than the guess before, as on a lattice or where there are outliers. Then the next key in that
/// direction is looked at: it is the bound, or what lies behind it is left.
#[inline(always)]
pub(in crate::point) fn guess<S: Simd>(
    s: S,
    keys: &[Lanes<f32>],
    count: usize,
    (least, most): (f32, f32),
) -> Result<(f32, usize), f32> {
    // So many keys are below `lo`, and so many, or fewer, below `hi`.
    let (mut lo, mut below) = (least, 0);
    let (mut hi, mut not_above) = (most, keys.len() * LANES);
    for guess in 1..=GUESSES {
        // Where keys are evenly spread in between; each third time in the middle, in case they are not.
        let share = if guess % 3 == 0 { 0.5 } else { (count - below) as f32 / (not_above - below) as f32 };
        let at = lo + (hi - lo) * share;
        if !(lo < at && at < hi) {
            break;
        }
        let found = counted(s, keys, at).0;
        if found == count {
            return Ok((at, 0));
        }
        let nothing_new = found == if found < count { below } else { not_above };
        if found < count {
            (lo, below) = (at, found)
        } else {
            (hi, not_above) = (at, found)
        }
        if nothing_new {
            let key = if found < count { next_key(s, keys, at) } else { previous_key(s, keys, at) };
            let (less, with_equal) = counted(s, keys, key);
            if less <= count && count <= with_equal {
                return Ok(with_ties(key, count - less, with_equal - less));
            }
            if found < count { (lo, below) = (key.next_up(), with_equal) } else { (hi, not_above) = (key, less) }
        }
    }
    Err(lo)
}

/// The least key that is not below a number.
#[inline(always)]
fn next_key<S: Simd>(s: S, keys: &[Lanes<f32>], from: f32) -> f32 {
    let mut next = s.splat(f32::INFINITY);
    for key in keys {
        let key = s.load(key);
        next = s.select(s.le(s.splat(from), key), s.min(key, next), next);
    }
    least_lane(s, next)
}

/// The greatest key below a number.
#[inline(always)]
fn previous_key<S: Simd>(s: S, keys: &[Lanes<f32>], to: f32) -> f32 {
    let mut previous = s.splat(f32::NEG_INFINITY);
    for key in keys {
        let key = s.load(key);
        previous = s.select(s.lt(key, s.splat(to)), s.max(key, previous), previous);
    }
    -least_lane(s, s.splat(0.0) - previous)
}

/// The least and the greatest finite key.
#[inline(always)]
pub(in crate::point) fn extremes<S: Simd>(s: S, keys: &[Lanes<f32>]) -> (f32, f32) {
    let (mut lo, mut hi) = (s.splat(f32::INFINITY), s.splat(f32::NEG_INFINITY));
    for key in keys {
        let key = s.load(key);
        // Behind the last point there are infinite ones.
        lo = s.min(key, lo);
        hi = s.select(s.lt(key, s.splat(f32::INFINITY)), s.max(key, hi), hi);
    }
    (least_lane(s, lo), -least_lane(s, s.splat(0.0) - hi))
}

/// The least lane.
#[inline(always)]
pub(in crate::point) fn least_lane<S: Simd>(s: S, a: S::F) -> f32 {
    let a = s.min(a, s.swap_lanes::<8>(a));
    let a = s.min(a, s.swap_lanes::<4>(a));
    let a = s.min(a, s.swap_lanes::<2>(a));
    s.lane(s.min(a, s.swap_lanes::<1>(a)), 0)
}

/// How many keys are below a bound, and how many are not above it.
#[inline(always)]
pub(in crate::point) fn counted<S: Simd>(s: S, keys: &[Lanes<f32>], bound: f32) -> (usize, usize) {
    let (bound, mut below, mut not_above) = (s.splat(bound), 0, 0);
    for key in keys {
        let key = s.load(key);
        below += s.lt(key, bound).count_ones() as usize;
        not_above += s.le(key, bound).count_ones() as usize;
    }
    (below, not_above)
}

/// The lowest `count` lanes of a mask, or all of them.
#[inline(always)]
pub(in crate::point) fn lowest_lanes(mask: Mask, count: usize) -> Mask {
    if mask.count_ones() as usize <= count {
        return mask;
    }
    let mut rest = mask;
    for _ in 0..count {
        rest &= rest.wrapping_sub(1);
    }
    mask & !rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Kernel, SimdLevel, dispatch};

    #[test]
    fn thresholds_count_ties() {
        struct Threshold<'a>(&'a [Lanes<f32>], usize);
        impl Kernel for Threshold<'_> {
            type Output = (f32, usize);
            #[inline(always)]
            fn run<S: Simd>(self, s: S) -> (f32, usize) {
                threshold(s, self.0, self.1, (0.0, 31.0))
            }
        }
        let even: [Lanes<f32>; 2] = core::array::from_fn(|v| core::array::from_fn(|i| (16 * v + i) as f32));
        for level in SimdLevel::available() {
            let (bound, equal) = dispatch(level, Threshold(&even, 16));
            assert!(15.0 < bound && bound <= 16.0 && equal == 0, "{bound} {equal}");
            let mut ties = even;
            ties[0] = [7.0; LANES];
            ties[0][0] = 0.0;
            assert_eq!(dispatch(level, Threshold(&ties, 5)), (7.0, 4));
        }
    }
}
