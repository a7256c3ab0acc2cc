//! Vectors of exact numbers.

use super::Dyadic;
use core::ops::{Add, Sub};
use mbkd::glam::DVec3;

/// Three exact coordinates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Vector(pub [Dyadic; 3]);

impl Vector {
    /// The exact value of a vector of floats.
    pub fn new(v: impl Into<DVec3>) -> Vector {
        Vector(v.into().to_array().map(Dyadic::new))
    }

    /// The nearest f64 vector, up to an ulp per coordinate.
    pub fn to_dvec3(&self) -> DVec3 {
        DVec3::new(self.0[0].to_f64(), self.0[1].to_f64(), self.0[2].to_f64())
    }

    /// The inner product.
    pub fn dot(&self, other: &Vector) -> Dyadic {
        let [a, b, c] = [0, 1, 2].map(|i| &self.0[i] * &other.0[i]);
        &(&a + &b) + &c
    }

    /// The cross product.
    pub fn cross(&self, other: &Vector) -> Vector {
        Vector([(1, 2), (2, 0), (0, 1)].map(|(i, j)| &(&self.0[i] * &other.0[j]) - &(&self.0[j] * &other.0[i])))
    }

    /// The vector times a number.
    pub fn times(&self, by: &Dyadic) -> Vector {
        Vector([0, 1, 2].map(|i| &self.0[i] * by))
    }

    /// The squared length.
    pub fn length_squared(&self) -> Dyadic {
        self.dot(self)
    }
}

impl Add for &Vector {
    type Output = Vector;
    fn add(self, other: &Vector) -> Vector {
        Vector([0, 1, 2].map(|i| &self.0[i] + &other.0[i]))
    }
}

impl Sub for &Vector {
    type Output = Vector;
    fn sub(self, other: &Vector) -> Vector {
        Vector([0, 1, 2].map(|i| &self.0[i] - &other.0[i]))
    }
}
