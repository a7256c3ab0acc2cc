//! How far a ray misses its exact point under a transform because its direction is rounded.
//!
//! A ray is mapped into an instance's space in f64, and its direction is then rounded to f32: each component by at most
//! 1 ULP of itself. At a hit the ray is off by 1 ULP of `|x - o|` per axis of the instance's space, which is
//! `|M| |M^-1| |X - O|` in the world, with absolute values of all entries: at most the largest row sum of `|M| |M^-1|`
//! (Skeel's condition number) times the largest coordinate of `X - O`. Scaling the columns of `M`, that is the axes of
//! the instance's space, does not change it, so it is 1 for scalings and translations, at most 3 with a rotation, and
//! large for matrices that nearly flatten space in an oblique direction.

use glam::{DMat3, DVec3};

/// Bounds on a transform's condition over all its times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Distortion {
    /// An upper bound on the largest row sum of `|M| |M^-1|`.
    pub skeel: f64,
    /// An upper bound on the largest row sum of `|M|` times that of `|M^-1|`, which scaling does change.
    pub norm: f64,
    /// An upper bound on the reciprocal of the determinant with columns scaled to length 1, which decides what [`MAPPED`] costs.
    pub per_determinant: f64,
    /// Upper bounds on the row sums of `|M|`.
    pub rows: DVec3,
}

/// How far a point that is mapped into an instance's space is off in the world, relative to the sum of its coordinates there and of
/// its distance from the ray's origin, times the reciprocal of the determinant with columns scaled to length 1.
///
/// Queries solve `M x = v` by Cramer's rule, or by an inverse that is computed so, in f64 (u = 2^-53). With columns of length 1,
/// which changes no rounding, the absolute values of products of two columns are at most 1, so that entries of the adjugate are off
/// by 2u, the determinant by 9u, and an entry of the adjugate's product with `v` by 7u times the sum of `|v|`, with the rounding of
/// `v` and also if the inverse is rounded first. The origin and the direction of a ray are divided by the same determinant, so its
/// error stretches `x` where the ray hits something. So an entry of that `x` is off by 2 (7u |v|₁ + 9u |x|), divided by the
/// determinant, and `M x` by at most three times as much in each coordinate. `|v|₁` is at most three times the greatest coordinate
/// of `|T| + |M| |x|` and the distance from the ray's origin, `|x|` three times the former: together 288u of these, and 512u is
/// assumed. (What rounds the quotients is covered by [`Distortion::skeel`].)
pub(super) const MAPPED: f64 = 1.0 / (1u64 << 44) as f64;

impl Distortion {
    pub const NONE: Distortion = Distortion { skeel: 0.0, norm: 0.0, per_determinant: 0.0, rows: DVec3::ZERO };

    pub fn max(self, other: Distortion) -> Distortion {
        Distortion {
            skeel: self.skeel.max(other.skeel),
            norm: self.norm.max(other.norm),
            per_determinant: self.per_determinant.max(other.per_determinant),
            rows: self.rows.max(other.rows),
        }
    }

    /// The bounds for poses at a key: rows of a rotation have length 1, so a row of rotation and scale sums up to at most the
    /// length of the scale, and `|R| |R^T|` to at most 3.
    ///
    /// They hold between two keys as well if they hold at both: the scale of an axis is linear there and keeps its sign, so that
    /// its square is convex, and the ratio of two of them is monotone.
    pub fn of_scale(scale: DVec3) -> Distortion {
        let scale = scale.abs();
        let norm = 3.0 * scale.max_element() / scale.min_element();
        // Columns are orthogonal, but for the rounding of a rotation.
        Distortion { skeel: 3.0, norm, per_determinant: 2.0, rows: DVec3::splat(scale.length()) }
    }

    /// The bounds for matrices between two, with interpolated entries; `None` if one of them is singular, or too nearly
    /// to exclude it. Those of matrices that are distorted too much may be too small, but are above [`MAX_DEVIATION`].
    pub fn between(first: DMat3, last: DMat3) -> Option<Distortion> {
        Distortion::in_parts(first, last).0
    }

