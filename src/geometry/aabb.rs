//! Boxes, and boxes that move linearly: the bounds of primitives.

use glam::DVec3;

/// An axis-aligned box in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// The least corner.
    pub min: DVec3,
    /// The greatest corner.
    pub max: DVec3,
}

impl Aabb {
    /// The empty box: its union with any box is the other box.
    pub const EMPTY: Aabb = Aabb { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The box of some points; [`Aabb::EMPTY`] for none.
    pub fn of_points(points: impl IntoIterator<Item = DVec3>) -> Aabb {
        points.into_iter().fold(Aabb::EMPTY, |b, p| Aabb { min: b.min.min(p), max: b.max.max(p) })
    }

    /// The smallest box around both.
    pub fn union(self, other: Aabb) -> Aabb {
        Aabb { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The box grown by `by` on every side.
    pub fn pad(self, by: f64) -> Aabb {
        Aabb { min: self.min - by, max: self.max + by }
    }

    /// Whether the point lies in it, faces included.
    pub fn contains(self, p: DVec3) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }
}

/// A box at the begin of a time interval and one at its end; in between the box whose faces are
/// interpolated linearly.
///
/// Linear bounds *hold* a primitive over an interval when at every time of it the primitive lies inside
/// the interpolated box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearBounds {
    /// The box at the begin of the interval.
    pub begin: Aabb,
    /// The box at the end of the interval.
    pub end: Aabb,
}

impl LinearBounds {
    /// A static box.
    pub fn fixed(at: Aabb) -> LinearBounds {
        LinearBounds { begin: at, end: at }
    }

    /// The box at the fraction `w` (0 = begin, 1 = end) of the interval.
    pub fn at(self, w: f64) -> Aabb {
        Aabb { min: self.begin.min.lerp(self.end.min, w), max: self.begin.max.lerp(self.end.max, w) }
    }

    /// Linear bounds that hold both.
    pub fn union(self, other: LinearBounds) -> LinearBounds {
        LinearBounds { begin: self.begin.union(other.begin), end: self.end.union(other.end) }
    }

    /// The box that the motion sweeps between begin and end.
    pub fn swept(self) -> Aabb {
        self.begin.union(self.end)
    }

    /// Moves both ends outward just as far as it takes to hold `inner` at the fraction `w` as well.
    ///
    /// This is how motion with more than two keys gets linear bounds: the chord between the ends, shifted
    /// until every inner key is inside. Between keys the motion is linear, so it is then inside too.
    pub fn include(&mut self, w: f64, inner: Aabb) {
        let now = self.at(w);
        let low = (now.min - inner.min).max(DVec3::ZERO);
        let high = (inner.max - now.max).max(DVec3::ZERO);
        self.begin.min -= low;
        self.end.min -= low;
        self.begin.max += high;
        self.end.max += high;
    }

    /// Linear bounds of the successive slices of an interval, each linear between two fractions of it: the line between the first
    /// and the last state, moved outward until it holds each slice at both of its ends. `None` of no slices.
    pub fn of_slices(slices: &[([f64; 2], LinearBounds)]) -> Option<LinearBounds> {
        let ((_, first), (_, last)) = (slices.first()?, slices.last()?);
        let mut all = LinearBounds { begin: first.begin, end: last.end };
        for ([begin, end], slice) in slices {
            all.include(*begin, slice.begin);
            all.include(*end, slice.end);
        }
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_inner_key_is_held_after_it_was_included() {
        let unit = Aabb { min: DVec3::ZERO, max: DVec3::ONE };
        let mut b = LinearBounds { begin: unit, end: Aabb { min: DVec3::splat(4.0), max: DVec3::splat(5.0) } };
        let inner = Aabb { min: DVec3::new(-1.0, 1.5, 9.0), max: DVec3::new(0.0, 2.0, 10.0) };
        b.include(0.25, inner);
        let held = b.at(0.25);
        assert!(held.contains(inner.min) && held.contains(inner.max));
        assert!(b.at(0.0).contains(DVec3::ZERO) && b.at(1.0).contains(DVec3::splat(5.0)));
        let before = b;
        b.include(0.25, inner);
        assert_eq!(b, before, "what is inside already changes nothing");
    }
}
