//! Interpolation between keys.
//!
//! A position is interpolated from the nearer key: `base + s * (b - a)`, with `base = a` and the
//! fraction `s` in the first half of a segment, `base = b` and `s - 1` in the second. This gives the
//! key itself at both keys and wherever `a == b`, which `(1 - t) * a + t * b` does not, and so moving
//! and static geometry agree where they touch. Nothing is fused, so the results have the same bits on every CPU.

use core::ops::{Add, Mul, Sub};
use glam::{DVec3, Vec3, Vec4};

/// The time of a query relative to the keys, the same for every vertex of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct KeyTime {
    /// The segment: between key `segment` and `segment + 1`.
    pub segment: usize,
    /// Fraction from the base key, in [-1/2, 1/2].
    pub s: f32,
    /// Whether the base is the segment's later key.
    pub from_end: bool,
}

impl KeyTime {
    /// Locates time `t` in [0, 1] among `keys` keys (at least one).
    #[inline]
    pub fn new(t: f32, keys: usize) -> KeyTime {
        if keys < 2 {
            return KeyTime { segment: 0, s: 0.0, from_end: false };
        }
        if keys == 2 {
            // The general case gives the same result, but takes longer.
            return KeyTime::in_segment(t, 0);
        }
        KeyTime::within(t, keys, [0, keys - 2])
    }

    /// Locates a time among the segments from `first` to `last` of a motion with more than two keys. Times before and after
    /// extrapolate the motion in the nearest of them.
    #[inline]
    pub fn within(t: f32, keys: usize, [first, last]: [usize; 2]) -> KeyTime {
        let at = t * (keys - 1) as f32;
        let segment = (at as usize).clamp(first, last);
        KeyTime::in_segment(at - segment as f32, segment)
    }

    /// The first time that [`KeyTime::new`] locates in a segment: the key, or a float or two next to it, since the product
    /// with the number of segments is rounded.
    pub fn first_time(segment: usize, keys: usize) -> f32 {
        let mut t = (segment as f64 / (keys.max(2) - 1) as f64) as f32;
        while t > 0.0 && KeyTime::new(t.next_down(), keys).segment >= segment {
            t = t.next_down();
        }
        while t < 1.0 && KeyTime::new(t, keys).segment < segment {
            t = t.next_up();
        }
        t
    }

    /// The first time that is not before a key.
    pub fn not_before(key: usize, keys: usize) -> f32 {
        let segments = (keys.max(2) - 1) as f64;
        let t = (key as f64 / segments) as f32;
        // The product is exact.
        if f64::from(t) * segments < key as f64 { t.next_up() } else { t }
    }

    #[inline]
    fn in_segment(s: f32, segment: usize) -> KeyTime {
        if s < 0.5 { KeyTime { segment, s, from_end: false } } else { KeyTime { segment, s: s - 1.0, from_end: true } }
    }

    /// The position between `a` (the segment's earlier key) and `b`.
    #[inline(always)]
    pub fn position(self, a: Vec3, b: Vec3) -> Vec3 {
        (if self.from_end { b } else { a }) + (b - a) * self.s
    }

    /// The same in four lanes.
    #[inline(always)]
    pub fn position_of_lanes(self, a: Vec4, b: Vec4) -> Vec4 {
        (if self.from_end { b } else { a }) + (b - a) * self.s
    }

    /// The same position in f64, with 2^-29 of the rounding error.
    #[inline(always)]
    pub fn fine_position(self, a: DVec3, b: DVec3) -> DVec3 {
        (if self.from_end { b } else { a }) + (b - a) * f64::from(self.s)
    }
}

/// A time as a segment between two keys and the fraction within it, in f64: for spheres and instances.
#[derive(Clone, Copy)]
pub(crate) struct KeyPhase {
    /// The segment: between key `segment` and `segment + 1`.
    pub segment: usize,
    /// Fraction from the earlier key, in [0, 1].
    pub w: f64,
}

impl KeyPhase {
    /// Locates a time in [0, 1] among at least two keys.
    #[inline(always)]
    pub fn new(time: f64, keys: usize) -> KeyPhase {
        let segments = keys - 1;
        let at = time * segments as f64;
        let segment = (at as usize).min(segments - 1);
        KeyPhase { segment, w: at - segment as f64 }
    }
}

/// Interpolates from the nearer of two keys, so that both are met exactly.
#[inline(always)]
pub(crate) fn lerp<T>(a: T, b: T, w: f64) -> T
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>,
{
    if w < 0.5 { a + (b - a) * w } else { b + (b - a) * (w - 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_time_before_the_first_that_is_not_before_a_key_is_after_it() {
        for keys in 2..300 {
            for key in 0..keys {
                let t = KeyTime::not_before(key, keys);
                let along = |t: f32| f64::from(t) * (keys - 1) as f64;
                assert!(along(t) >= key as f64 && (key == 0 || along(t.next_down()) < key as f64), "{key} of {keys}");
            }
        }
    }

    #[test]
    fn segments_begin_at_their_first_times() {
        for keys in 2..300 {
            assert_eq!(KeyTime::first_time(0, keys), 0.0);
            for segment in 1..keys - 1 {
                let t = KeyTime::first_time(segment, keys);
                assert_eq!(KeyTime::new(t, keys).segment, segment);
                assert_eq!(KeyTime::new(t.next_down(), keys).segment, segment - 1);
            }
        }
    }

    #[test]
    fn keys_are_hit_exactly_and_still_points_stay() {
        let (a, b) = (Vec3::new(0.1, -7.3, 1e-3), Vec3::new(9.9, 0.7, -1e5));
        assert_eq!(KeyTime::new(0.0, 2).position(a, b), a);
        assert_eq!(KeyTime::new(1.0, 2).position(a, b), b);
        for keys in 1..9 {
            for i in 0..=1000 {
                let at = KeyTime::new(i as f32 / 1000.0, keys);
                assert!(at.segment < (keys - 1).max(1) && at.s.abs() <= 0.5);
                assert_eq!(at.position(a, a), a);
            }
            for key in 1..keys {
                let at = KeyTime::new(key as f32 / (keys - 1) as f32, keys);
                assert_eq!(at.s, 0.0, "key {key} of {keys} is not met exactly");
            }
        }
    }
}