    /// The same, and the number of parts of the time between both that were looked at.
    fn in_parts(first: DMat3, last: DMat3) -> (Option<Distortion>, usize) {
        let mut all = Distortion { rows: row_sums(first).max(row_sums(last)), ..Distortion::NONE };
        let (mut stack, mut parts) = (vec![(first, last, 0)], 0);
        while let Some((first, last, depth)) = stack.pop() {
            parts += 1;
            if parts > MANY_PARTS && all.skeel > MAX_DEVIATION {
                break;
            }
            let middle = first * 0.5 + last * 0.5;
            let around = match Distortion::around(middle, last * 0.5 - first * 0.5) {
                Around::TooFar if depth >= SHORT => Distortion::along(first, last, middle),
                around => around,
            };
            match around {
                Around::Known(part) => all = all.max(part),
                Around::TooFar if depth < DEPTH => {
                    stack.extend([(first, middle, depth + 1), (middle, last, depth + 1)]);
                }
                Around::TooFar | Around::Singular => return (None, parts),
            }
        }
        (Some(all), parts)
    }

    /// The bounds for all `M + w D` with `w` in [-1, 1], if `D` is small.
    ///
    /// With columns scaled to length 1 (`A = M S^-1`) and `E = A^-1 D S^-1`, whose row sums are at most `e < 1`: `|A (1 + w E)|`
    /// has row sums of at most `|A| (1 + e)`, and its inverse `(1 + w E)^-1 A^-1` of at most `|A^-1| / (1 - e)`. Eigenvalues of
    /// `1 + w E` are at least `1 - e`, and the columns of `A (1 + w E)`, by which it would have to be divided, at most `1 + 3 e`
    /// long, so the determinant is at least `((1 - e) / (1 + 3 e))^3` of that of `A`.
    fn around(middle: DMat3, by: DMat3) -> Around {
        let lengths = column_lengths(middle);
        let unscale = DMat3::from_diagonal(lengths.recip());
        let scaled = middle * unscale;
        let inverse = scaled.inverse();
        if !(inverse.is_finite() && lengths.min_element() > 0.0) {
            return if by == DMat3::ZERO { Around::Singular } else { Around::TooFar };
        }
        let e = row_sums(inverse * (by * unscale)).max_element();
        if e.is_nan() || e > 0.5 {
            return Around::TooFar;
        }
        let (a, b) = (row_sums(scaled).max_element(), row_sums(inverse).max_element());
        let grown = (1.0 + e) / (1.0 - e);
        let skeel = if e == 0.0 { row_sums(abs(scaled) * abs(inverse)).max_element() } else { a * b * grown };
        let norm = a * b * grown * lengths.max_element() / lengths.min_element();
        // The computed determinant is off by 9 u.
        let determinant = (scaled.determinant().abs() - 16.0 * f64::EPSILON) * ((1.0 - e) / (1.0 + 3.0 * e)).powi(3);
        let per_determinant = if determinant > 0.0 { determinant.recip() } else { f64::INFINITY };
        if skeel.is_finite() && norm.is_finite() {
            Around::Known(Distortion { skeel, norm, per_determinant, rows: DVec3::ZERO })
        } else {
            Around::Singular
        }
    }

