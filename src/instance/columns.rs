//! Matrices as queries load them, and their products with vectors in four lanes of f64.

use crate::simd::{Simd, cross};
use glam::{DAffine3, DMat3, DVec3};

/// A matrix and a translation: four columns of three, and a number more, so that the last can be loaded as four lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Columns([f64; 13]);

impl Columns {
    pub fn new(matrix3: DMat3, translation: DVec3) -> Columns {
        let mut columns = [0.0; 13];
        columns[..12].copy_from_slice(&DAffine3 { matrix3, translation }.to_cols_array());
        Columns(columns)
    }

    /// The same as a matrix.
    pub fn matrix(&self) -> DAffine3 {
        DAffine3::from_cols_slice(&self.0)
    }

    /// The columns in the first three lanes each; the fourth lanes mean nothing.
    #[inline(always)]
    pub fn load<S: Simd>(&self, s: S) -> [S::D; 4] {
        // References to four numbers, not copies of them: those would be loaded one by one.
        let column = |i: usize| -> &[f64; 4] { self.0[3 * i..].first_chunk().unwrap_or(&[0.0; 4]) };
        [s.load_d(column(0)), s.load_d(column(1)), s.load_d(column(2)), s.load_d(column(3))]
    }
}

/// A matrix of three columns times a vector.
#[inline(always)]
pub(super) fn product<S: Simd>(s: S, [x, y, z]: [S::D; 3], v: S::D) -> S::D {
    let [a, b, c, _] = s.lanes_d(v);
    x * s.splat_d(a) + y * s.splat_d(b) + z * s.splat_d(c)
}

/// Solves `matrix * x` = `a` and `= b` by Cramer's rule: the division comes last, since it has a long latency.
#[inline(always)]
pub(super) fn solved<S: Simd>(s: S, [x, y, z]: [S::D; 3], a: S::D, b: S::D) -> (S::D, S::D) {
    let (yz, zx, xy) = (cross(s, y, z), cross(s, z, x), cross(s, x, y));
    let [u, v, w, _] = s.lanes_d(z * xy);
    let scale = s.splat_d((u + v + w).recip());
    let [p, q, r, _] = s.transpose_d([yz, zx, xy, xy]);
    (product::<S>(s, [p, q, r], a) * scale, product::<S>(s, [p, q, r], b) * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::simd::{Kernel, SimdLevel, dispatch, magnitude, vector, vector_lanes};

    /// A product, the solutions of two systems, and a size.
    struct All<'a>(&'a Columns, DVec3);

    impl Kernel for All<'_> {
        type Output = [DVec3; 4];

        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> [DVec3; 4] {
            let [x, y, z, translation] = self.0.load(s);
            let v = vector_lanes(s, self.1);
            let (a, b) = solved::<S>(s, [x, y, z], v, translation);
            [
                vector(s, product::<S>(s, [x, y, z], v)),
                vector(s, a),
                vector(s, b),
                vector(s, magnitude(s, cross(s, x, v))),
            ]
        }
    }

    #[test]
    fn every_instruction_set_computes_what_glam_computes() {
        let mut random = Random(7);
        for _ in 0..1000 {
            let m = DMat3::from_cols(random.dvec(), random.dvec(), random.dvec() * 100.0);
            let (translation, v) = (random.dvec() * 10.0, random.dvec());
            let DMat3 { x_axis: x, y_axis: y, z_axis: z } = m;
            let back = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)).transpose();
            let scale = z.dot(x.cross(y)).recip();
            let expected = [m * v, (back * v) * scale, (back * translation) * scale, x.cross(v).abs()];
            let columns = Columns::new(m, translation);
            assert_eq!(columns.matrix(), DAffine3 { matrix3: m, translation });
            for level in SimdLevel::available() {
                assert_eq!(dispatch(level, All(&columns, v)), expected, "{level}");
            }
        }
    }
}
