//! The order in which ranks share space: along a Morton curve.

use crate::particle::Particle;
use crate::swept_box::{Periods, SweptBox};

/// Cells of a curve along the longest axis.
const CELLS: f64 = (1 << 21) as f64;

/// A Morton curve through a box of cubic cells.
pub(crate) struct Curve {
    lo: [f64; 3],
    /// Cells per length.
    scale: f64,
    periods: Periods,
}

impl Curve {
    /// Through the box, or along periodic axes through one period.
    pub(crate) fn new(hull: &SweptBox, periods: Periods) -> Curve {
        let lo = core::array::from_fn(|axis| if periods[axis].is_some() { 0.0 } else { hull.lo[axis].into() });
        let length = |axis: usize| {
            let hull = f64::from(hull.hi[axis]) - f64::from(hull.lo[axis]);
            periods[axis].map_or(hull, f64::from)
        };
        let longest = (0..3).map(length).fold(0.0, f64::max);
        Curve { lo, scale: if longest > 0.0 { CELLS / longest } else { 0.0 }, periods }
    }

    /// The place on the curve of where a particle is in the middle of the step; along periodic axes, of its image.
    pub(crate) fn place(&self, particle: &Particle) -> u64 {
        let cell = |axis: usize| {
            let middle = 0.5 * (f64::from(particle.open[axis]) + f64::from(particle.close[axis]));
            let inside = match self.periods[axis].map(f64::from) {
                Some(period) => middle - period * (middle / period).floor(),
                None => middle - self.lo[axis],
            };
            // Saturates; places outside, for rounding, go to the last cell.
            ((inside * self.scale) as u32).min(CELLS as u32 - 1)
        };
        mbkd::morton_code([cell(0), cell(1), cell(2)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_follow_the_curve() {
        let hull = SweptBox { lo: [-1.0; 3], hi: [1.0; 3], count: 2 };
        let curve = Curve::new(&hull, [None; 3]);
        let place = |at: [f32; 3]| curve.place(&Particle::fixed(0, at));
        assert_eq!(place([-1.0; 3]), 0);
        assert_eq!(place([1.0; 3]), (1 << 63) - 1);
        assert!(place([0.5, -0.5, -0.5]) < place([-0.5, 0.5, -0.5]));
        assert!(place([-0.5, 0.5, -0.5]) < place([-0.5, -0.5, 0.5]));
        let point = Curve::new(&SweptBox::of_place([3.0; 3]), [None; 3]);
        assert_eq!(point.place(&Particle::fixed(0, [3.0; 3])), 0);
    }

    #[test]
    fn images_have_the_same_place() {
        let curve = Curve::new(&SweptBox::of_place([3.0; 3]), [Some(2.0), None, None]);
        let place = |x| curve.place(&Particle::fixed(0, [x, 3.0, 3.0]));
        assert_eq!(place(-0.5), place(1.5));
        assert_eq!(place(3.5), place(1.5));
        assert_ne!(place(0.5), place(1.5));
    }
}