    /// The bounds for all matrices between two, if the determinant changes little. `D` need not be small: of nearly flat matrices
    /// that turn it would have to be smaller than they are thick.
    ///
    /// `M^-1` is the adjugate divided by the determinant. Between both matrices entries are linear, so that those of the adjugate
    /// are quadratic and the determinant is cubic. A polynomial lies between the least and the greatest of its Bernstein
    /// coefficients (Farouki, "The Bernstein polynomial basis", 2012), which are means of products of entries, some at one end and
    /// some at the other. With columns scaled to a length of about 1, at most `l`, each is off by less than a hundred roundings of
    /// `l^3` and `l^2`.
    fn along(first: DMat3, last: DMat3, middle: DMat3) -> Around {
        let lengths = column_lengths(middle);
        let unscale = DMat3::from_diagonal(lengths.recip());
        let ends = [first * unscale, last * unscale];
        let column = |end: usize, axis: usize| ends[end].col(axis);
        let l = (0..3).map(|axis| column(0, axis).length().max(column(1, axis).length())).fold(1.0, f64::max);
        let rounding = 100.0 * f64::EPSILON;
        let determinant = |x: usize, y: usize, z: usize| column(x, 0).cross(column(y, 1)).dot(column(z, 2));
        let coefficients = [
            determinant(0, 0, 0),
            (determinant(1, 0, 0) + determinant(0, 1, 0) + determinant(0, 0, 1)) / 3.0,
            (determinant(1, 1, 0) + determinant(1, 0, 1) + determinant(0, 1, 1)) / 3.0,
            determinant(1, 1, 1),
        ];
        let alike = coefficients.iter().all(|c| c.signum() == coefficients[0].signum());
        let (least, most) = coefficients
            .iter()
            .fold((f64::INFINITY, 0.0f64), |(least, most), c| (least.min(c.abs()), most.max(c.abs())));
        let least = least - rounding * l * l * l;
        // The columns of the transposed adjugate are products of two columns.
        let adjugate = |axis: usize| {
            let (y, z) = ((axis + 1) % 3, (axis + 2) % 3);
            let mean = (column(0, y).cross(column(1, z)) + column(1, y).cross(column(0, z))) * 0.5;
            let [begin, end] = [0, 1].map(|end| column(end, y).cross(column(end, z)).abs());
            begin.max(end).max(mean.abs()) + rounding * l * l
        };
        // With NaN, this is false.
        if !(alike && most <= 2.0 * least) {
            return Around::TooFar;
        }
        let greatest = |axis: usize| column(0, axis).abs().max(column(1, axis).abs());
        let entries = DMat3::from_cols(greatest(0), greatest(1), greatest(2));
        let inverse = DMat3::from_cols(adjugate(0), adjugate(1), adjugate(2)).transpose() * least.recip();
        let norm = row_sums(entries).max_element() * row_sums(inverse).max_element();
        let norm = norm * lengths.max_element() / lengths.min_element();
        let skeel = row_sums(entries * inverse).max_element();
        if skeel.is_finite() && norm.is_finite() {
            let per_determinant = l * l * l / least;
            Around::Known(Distortion { skeel, norm, per_determinant, rows: DVec3::ZERO })
        } else {
            Around::TooFar
        }
    }
}

/// Parts of the time between two keys that were halved so often are so short that [`Distortion::along`], which takes the greatest
/// entries of a part, is hardly above the exact value.
const SHORT: u32 = 6;

/// The greatest number of halvings of the time between two keys. Only the times around a nearly singular matrix are halved so
/// often, as when an object shrinks to a millionth; where all matrices are singular, the first part of the greatest depth ends the
/// search.
const DEPTH: u32 = 40;

/// The greatest rounding of a ray in an instance, in ULP of distances: 2^18. Boxes then still grow by less than the width of the
/// scene.
pub(super) const MAX_DEVIATION: f64 = 262144.0;

/// Where a matrix is so nearly singular that its determinant is not known, the number of parts grows with its condition. After so
/// many it is enough to know that it is distorted too much. (Through a singular matrix there are some hundred, at which the depth
/// ends the search.)
const MANY_PARTS: usize = 4096;

enum Around {
    Known(Distortion),
    /// The matrix changes too much for the bound.
    TooFar,
    Singular,
}

/// The absolute values of all entries.
pub(super) fn abs(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs())
}

/// The lengths of all columns, also of those whose squares f64 does not hold.
fn column_lengths(m: DMat3) -> DVec3 {
    let length = |column: DVec3| {
        // A power of two, which changes no rounding.
        let size =
            f64::from_bits(column.abs().max_element().to_bits() & f64::INFINITY.to_bits()).max(f64::MIN_POSITIVE);
        (column / size).length() * size
    };
    DVec3::new(length(m.x_axis), length(m.y_axis), length(m.z_axis))
}

