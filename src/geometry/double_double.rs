//! Double-double arithmetic: numbers as sums of two f64, with 106 bits, for the few results that need more than f64.
//!
//! Sums and products are exact up to 2^-102 of the result (T. J. Dekker, "A floating-point technique for extending the
//! available precision", 1971; D. E. Knuth's sum of two numbers). Products are split by multiplication, not by a fused
//! operation, so the results are the same on every CPU.

use core::ops::{Add, Mul, Sub};

/// `high + low`, where `low` is at most half an ulp of `high`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DoubleDouble {
    high: f64,
    low: f64,
}

/// The sum and its rounding error.
fn sum(a: f64, b: f64) -> DoubleDouble {
    let high = a + b;
    let of_b = high - a;
    DoubleDouble { high, low: (a - (high - of_b)) + (b - of_b) }
}

/// The same if `a` is not the smaller magnitude.
fn sum_in_order(a: f64, b: f64) -> DoubleDouble {
    let high = a + b;
    DoubleDouble { high, low: b - (high - a) }
}

/// The upper 26 bits and the rest.
fn split(a: f64) -> [f64; 2] {
    let scaled = a * 134_217_729.0;
    let upper = scaled - (scaled - a);
    [upper, a - upper]
}

/// The product and its rounding error.
fn product(a: f64, b: f64) -> DoubleDouble {
    let high = a * b;
    let ([a, a_rest], [b, b_rest]) = (split(a), split(b));
    DoubleDouble { high, low: ((a * b - high) + a * b_rest + a_rest * b) + a_rest * b_rest }
}

impl From<f64> for DoubleDouble {
    fn from(x: f64) -> DoubleDouble {
        DoubleDouble { high: x, low: 0.0 }
    }
}

impl DoubleDouble {
    /// The nearest f64.
    pub fn to_f64(self) -> f64 {
        self.high
    }

    /// The quotient, up to 2^-100.
    pub fn over(self, by: DoubleDouble) -> DoubleDouble {
        let first = self.high / by.high;
        let rest = self - by * DoubleDouble::from(first);
        sum_in_order(first, rest.high / by.high)
    }
}

impl Add for DoubleDouble {
    type Output = DoubleDouble;
    fn add(self, other: DoubleDouble) -> DoubleDouble {
        let (high, low) = (sum(self.high, other.high), sum(self.low, other.low));
        let partly = sum_in_order(high.high, high.low + low.high);
        sum_in_order(partly.high, partly.low + low.low)
    }
}

impl Sub for DoubleDouble {
    type Output = DoubleDouble;
    fn sub(self, other: DoubleDouble) -> DoubleDouble {
        self + DoubleDouble { high: -other.high, low: -other.low }
    }
}

impl Mul for DoubleDouble {
    type Output = DoubleDouble;
    fn mul(self, other: DoubleDouble) -> DoubleDouble {
        let of_high = product(self.high, other.high);
        sum_in_order(of_high.high, of_high.low + (self.high * other.low + self.low * other.high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Sums and products of numbers of 20 bits and of very different sizes, which i128 holds.
    #[test]
    fn a_hundred_bits_are_kept() {
        let mut random = Random(7);
        let mut next = || (random.bits() >> 24) as i64 - (1 << 39);
        for _ in 0..10_000 {
            let (a, b, c, d) = (next(), next(), next() >> 20, next() >> 20);
            let number = |x: i64| DoubleDouble::from(x as f64);
            let found = number(a) * number(b) + number(c) * number(d) - number(a);
            let exact = i128::from(a) * i128::from(b) + i128::from(c) * i128::from(d) - i128::from(a);
            assert_eq!(found.high as i128 + found.low as i128, exact);
            let quotient = (number(a) * number(b)).over(number(b));
            assert_eq!((quotient.high as i64, quotient.low), (a, 0.0));
        }
    }

    #[test]
    fn quotients_have_a_hundred_bits() {
        let third = DoubleDouble::from(1.0).over(DoubleDouble::from(3.0));
        let rest = third * DoubleDouble::from(3.0) - DoubleDouble::from(1.0);
        assert!(third.low != 0.0 && rest.high.abs() < 2f64.powi(-100), "{rest:?}");
    }
}
