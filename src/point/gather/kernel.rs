//! Smoothing kernels of the density estimate, in space and in time.
//!
//! A kernel is a weight of `x`, the distance divided by the radius (or the time difference divided by the window), that
//! is largest at 0 and nothing beyond 1. An estimate divides by the integral of the weight over the disc (or over the
//! part of the window that is inside the shutter), so weights need no normalization of their own.
//!
//! The only platform function used is the square root, which IEEE 754 defines exactly: the results have the same bits
//! everywhere.
//!
//! Sources: H. W. Jensen, "Realistic Image Synthesis Using Photon Mapping" (2001), chapter 7.2, for cone and Gaussian;
//! B. W. Silverman, "Density Estimation for Statistics and Data Analysis" (1986), for Epanechnikov's kernel.

/// The falloff of the weight of a photon with its distance in space or time.
///
/// The disc of k photons reaches to the next one, which does not count. If the k photons are as far away as that one, as in a clump
/// or on a lattice around the query, the weights of [`Kernel::Cone`] and [`Kernel::Epanechnikov`] are all zero, and so is the
/// density.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Kernel {
    /// 1 inside: least variance, edges are blurred most.
    #[default]
    Box,
    /// 1 − x.
    Cone,
    /// 1 − x²: the least mean squared error of all kernels for smooth densities.
    Epanechnikov,
    /// exp(−4.5 x²), cut off at 1, which is three standard deviations.
    Gaussian,
}

/// The exponent of the Gaussian at x = 1.
const STEEP: f64 = 4.5;

impl Kernel {
    /// All kernels.
    pub const ALL: [Kernel; 4] = [Kernel::Box, Kernel::Cone, Kernel::Epanechnikov, Kernel::Gaussian];

    /// The weight at `x`, given x² from 0 to 1; larger values count as 1.
    #[inline(always)]
    pub fn weight(self, x_squared: f32) -> f32 {
        let x2 = if x_squared < 1.0 { x_squared } else { 1.0 };
        match self {
            Kernel::Box => 1.0,
            Kernel::Cone => 1.0 - x2.sqrt(),
            Kernel::Epanechnikov => 1.0 - x2,
            Kernel::Gaussian => exp_minus(STEEP as f32 * x2),
        }
    }

    /// The integral of the weight over a disc of this radius.
    ///
    /// ```
    /// use mbkd::point::Kernel;
    /// assert_eq!(Kernel::Epanechnikov.over_disc(2.0), 2.0 * std::f64::consts::PI);
    /// ```
    pub fn over_disc(self, radius: f64) -> f64 {
        let share = match self {
            Kernel::Box => 1.0,
            Kernel::Cone => 1.0 / 3.0,
            Kernel::Epanechnikov => 0.5,
            // (1 − exp(−a)) / a
            Kernel::Gaussian => 0.219_753_556_324_835_04,
        };
        core::f64::consts::PI * radius * radius * share
    }

    /// The integral of the weight over a ball of this radius: for densities of photons in a volume ([`GatherQuery::in_volume`]).
    ///
    /// [`GatherQuery::in_volume`]: crate::point::GatherQuery::in_volume
    ///
    /// ```
    /// use mbkd::point::Kernel;
    /// assert_eq!(Kernel::Cone.over_ball(3.0), 9.0 * std::f64::consts::PI);
    /// ```
    pub fn over_ball(self, radius: f64) -> f64 {
        let share = match self {
            Kernel::Box => 1.0,
            Kernel::Cone => 0.25,
            Kernel::Epanechnikov => 0.4,
            // 3 (√(π / a) erf(√a) / 2 − exp(−a)) / (2 a)
            Kernel::Gaussian => 0.135_178_161_680_757_86,
        };
        core::f64::consts::PI * 4.0 / 3.0 * radius * radius * radius * share
    }

    /// The integral of the weight over the times from `begin` to `end`, of a window of this half width around `time`.
    ///
    /// Dividing by it renormalizes an estimate near the ends of the shutter, where a part of the window is outside of it
    /// and has no photons.
    ///
    /// ```
    /// use mbkd::point::Kernel;
    /// assert_eq!(Kernel::Box.over_time(0.5, 0.25, 0.0, 1.0), 0.5);
    /// assert_eq!(Kernel::Box.over_time(0.0, 0.25, 0.0, 1.0), 0.25);
    /// assert_eq!(Kernel::Box.over_time(0.5, f64::INFINITY, 0.0, 1.0), 1.0);
    /// ```
    pub fn over_time(self, time: f64, window: f64, begin: f64, end: f64) -> f64 {
        let (before, after) = ((time - begin).max(0.0), (end - time).max(0.0));
        if window == f64::INFINITY {
            return before + after;
        }
        window * (self.half((before / window).min(1.0)) + self.half((after / window).min(1.0)))
    }

