//! Exact arithmetic: integers times powers of two, and quotients of them.

use core::cmp::Ordering;
use core::ops::{Add, Mul, Neg, Sub};
use dashu_int::ops::{BitTest, SquareRoot};
use dashu_int::{IBig, Sign, UBig};

/// A number `mantissa * 2^exponent`. Sums, differences and products are exact.
#[derive(Clone, Debug)]
pub struct Dyadic {
    /// Odd, or zero with exponent 0, unless it is the result of a sum or a product (see `stripped`).
    mantissa: IBig,
    exponent: i64,
}

impl Dyadic {
    /// Zero.
    pub fn zero() -> Dyadic {
        Dyadic { mantissa: IBig::ZERO, exponent: 0 }
    }

    /// The value of a finite float; f32 converts to f64 exactly.
    ///
    /// # Panics
    /// If `x` is infinite or NaN.
    pub fn new(x: impl Into<f64>) -> Dyadic {
        let x: f64 = x.into();
        assert!(x.is_finite(), "{x} has no exact value");
        let bits = x.abs().to_bits();
        let (field, fraction) = ((bits >> 52) as i64, bits & ((1 << 52) - 1));
        let (mantissa, exponent) = if field == 0 { (fraction, -1074) } else { (fraction | 1 << 52, field - 1075) };
        if mantissa == 0 {
            return Dyadic::zero();
        }
        let zeros = mantissa.trailing_zeros();
        let mantissa = IBig::from(mantissa >> zeros);
        Dyadic { mantissa: if x < 0.0 { -mantissa } else { mantissa }, exponent: exponent + i64::from(zeros) }
    }

    /// -1, 0 or 1.
    pub fn sign(&self) -> i32 {
        match (self.mantissa.is_zero(), self.mantissa.sign()) {
            (true, _) => 0,
            (false, Sign::Positive) => 1,
            (false, Sign::Negative) => -1,
        }
    }

    /// The magnitude.
    pub fn abs(&self) -> Dyadic {
        if self.sign() < 0 { -self } else { self.clone() }
    }

    /// The square.
    pub fn squared(&self) -> Dyadic {
        self * self
    }

    /// `f` and `e` with `|f|` in [1, 2) or zero, so that the value is `f * 2^e` up to f64 rounding.
    fn scientific(&self) -> (f64, i64) {
        let length = self.mantissa.bit_len();
        if length == 0 {
            return (0.0, 0);
        }
        let dropped = length.saturating_sub(64);
        let magnitude: UBig = self.mantissa.clone().into_parts().1 >> dropped;
        let leading = u64::try_from(&magnitude).expect("at most 64 bits") as f64;
        let top = length.min(64) as i64 - 1;
        let scaled = leading / (top as f64).exp2();
        (f64::from(self.sign()) * scaled, self.exponent + dropped as i64 + top)
    }

    /// The nearest f64, up to one ulp.
    pub fn to_f64(&self) -> f64 {
        let (f, e) = self.scientific();
        scaled(f, e)
    }

    /// A lower bound on the square root with `bits` correct leading bits, and an upper bound: the same number with one
    /// more in its last bit.
    ///
    /// # Panics
    /// If this is negative.
    pub fn sqrt_between(&self, bits: usize) -> (Dyadic, Dyadic) {
        assert!(self.sign() >= 0, "the root of a negative number");
        if self.sign() == 0 {
            return (Dyadic::zero(), Dyadic::zero());
        }
        let mut shift = (2 * bits).saturating_sub(self.mantissa.bit_len());
        if (self.exponent - shift as i64) % 2 != 0 {
            shift += 1;
        }
        let magnitude = self.mantissa.clone().into_parts().1 << shift;
        let root = IBig::from(magnitude.sqrt());
        let exponent = (self.exponent - shift as i64) / 2;
        let above = Dyadic { mantissa: &root + IBig::ONE, exponent };
        (Dyadic { mantissa: root, exponent }, above)
    }

    /// The same value with an odd mantissa, for numbers that are used many times.
    pub fn stripped(self) -> Dyadic {
        match self.mantissa.trailing_zeros() {
            None => Dyadic::zero(),
            Some(0) => self,
            Some(zeros) => Dyadic { mantissa: self.mantissa >> zeros, exponent: self.exponent + zeros as i64 },
        }
    }

