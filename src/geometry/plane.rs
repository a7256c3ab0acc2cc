//! Split planes.

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
}
