//! The distance of a point from a moving triangle, exactly.
//!
//! Above the inside of the triangle it is the distance from the plane, otherwise that from the nearest edge. Squares of
//! both are quotients: `(n . p)² / n²` with the normal `n`, and `(p² e² - (p . e)²) / e²` with an edge `e`.

use super::{Dyadic, Given, Moving, Ratio, Vector};
use mbkd::glam::DVec3;

/// The distance of a point from a triangle.
#[derive(Clone, Debug)]
pub struct ExactNearest {
    /// The squared distance.
    pub squared: Ratio,
    /// The distance in f64.
    pub near: f64,
    /// The greatest change of the distance when all input has an error of half an ulp.
    pub doubt: f64,
}

impl ExactNearest {
    /// The distance from `query`, given in some precision, to the triangle of three moving corners.
    pub fn new(query: DVec3, given: Given, corners: [&Moving; 3]) -> ExactNearest {
        let to = corners.map(|corner| &Vector::new(query) - &corner.position);
        let edges = [0, 1, 2].map(|i| &corners[(i + 1) % 3].position - &corners[i].position);
        let squared = above(&to, &edges).unwrap_or_else(|| {
            let [a, b, c] = [0, 1, 2].map(|i| from_edge(&to[i], &edges[i]));
            a.min(b).min(c)
        });
        // A distance changes by no more than its ends move, and a point of a triangle moves by no more than some
        // corner.
        let apart = corners.iter().map(|corner| corner.doubt.length()).fold(0.0, f64::max);
        ExactNearest { near: squared.to_f64().sqrt(), squared, doubt: given.doubt(query).length() + apart }
    }

    /// By how much a computed distance exceeds the exact one.
    pub fn error_of(&self, computed: f32) -> f64 {
        let computed = f64::from(computed);
        // The square of an f32 number is an f64 number.
        let sum = computed + self.near;
        if sum == 0.0 { 0.0 } else { self.squared.error_of(computed * computed) / sum }
    }
}

/// The squared distance from the plane, if the point is above the inside.
fn above(to: &[Vector; 3], edges: &[Vector; 3]) -> Option<Ratio> {
    let normal = edges[0].cross(&edges[1]);
    let inside = |i: usize| normal.dot(&edges[i].cross(&to[i])).sign() >= 0;
    let height = normal.dot(&to[0]);
    let squared = Ratio::new(height.squared(), normal.length_squared())?;
    (0..3).all(inside).then_some(squared)
}

/// The squared distance from an edge; `to` is the point relative to the edge's beginning.
fn from_edge(to: &Vector, edge: &Vector) -> Ratio {
    let (along, length) = (to.dot(edge), edge.length_squared());
    if along.sign() <= 0 {
        return Ratio::of(to.length_squared());
    }
    if along >= length {
        return Ratio::of((to - edge).length_squared());
    }
    let upper = &(&to.length_squared() * &length) - &along.squared();
    Ratio::new(upper, length).unwrap_or_else(|| Ratio::of(Dyadic::zero()))
}