/// For each row the sum of its absolute values.
pub(super) fn row_sums(m: DMat3) -> DVec3 {
    m.x_axis.abs() + m.y_axis.abs() + m.z_axis.abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn still(m: DMat3) -> Option<Distortion> {
        Distortion::between(m, m)
    }

    /// An entry of the adjugate that is zero at both ends of a part and greatest in its middle, where it is all that matters.
    #[test]
    fn bounds_of_a_part_hold_entries_of_the_inverse_that_are_zero_at_its_ends() {
        let thin = 0.01;
        let at = |w: f64| {
            DMat3::from_cols(DVec3::new(-1.0, -1.0, 0.0), DVec3::new(w, 0.0, thin), DVec3::new(0.0, 1.0 - w, thin))
        };
        let Around::Known(found) = Distortion::along(at(0.0), at(1.0), at(0.5)) else { panic!("no bounds") };
        let Around::Known(middle) = Distortion::around(at(0.5), DMat3::ZERO) else { panic!("singular") };
        assert!(middle.norm > 50.0 && found.norm >= middle.norm && found.skeel >= middle.skeel, "{found:?} {middle:?}");
    }

    #[test]
    fn distortion_is_none_for_scalings_small_for_rotations_and_large_for_shears() {
        let scale = DMat3::from_diagonal(DVec3::new(1e-3, 1.0, 1e6));
        let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(0.3);
        assert!((still(scale).unwrap().skeel - 1.0).abs() < 1e-12);
        assert!(still(turn * scale).unwrap().skeel <= 3.0);
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(1000.0, 1.0, 0.0), DVec3::Z);
        assert!(still(shear).unwrap().skeel > 500.0);
        assert_eq!(still(DMat3::ZERO), None);
        assert_eq!(still(DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z)), None);
    }

    #[test]
    fn nearly_singular_paths_end_soon() {
        let sheared = [1e6, 1e8, 1e12].map(|s| {
            let first = DMat3::from_cols(DVec3::X, DVec3::new(s, 1.0, 0.0), DVec3::Z);
            (first, DMat3::from_cols(DVec3::Y, DVec3::new(0.0, s, 1.0), DVec3::X))
        });
        let half_turn = DMat3::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), core::f64::consts::PI);
        for (first, last) in sheared.into_iter().chain([(DMat3::IDENTITY, half_turn)]) {
            let bound = Distortion::between(first, last);
            assert!(bound.is_none_or(|bound| bound.skeel > MAX_DEVIATION), "{first}, {last}: {bound:?}");
        }
    }

    #[test]
    fn flat_objects_that_turn_take_few_parts_and_their_bounds_are_close() {
        let mut random = Random(17);
        for round in 0..300 {
            // Flattened in an oblique direction, and the axes of the instance's space scaled.
            let mut turn = |most: f64| {
                let axis = random.dvec().normalize_or(DVec3::X);
                DMat3::from_axis_angle(axis, most * random.signed_f64())
            };
            let thin = 10f64.powi(-(round % 6));
            let flat =
                turn(3.0) * DMat3::from_diagonal(DVec3::new(1.0, [1.0, thin][round as usize % 2], thin)) * turn(3.0);
            let flat = flat * DMat3::from_diagonal(DVec3::new(1.0, 1e-3, 40.0));
            let (first, last) = (flat, turn(1.5) * flat);
            let (bound, parts) = Distortion::in_parts(first, last);
            assert!(parts < 300, "{parts} parts, {thin}");
            let bound = bound.expect("no singular matrix");
            let mut greatest = [0.0f64; 2];
            for i in 0..=2000 {
                let m = first + (last - first) * (f64::from(i) / 2000.0);
                let inverse = m.inverse();
                greatest[0] = greatest[0].max(row_sums(abs(m) * abs(inverse)).max_element());
                greatest[1] = greatest[1].max(row_sums(m).max_element() * row_sums(inverse).max_element());
            }
            // (The inverse here is off by its condition times the rounding.)
            assert!(greatest[0] <= bound.skeel * (1.0 + 1e-5), "{} of {}", greatest[0], bound.skeel);
            assert!(greatest[1] <= bound.norm * (1.0 + 1e-5), "{} of {}", greatest[1], bound.norm);
            assert!(bound.skeel < 12.0 * greatest[0], "{} of {}, {thin}, {parts}", greatest[0], bound.skeel);
        }
    }

    #[test]
    fn paths_through_singular_matrices_are_rejected_and_others_are_bounded() {
        assert_eq!(Distortion::between(DMat3::IDENTITY, -DMat3::IDENTITY), None);
        assert_eq!(Distortion::between(DMat3::IDENTITY, DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0))), None);
        let shrunk = Distortion::between(DMat3::IDENTITY, DMat3::from_diagonal(DVec3::splat(1e-6))).unwrap();
        assert!(shrunk.skeel < 20.0, "{}", shrunk.skeel);
        let flat = DMat3::from_diagonal(DVec3::new(1.0, 2.0, 0.0));
        assert_eq!(Distortion::between(flat, flat * 3.0), None);
        let (first, last) = (DMat3::IDENTITY, DMat3::from_rotation_z(2.5) * 3.0);
        let bound = Distortion::between(first, last).unwrap();
        for i in 0..=1000 {
            let m = first + (last - first) * (i as f64 / 1000.0);
            let exact = row_sums(abs(m) * abs(m.inverse())).max_element();
            assert!(exact <= bound.skeel, "{exact} of {}", bound.skeel);
            assert!(row_sums(m).cmple(bound.rows + 1e-12).all());
        }
        assert!(bound.skeel < 200.0, "{}", bound.skeel);
    }
}
