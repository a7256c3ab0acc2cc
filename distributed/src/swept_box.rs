//! Boxes around where particles are during a step, and which of them come how near each other, images included.
//!
//! **Why nothing within the radius is overlooked.** Distances that decide are computed in f32 or from f32 positions
//! elsewhere. With M the largest coordinate of two boxes, or of the way between their images, and u = 2^-24: a position
//! between the keys is off by at most 4Mu, so it may be outside of the box by as much; the difference of two by 2Mu
//! more; to the nearest periodic image, or to an image whose coordinates are rounded, in f64 first, by 8Mu. Along three axes
//! that is below 32Mu. The rounded square of a distance and the rounded square of a radius are off by 4u of themselves
//! together, where they are not below 1e-36, which f32 does not tell from zero with that precision. So boxes count as near up
//! to `radius·(1 + 1e-6) + 64Mu + 1e-18`.

use crate::particle::Particle;
use bytemuck::{Pod, Zeroable};
use core::ops::RangeInclusive;

/// A box around a number of particles throughout a step.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct SweptBox {
    pub(crate) lo: [f32; 3],
    pub(crate) hi: [f32; 3],
    /// How many particles are inside.
    pub(crate) count: u64,
}

/// Lengths of periodic axes.
pub(crate) type Periods = [Option<f32>; 3];

/// A whole number of periods along each axis.
pub(crate) type Image = [i32; 3];

impl SweptBox {
    /// Around nothing.
    pub(crate) const NONE: SweptBox = SweptBox { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3], count: 0 };

    /// A place.
    pub(crate) fn of_place(at: [f32; 3]) -> SweptBox {
        SweptBox { lo: at, hi: at, count: 1 }
    }

    /// Around all of several boxes.
    pub(crate) fn around(boxes: impl IntoIterator<Item = SweptBox>) -> SweptBox {
        boxes.into_iter().fold(SweptBox::NONE, |a, b| SweptBox {
            lo: core::array::from_fn(|axis| a.lo[axis].min(b.lo[axis])),
            hi: core::array::from_fn(|axis| a.hi[axis].max(b.hi[axis])),
            count: a.count + b.count,
        })
    }

    /// The largest coordinate along an axis.
    fn size(&self, axis: usize) -> f64 {
        self.lo[axis].abs().max(self.hi[axis].abs()).into()
    }

    /// Whether another box lies inside.
    pub(crate) fn contains(&self, other: &SweptBox) -> bool {
        (0..3).all(|axis| self.lo[axis] <= other.lo[axis] && other.hi[axis] <= self.hi[axis])
    }
}

impl From<&Particle> for SweptBox {
    fn from(&Particle { open, close, .. }: &Particle) -> SweptBox {
        SweptBox::around([SweptBox { count: 0, ..SweptBox::of_place(open) }, SweptBox::of_place(close)])
    }
}

/// How far an image is from where it came.
pub(crate) fn shift(image: Image, periods: Periods) -> [f64; 3] {
    core::array::from_fn(|axis| f64::from(image[axis]) * f64::from(periods[axis].unwrap_or(0.0)))
}

/// Where the image of a place is, rounded as in one process: a whole number of periods from the image in the first period, both
/// in f64.
pub(crate) fn moved(at: [f32; 3], image: Image, periods: Periods) -> [f32; 3] {
    core::array::from_fn(|axis| {
        let Some(length) = periods[axis].map(f64::from) else { return at[axis] };
        let at = f64::from(at[axis]);
        let home = at.rem_euclid(length);
        (home + (((at - home) / length).round() + f64::from(image[axis])) * length) as f32
    })
}

/// What is added to a radius for rounding, where coordinates are at most `size`.
fn slack(radius: f64, size: f64) -> f64 {
    radius * 1e-6 + size * (64.0 / 16_777_216.0) + 1e-18
}

/// Whether an image of `a` may come within `radius` of `b`.
pub(crate) fn near(a: &SweptBox, b: &SweptBox, by: [f64; 3], radius: f64) -> bool {
    near_with(a, b, by, radius, slack)
}

/// [`near`] with another slack.
fn near_with(a: &SweptBox, b: &SweptBox, by: [f64; 3], radius: f64, slack: fn(f64, f64) -> f64) -> bool {
    let (mut square, mut size) = (0.0, 0.0f64);
    for (axis, by) in by.into_iter().enumerate() {
        let below = f64::from(a.lo[axis]) + by - f64::from(b.hi[axis]);
        let above = f64::from(b.lo[axis]) - f64::from(a.hi[axis]) - by;
        let gap = below.max(above).max(0.0);
        square += gap * gap;
        size = size.max(a.size(axis)).max(b.size(axis)).max(by.abs());
    }
    square.sqrt() <= radius + slack(radius, size)
}

/// The images of `a` that may come within `radius` of `b`, and of those farther than half a period only such that may be
/// the nearest one of some particle. None where either box is empty.
pub(crate) fn images(a: &SweptBox, b: &SweptBox, periods: Periods, radius: f64) -> impl Iterator<Item = Image> + use<> {
    let range = |axis: usize| range(a, b, periods[axis], radius, axis);
    let ([x, y, z], (a, b)) = ([range(0), range(1), range(2)], (*a, *b));
    let all =
        x.flat_map(move |i| y.clone().map(move |j| [i, j])).flat_map(move |[i, j]| z.clone().map(move |k| [i, j, k]));
    let present = a.count > 0 && b.count > 0;
    all.filter(move |&image| present && near(&a, &b, shift(image, periods), radius))
}