    /// The integral of the weight from 0 to `x`, at most 1.
    fn half(self, x: f64) -> f64 {
        match self {
            Kernel::Box => x,
            Kernel::Cone => x - 0.5 * x * x,
            Kernel::Epanechnikov => x - x * x * x / 3.0,
            Kernel::Gaussian => {
                // The series exp(−a x²) Σ x (2 a x²)^n / (1·3·5···(2n + 1)), all terms positive.
                let (y, mut term, mut sum) = (2.0 * STEEP * x * x, x, x);
                for n in 1..60 {
                    term *= y / f64::from(2 * n + 1);
                    sum += term;
                }
                sum * exp_minus_f64(STEEP * x * x)
            }
        }
    }
}

/// exp(−x) for x from 0 to about 5, within a few units of the last place.
#[inline(always)]
fn exp_minus(x: f32) -> f32 {
    // exp(x / 8) by its series up to the eighth power, the error of which is below 2e-8 here; then three squares.
    let y = x * 0.125;
    let high = 1.0 / 120.0 + y * (1.0 / 720.0 + y * (1.0 / 5040.0 + y / 40320.0));
    let series = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y * high))));
    let square = series * series;
    let fourth = square * square;
    1.0 / (fourth * fourth)
}

fn exp_minus_f64(x: f64) -> f64 {
    let (y, mut term, mut sum) = (x / 8.0, 1.0, 1.0);
    for n in 1..25 {
        term *= y / f64::from(n);
        sum += term;
    }
    let square: f64 = sum * sum;
    let fourth = square * square;
    1.0 / (fourth * fourth)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrals_are_those_of_the_weights() {
        let steps = 20_000;
        for kernel in Kernel::ALL {
            let middle = |i: i32| (f64::from(i) + 0.5) / f64::from(steps);
            let at = |x: f64| f64::from(kernel.weight((x * x) as f32));
            let line: f64 = (0..steps).map(|i| at(middle(i))).sum::<f64>() / f64::from(steps);
            let disc: f64 = (0..steps).map(|i| at(middle(i)) * 2.0 * middle(i)).sum::<f64>() / f64::from(steps);
            assert!((kernel.half(1.0) - line).abs() < 1e-6, "{kernel:?}: {} {line}", kernel.half(1.0));
            let over_disc = kernel.over_disc(1.0) / core::f64::consts::PI;
            assert!((over_disc - disc).abs() < 1e-6, "{kernel:?}: {over_disc} {disc}");
            let ball: f64 = (0..steps).map(|i| at(middle(i)) * 3.0 * middle(i).powi(2)).sum::<f64>() / f64::from(steps);
            let over_ball = kernel.over_ball(1.0) / core::f64::consts::PI * 0.75;
            assert!((over_ball - ball).abs() < 1e-6, "{kernel:?}: {over_ball} {ball}");
            let part: f64 = (0..steps).map(|i| 0.3 * at(0.3 * middle(i))).sum::<f64>() / f64::from(steps);
            let whole = 2.0 * (line + part);
            assert!((kernel.over_time(0.6, 2.0, 0.0, 2.7) - whole).abs() < 1e-5, "{kernel:?}");
        }
    }

    #[test]
    fn weights_fall_from_one_and_stay_finite() {
        for kernel in Kernel::ALL {
            assert_eq!(kernel.weight(0.0), 1.0);
            let mut last = 1.0;
            for i in 0..=1000 {
                let weight = kernel.weight(i as f32 / 1000.0);
                assert!(weight <= last && weight >= 0.0, "{kernel:?} at {i}");
                last = weight;
            }
            assert_eq!(kernel.weight(f32::INFINITY), kernel.weight(1.0));
        }
        let exact = f64::exp(-4.5);
        assert!((f64::from(Kernel::Gaussian.weight(1.0)) - exact).abs() < 1e-7);
    }
}
