//! Squared distances between a query and moving points, exactly.

use super::{Dyadic, Given, Moving, Vector, ulp32};
use mbkd::glam::DVec3;

/// The squared distance between a query and a point.
#[derive(Clone, Debug)]
pub struct ExactDistance {
    /// The square itself.
    pub squared: Dyadic,
    /// The same in f64.
    pub near: f64,
    /// How far it moves when all input has an error of half an ulp.
    pub doubt: f64,
}

impl ExactDistance {
    /// The squared distance between `query`, given in some precision, and a moving point.
    pub fn new(query: DVec3, given: Given, point: &Moving) -> ExactDistance {
        let between = &Vector::new(query) - &point.position;
        let squared = between.length_squared();
        // The square moves by 2 |between| d + d²; if the points are nearer than their doubt the second term dominates.
        let apart = given.doubt(query) + point.doubt;
        let doubt = (2.0 * between.to_dvec3().abs() + apart).dot(apart);
        ExactDistance { near: squared.to_f64(), squared, doubt }
    }

    /// The unit of errors for a computed square: the doubt, and half an ulp of f32 for rounding.
    pub fn unit(&self) -> f64 {
        self.doubt + ulp32(self.near) / 2.0
    }

    /// By how much a computed square exceeds the exact one.
    pub fn error_of(&self, computed: f32) -> f64 {
        (&Dyadic::new(computed) - &self.squared).to_f64()
    }
}
