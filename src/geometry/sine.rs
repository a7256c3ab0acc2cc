//! Sine and cosine, and the angle of a chord, from sums, products and quotients, which IEEE 754 defines exactly. Those of the
//! platform differ between systems in their last bits, and with them the answers of instances that rotate.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// `(sin x - x) / x³` and `(cos x - 1) / x²` as series in `x²`. At π/4 the first term left out is less than 2^-54.
const SINE: [f64; 8] = [
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5_040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
    1.0 / 355_687_428_096_000.0,
];
const COSINE: [f64; 8] = [
    -1.0 / 2.0,
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 20_922_789_888_000.0,
];

/// Sine and cosine of an angle in [0, π/2] (or just beside it), off by less than 2^-51.
#[inline]
pub(crate) fn sine_and_cosine(angle: f64) -> (f64, f64) {
    let beyond = angle > FRAC_PI_4;
    let x = if beyond { FRAC_PI_2 - angle } else { angle };
    let square = x * x;
    let sine = x + x * (square * series(SINE, square));
    let cosine = 1.0 + square * series(COSINE, square);
    if beyond { (cosine, sine) } else { (sine, cosine) }
}

/// The angle between two unit vectors that are `chord` apart: at most √2, so that the angle is at most π/2. Its relative error is
/// less than 2^-50.
pub(crate) fn angle_of_chord(chord: f64) -> f64 {
    let sine = 0.5 * chord;
    // Half of the angle, by Newton's method: each step squares its error, which is less than 2^-8 at first.
    let mut half = sine + sine * sine * sine / 6.0;
    for _ in 0..4 {
        let (s, c) = sine_and_cosine(half);
        half += (sine - s) / c;
    }
    2.0 * half
}

/// The sum of a series, in pairs (Estrin): a shorter chain of operations than term by term.
#[inline]
fn series([a, b, c, d, e, f, g, h]: [f64; 8], x: f64) -> f64 {
    let (second, fourth) = (x * x, (x * x) * (x * x));
    ((a + b * x) + (c + d * x) * second) + ((e + f * x) + (g + h * x) * second) * fourth
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn they_are_those_of_the_platform_up_to_rounding() {
        let off = |a: f64, b: f64| (a - b).abs();
        for i in 0..=100_000 {
            let angle = f64::from(i) / 100_000.0 * FRAC_PI_2;
            let ((sine, cosine), expected) = (sine_and_cosine(angle), angle.sin_cos());
            assert!(off(sine, expected.0).max(off(cosine, expected.1)) < 4.5e-16, "{angle}");
            let chord = 2.0 * (0.5 * angle).sin();
            assert!(off(angle_of_chord(chord), angle) <= 9e-16 * angle, "{angle}");
        }
        let mut random = Random(3);
        for _ in 0..10_000 {
            let tiny = random.unit_f64() * 10f64.powf(-300.0 * random.unit_f64());
            assert!(off(angle_of_chord(tiny), 2.0 * (0.5 * tiny).asin()) <= 9e-16 * tiny, "{tiny}");
            assert!(off(sine_and_cosine(tiny).0, tiny.sin()) <= 4e-16 * tiny, "{tiny}");
        }
    }

    #[test]
    fn they_have_the_same_bits_on_every_machine() {
        let mut bits = 0u64;
        for i in 0..=10_000 {
            let angle = f64::from(i) * (FRAC_PI_2 / 10_000.0);
            let (sine, cosine) = sine_and_cosine(angle);
            for number in [sine, cosine, angle_of_chord(angle * core::f64::consts::FRAC_2_SQRT_PI * 0.75)] {
                bits = (bits ^ number.to_bits()).wrapping_mul(0x100_0000_01b3);
            }
        }
        assert_eq!(bits, 0xa746_6adb_64e8_ffe4, "{bits:#x}");
    }
}