    fn combined(&self, other: &Dyadic, join: impl Fn(IBig, &IBig) -> IBig) -> Dyadic {
        if self.mantissa.is_zero() {
            return Dyadic { mantissa: join(IBig::ZERO, &other.mantissa), exponent: other.exponent };
        }
        if other.mantissa.is_zero() {
            return self.clone();
        }
        let exponent = self.exponent.min(other.exponent);
        let align = |x: &Dyadic| x.mantissa.clone() << (x.exponent - exponent) as usize;
        Dyadic { mantissa: join(align(self), &align(other)), exponent }
    }
}

/// `f * 2^e`, with underflow to zero and overflow to infinity.
fn scaled(f: f64, e: i64) -> f64 {
    let e = e.clamp(-2200, 2200) as i32;
    let third = e / 3;
    f * 2f64.powi(third) * 2f64.powi(third) * 2f64.powi(e - 2 * third)
}

impl Add for &Dyadic {
    type Output = Dyadic;
    fn add(self, other: &Dyadic) -> Dyadic {
        self.combined(other, |a, b| a + b)
    }
}

impl Sub for &Dyadic {
    type Output = Dyadic;
    fn sub(self, other: &Dyadic) -> Dyadic {
        self.combined(other, |a, b| a - b)
    }
}

impl Mul for &Dyadic {
    type Output = Dyadic;
    fn mul(self, other: &Dyadic) -> Dyadic {
        Dyadic { mantissa: &self.mantissa * &other.mantissa, exponent: self.exponent + other.exponent }
    }
}

impl Neg for &Dyadic {
    type Output = Dyadic;
    fn neg(self) -> Dyadic {
        Dyadic { mantissa: -self.mantissa.clone(), exponent: self.exponent }
    }
}

impl Ord for Dyadic {
    fn cmp(&self, other: &Dyadic) -> Ordering {
        (self - other).sign().cmp(&0)
    }
}

impl PartialOrd for Dyadic {
    fn partial_cmp(&self, other: &Dyadic) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Dyadic {
    fn eq(&self, other: &Dyadic) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Dyadic {}

/// A quotient of two [`Dyadic`]s with a positive denominator.
#[derive(Clone, Debug)]
pub struct Ratio {
    upper: Dyadic,
    lower: Dyadic,
}

impl Ratio {
    /// `upper / lower`; `None` if `lower` is zero.
    pub fn new(upper: Dyadic, lower: Dyadic) -> Option<Ratio> {
        match lower.sign() {
            0 => None,
            1 => Some(Ratio { upper, lower }),
            _ => Some(Ratio { upper: -&upper, lower: -&lower }),
        }
    }

    /// A dyadic number as a quotient.
    pub fn of(x: Dyadic) -> Ratio {
        Ratio { upper: x, lower: Dyadic::new(1.0) }
    }

    /// -1, 0 or 1.
    pub fn sign(&self) -> i32 {
        self.upper.sign()
    }

    /// The nearest f64, up to two ulp.
    pub fn to_f64(&self) -> f64 {
        let ((f, e), (g, h)) = (self.upper.scientific(), self.lower.scientific());
        scaled(f / g, e - h)
    }

    /// By how much `x` exceeds the exact value, accurate to two ulp of f64 however small the difference is.
    ///
    /// # Panics
    /// If `x` is infinite or NaN.
    pub fn error_of(&self, x: impl Into<f64>) -> f64 {
        let upper = &(&Dyadic::new(x) * &self.lower) - &self.upper;
        Ratio { upper, lower: self.lower.clone() }.to_f64()
    }

    /// The quotient divided by a whole number.
    pub fn divided_by(&self, n: usize) -> Ratio {
        Ratio { upper: self.upper.clone(), lower: &self.lower * &Dyadic::new(n as f64) }
    }

    /// Compares with a float.
    pub fn cmp_float(&self, x: f64) -> Ordering {
        if x.is_infinite() {
            return if x > 0.0 { Ordering::Less } else { Ordering::Greater };
        }
        self.upper.cmp(&(&Dyadic::new(x) * &self.lower))
    }
}

impl Ord for Ratio {
    fn cmp(&self, other: &Ratio) -> Ordering {
        (&self.upper * &other.lower).cmp(&(&other.upper * &self.lower))
    }
}

impl PartialOrd for Ratio {
    fn partial_cmp(&self, other: &Ratio) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Ratio {
    fn eq(&self, other: &Ratio) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Ratio {}