/// The images along an axis.
fn range(a: &SweptBox, b: &SweptBox, period: Option<f32>, radius: f64, axis: usize) -> RangeInclusive<i32> {
    let Some(period) = period.map(f64::from) else { return 0..=0 };
    let radius = radius.min(0.5 * period);
    let most = radius + slack(radius, a.size(axis) + b.size(axis) + period);
    let first = ((f64::from(b.lo[axis]) - most - f64::from(a.hi[axis])) / period).ceil();
    let last = ((f64::from(b.hi[axis]) + most - f64::from(a.lo[axis])) / period).floor();
    first as i32..=last as i32
}

/// A distance that no particle in `b` is beyond, from any place in `a`, to its nearest image.
pub(crate) fn farthest(a: &SweptBox, b: &SweptBox, periods: Periods) -> f64 {
    let (mut square, mut size) = (0.0, 0.0f64);
    for (axis, period) in periods.into_iter().enumerate() {
        let (a_lo, a_hi) = (f64::from(a.lo[axis]), f64::from(a.hi[axis]));
        let (b_lo, b_hi) = (f64::from(b.lo[axis]), f64::from(b.hi[axis]));
        let mut apart = 0.5 * ((a_lo + a_hi) - (b_lo + b_hi));
        let period = f64::from(period.unwrap_or(0.0));
        if period > 0.0 {
            apart -= period * (apart / period).round();
        }
        let mut far = apart.abs() + 0.5 * ((a_hi - a_lo) + (b_hi - b_lo));
        if period > 0.0 {
            far = far.min(0.5 * period);
        }
        square += far * far;
        size = size.max(a.size(axis)).max(b.size(axis)).max(period);
    }
    let distance = square.sqrt();
    distance + slack(distance, size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mbkd_scenes::Random;

    fn cell(lo: [f32; 3], hi: [f32; 3]) -> SweptBox {
        SweptBox { lo, hi, count: 1 }
    }

    #[test]
    fn a_box_around_a_particle_holds_its_way() {
        let swept = SweptBox::from(&Particle { id: 0, open: [0.0, 2.0, 0.0], close: [1.0, -2.0, 0.0] });
        assert_eq!(swept, cell([0.0, -2.0, 0.0], [1.0, 2.0, 0.0]));
        assert_eq!(SweptBox::around([swept, swept]).count, 2);
    }

    #[test]
    fn boxes_are_near_up_to_the_radius() {
        let (a, b) = (cell([0.0; 3], [1.0; 3]), cell([4.0, 5.0, 0.0], [6.0; 3]));
        assert!(near(&a, &b, [0.0; 3], 5.0) && near(&b, &a, [0.0; 3], 5.0), "3-4-5");
        assert!(!near(&a, &b, [0.0; 3], 4.99));
        assert!(near(&a, &b, [3.0, 0.0, 0.0], 4.0) && !near(&a, &b, [-0.1, 0.0, 0.0], 5.0));
    }

    /// Of 20 000 pairs of places whose computed distance is at most the radius, how many do not count as near.
    fn pairs_lost(slack: fn(f64, f64) -> f64) -> usize {
        let mut random = Random(5);
        let mut lost = 0;
        for i in 0..20_000 {
            let apart = 10f32.powi(i % 7 - 3);
            let a: [f32; 3] = random.vec().to_array();
            let b = a.map(|x| x + apart * random.signed());
            let [x, y, z] = [0, 1, 2].map(|axis| a[axis] - b[axis]);
            let square = (x * x + y * y) + z * z;
            // The least radius whose square is no less.
            let mut radius = square.sqrt().next_down();
            while radius * radius < square {
                radius = radius.next_up();
            }
            let [a, b] = [a, b].map(SweptBox::of_place);
            lost += usize::from(!near_with(&a, &b, [0.0; 3], radius.into(), slack));
        }
        lost
    }

    #[test]
    fn the_slack_for_rounding_is_enough_and_needed() {
        assert_eq!(pairs_lost(slack), 0);
        let lost = pairs_lost(|_, _| 0.0);
        assert!(lost > 1000, "without slack only {lost} are lost");
    }

    #[test]
    fn images_are_those_within_the_radius() {
        let periods = [Some(10.0), None, None];
        let (a, b) = (cell([0.5, 0.0, 0.0], [1.0, 0.0, 0.0]), cell([9.0, 0.0, 0.0], [9.5, 0.0, 0.0]));
        let found = |a: &SweptBox, b: &SweptBox, radius: f64| {
            images(a, b, periods, radius).map(|image| image[0]).collect::<Vec<_>>()
        };
        assert_eq!(found(&a, &b, 1.0), [1], "1 apart across the face");
        assert_eq!(found(&b, &a, 1.0), [-1]);
        assert_eq!(found(&a, &b, 0.9), []);
        assert_eq!(found(&a, &cell([-25.0, 0.0, 0.0], [25.0, 0.0, 0.0]), 0.0), [-2, -1, 0, 1, 2]);
        assert_eq!(found(&a, &SweptBox::NONE, f64::INFINITY), []);
        // Of all images, those that may be the nearest.
        assert_eq!(found(&a, &b, f64::INFINITY), [1]);
        assert_eq!(found(&a, &cell([5.8, 0.0, 0.0], [5.9, 0.0, 0.0]), f64::INFINITY), [0, 1]);
    }

    #[test]
    fn no_particle_is_beyond_the_farthest_distance() {
        let (a, b) = (cell([0.0; 3], [1.0; 3]), cell([3.0, 0.0, 0.0], [4.0, 1.0, 1.0]));
        let open = farthest(&a, &b, [None; 3]);
        assert!((18f64.sqrt()..4.2427).contains(&open), "{open}");
        let torus = farthest(&a, &b, [Some(4.0), None, None]);
        assert!((6f64.sqrt()..2.4496).contains(&torus), "half a period at most: {torus}");
    }
}
