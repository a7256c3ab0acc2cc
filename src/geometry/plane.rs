//! Split planes.

use super::Box3;

/// A split plane that may move: `position + velocity * t` along `axis`. The paper's planes are static.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    pub axis: usize,
    pub position: f32,
    pub velocity: f32,
}

impl Plane {
    /// Where the plane is at time `t`, in f64 without noticeable rounding.
    #[inline]
    pub fn at(self, t: f32) -> f64 {
        f64::from(self.position) + f64::from(self.velocity) * f64::from(t)
    }

    /// The parts of a cell below and above the plane at time `t`.
    pub fn halves(self, cell: Box3, t: f32) -> [Box3; 2] {
        let (at, mut below, mut above) = (self.at(t) as f32, cell, cell);
        below.max[self.axis] = cell.max[self.axis].min(at);
        above.min[self.axis] = cell.min[self.axis].max(at);
        [below, above]
    }
}
