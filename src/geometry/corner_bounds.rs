//! Where the corners of a moving triangle are.

use super::{Box3, LaneBounds, LinearBox3, ULP};
use glam::Vec3;

/// Linear bounds of each corner of a triangle over an interval; a point where it moves on a line.
pub(crate) struct CornerBounds {
    pub corners: [LinearBox3; 3],
    /// How far corners, as queries compute them, may be outside.
    pub slack: f32,
}

impl CornerBounds {
    /// Corners that move on lines.
    #[inline(always)]
    pub fn of_lines(begin: [Vec3; 3], end: [Vec3; 3], slack: f32) -> CornerBounds {
        let point = |p: Vec3| Box3 { min: p, max: p };
        let line = |i: usize| LinearBox3 { begin: point(begin[i]), end: point(end[i]) };
        CornerBounds { corners: [line(0), line(1), line(2)], slack }
    }

    /// The bounds of the triangle but for the slack.
    #[inline(always)]
    pub fn union(&self) -> LinearBox3 {
        let [a, b, c] = self.corners;
        a.union(b).union(c)
    }

    /// Bounds of points with these weights of the second and the third corner, but for rounding and slack.
    pub fn around(&self, weights: &[[f32; 2]]) -> LinearBox3 {
        let [a, b, c] = &self.corners;
        let (LaneBounds(a), LaneBounds(b), LaneBounds(c)) = (LaneBounds::of(a), LaneBounds::of(b), LaneBounds::of(c));
        let LaneBounds(mut all) = LaneBounds::EMPTY;
        for &[u, v] in weights {
            for (lane, least) in all.iter_mut().enumerate() {
                let mean = a[lane] + (b[lane] - a[lane]) * u + (c[lane] - a[lane]) * v;
                *least = if mean < *least { mean } else { *least };
            }
        }
        LaneBounds(all).bounds()
    }

    /// The padding of bounds of points that are means of two corners, with fixed weights: the rounding error of computing them
    /// (three roundings at sizes of at most twice the largest coordinate), and the slack of the corners.
    #[inline(always)]
    pub fn pad_of_means(&self) -> f32 {
        self.slack + 8.0 * ULP * self.union().swept().magnitude()
    }

    /// The triangle's area at the begin, with its corners in the middle of their boxes.
    #[inline(always)]
    pub fn area(&self) -> f32 {
        let [a, b, c] = &self.corners;
        // Each by itself: mapped arrays become calls.
        let (a, b, c) = (centre(a.begin), centre(b.begin), centre(c.begin));
        0.5 * (b - a).cross(c - a).length()
    }

    /// The corners in the middle of the interval and of their boxes; exactly where they are if they do not move.
    #[inline(always)]
    pub fn middle(&self) -> [Vec3; 3] {
        let at = |corner: &LinearBox3| 0.5 * centre(corner.begin) + 0.5 * centre(corner.end);
        [at(&self.corners[0]), at(&self.corners[1]), at(&self.corners[2])]
    }
}

#[inline(always)]
fn centre(b: Box3) -> Vec3 {
    0.5 * b.min + 0.5 * b.max
}
