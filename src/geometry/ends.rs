//! Triangles that move linearly.

use glam::Vec3;

/// A triangle's corners at the begin and the end of the build's interval, linear in between up to `slack`.
pub(crate) struct Ends {
    pub begin: [Vec3; 3],
    pub end: [Vec3; 3],
    pub slack: f32,
}

impl Ends {
    /// The area at the begin.
    #[inline(always)]
    pub fn area(&self) -> f32 {
        let [a, b, c] = self.begin;
        0.5 * (b - a).cross(c - a).length()
    }
}
