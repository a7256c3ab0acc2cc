//! A space placed in another by an affine map, for distance queries.

use super::Aabb;
use glam::{DAffine3, DMat3, DVec3};

/// A map from a placed space to the one in which distances are measured, with a bound of its inverse.
///
/// **Distances.** For any matrix `X` with `|I - X M| <= e < 1`, the inverse of `M` is no longer than `|X| / (1 - e)`. So
/// distances in the placed space are at most that many times those of their images. The norm `|X|` is at most the root of
/// the largest row sum of `X Xᵀ`, which is exact for a rotation after a scaling, whatever the scales.
///
/// **Along axes.** Let `c` be the columns of `M`, and `k` the cosines of the angles between them. By `2|ab| <= a² + b²`, `|M v|²`
/// is at least the sum of `|c_i|² v_i² (1 - sum of |k_ij|)` over the axes `i`, with the other axes `j`. This is exact for a
/// rotation after a scaling, and tells nothing about a strong shear.
///
/// **Sheared spaces.** Let `A` be `M` with columns scaled to length 1, `M = A S`. Gram and Schmidt's method makes of it a rotation
/// and an upper triangular matrix `U` with `|A v| = |U v|`. In f64 this `U` is exact for a matrix that differs from `A` by some
/// roundings (Björck, "Solving linear least squares problems by Gram-Schmidt orthogonalization", 1967), which changes `|A v|` by as
/// many times the norm of the inverse of `A`: entries of the adjugate are at most 1, so that is at most 3 divided by the
/// determinant, the product of the diagonal of `U`. So `|M v|` is at least `|U S v|`, slightly shortened.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placement {
    pub matrix: DAffine3,
    inverse: DMat3,
    /// For each axis the least length of an image per distance in the placed space: the distance of images is at least that of the
    /// places scaled by these. Zero if there is no such bound.
    least: DVec3,
    /// Of a space that is sheared: an upper triangular matrix that makes no vector longer than its image is.
    shear: Option<DMat3>,
}

/// The preimage of a point in a placed space.
pub(crate) struct Preimage {
    pub point: DVec3,
    /// The distance of images is at least that of the places scaled by these along the axes. Zero if there is no such bound.
    pub least: DVec3,
    /// Of a space that is sheared: an upper triangular matrix. The distance of images is at least that of the places mapped by it.
    pub shear: Option<DMat3>,
    /// By how much a computed distance of images may be smaller than the distance to which `least` and `shear` apply.
    pub deviation: f64,
}

/// Far more than the f64 rounding of a few steps, relative to the magnitudes involved.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

impl Placement {
    pub fn new(matrix: DAffine3) -> Placement {
        let inverse = matrix.matrix3.inverse();
        let off = sum(DMat3::IDENTITY - inverse * matrix.matrix3) + ROUNDING * sum(inverse) * sum(matrix.matrix3);
        let longest = norm(inverse) * (1.0 + ROUNDING) / (1.0 - off);
        // NaN fails this as well.
        let known = off < 0.5 && longest.is_finite();
        let everywhere = DVec3::splat(if known { longest.recip() } else { 0.0 });
        let (along, cosine) = least_along_axes(matrix.matrix3);
        // What is farther than a distance is outside of an ellipsoid; the smaller one says more.
        let shear = if known && cosine >= LEAST_SHEAR { sheared(matrix.matrix3) } else { None };
        let least = if known && along.element_product() > everywhere.element_product() { along } else { everywhere };
        Placement { matrix, inverse, least, shear }
    }

    /// The placement of a space in a space that is itself placed, if `placed` is given.
    pub fn then(placed: Option<&Placement>, inner: DAffine3) -> Placement {
        Placement::new(placed.map_or(inner, |outer| outer.matrix * inner))
    }

    /// Maps a point into the placed space, for distances to objects within `bounds` there.
    ///
    /// The error of the preimage is measured by the distance of its own image from the point. `deviation` includes this error, and
    /// the rounding of the images of objects in `bounds`.
    pub fn preimage(&self, point: DVec3, bounds: Aabb) -> Preimage {
        let there = self.inverse * (point - self.matrix.translation);
        if !there.is_finite() || self.least == DVec3::ZERO {
            return Preimage { point: DVec3::ZERO, least: DVec3::ZERO, shear: None, deviation: 0.0 };
        }
        let missed = self.matrix.transform_point3(there) - point;
        let far = there.abs() + bounds.min.abs().max(bounds.max.abs());
        let size = sum(self.matrix.matrix3) * far.max_element()
            + self.matrix.translation.abs().max_element()
            + point.abs().max_element();
        let deviation = missed.length() + ROUNDING * size;
        Preimage { point: there, least: self.least, shear: self.shear, deviation }
    }
}

/// For each axis a lower bound of the lengths of images per length along it, as derived above; zero if there is none. And the
/// greatest cosine of two axes.
fn least_along_axes(m: DMat3) -> (DVec3, f64) {
    let lengths = DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length());
    let [x, y, z] = [m.x_axis / lengths.x, m.y_axis / lengths.y, m.z_axis / lengths.z];
    let [xy, xz, yz] = [x.dot(y).abs(), x.dot(z).abs(), y.dot(z).abs()];
    let left = DVec3::ONE - DVec3::new(xy + xz, xy + yz, xz + yz) - ROUNDING;
    // NaN fails this as well, and lengths whose squares are not normal numbers are no bound.
    let known = left.cmpgt(DVec3::ZERO).all() && lengths.min_element() > 1e-150 && lengths.max_element() < 1e150;
    let least = if known { lengths * (left.map(f64::sqrt) - ROUNDING).max(DVec3::ZERO) } else { DVec3::ZERO };
    (least, xy.max(xz).max(yz))
}

/// Axes whose directions have a greater cosine are sheared.
const LEAST_SHEAR: f64 = 1.0 / 64.0;

/// An upper triangular matrix that makes vectors about as long as this one does and none longer, as derived above, for a matrix
/// that shears; `None` if it flattens space too much.
#[cold]
#[inline(never)]
fn sheared(m: DMat3) -> Option<DMat3> {
    let lengths = DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length());
    let [x, y, z] = [m.x_axis / lengths.x, m.y_axis / lengths.y, m.z_axis / lengths.z];
    let (xy, xz) = (x.dot(y), x.dot(z));
    let across = y - x * xy;
    let yy = across.length();
    let across = across / yy;
    let rest = z - x * xz;
    let yz = across.dot(rest);
    let zz = (rest - across * yz).length();
    let lost = 3.0 * ROUNDING / (yy * zz);
    let least = 1e-150..1e150;
    // NaN fails this as well.
    let known = lost < 1e-6 && lengths.to_array().iter().all(|length| least.contains(length));
    let columns = [DVec3::X, DVec3::new(xy, yy, 0.0), DVec3::new(xz, yz, zz)];
    let [a, b, c] = columns.map(|column| column * (1.0 - lost));
    known.then(|| DMat3::from_cols(a * lengths.x, b * lengths.y, c * lengths.z))
}

/// The sum of the magnitudes of all entries: a bound of every norm.
fn sum(m: DMat3) -> f64 {
    [m.x_axis, m.y_axis, m.z_axis].map(|column| column.abs().element_sum()).iter().sum()
}

/// An upper bound of the spectral norm.
fn norm(m: DMat3) -> f64 {
    let most = |m: DMat3| {
        let rows = m.x_axis.abs() + m.y_axis.abs() + m.z_axis.abs();
        rows.max_element()
    };
    most(m * m.transpose()).min(most(m.transpose() * m)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use glam::DQuat;

    fn vec(random: &mut Random) -> DVec3 {
        DVec3::new(random.signed_f64(), random.signed_f64(), random.signed_f64())
    }

    #[test]
    fn no_distance_grows_by_more_and_some_by_as_much() {
        let (mut random, mut sheared) = (Random(1), 0);
        for round in 0..2000 {
            let scale =
                DVec3::from([0, 1, 2].map(|_| 10f64.powf(4.0 * random.signed_f64()))) * vec(&mut random).signum();
            let rotation = DQuat::from_axis_angle(vec(&mut random).normalize(), 3.0 * random.signed_f64());
            let mut matrix = DAffine3::from_scale_rotation_translation(scale, rotation, vec(&mut random) * 100.0);
            if round % 2 == 1 {
                matrix = DAffine3::from_mat3_translation(DMat3::from_quat(rotation.inverse()), DVec3::X) * matrix;
                matrix.matrix3.x_axis += matrix.matrix3.y_axis * random.signed_f64();
            }
            let placement = Placement::new(matrix);
            let bounds = Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE };
            let q = vec(&mut random) * 10f64.powf(5.0 * random.signed_f64());
            let Preimage { point, least, shear, deviation } = placement.preimage(q, bounds);
            assert!(least.min_element() > 0.0 && deviation.is_finite());
            let (mut most, mut most_of_shear, mut least_of_shear) = (0.0f64, 0.0f64, f64::INFINITY);
            for i in 0..50 {
                // Also along each axis, in which scales are met exactly.
                let by = if i < 3 { DVec3::AXES[i] } else { vec(&mut random) };
                let p = vec(&mut random) * 0.5 + by * 0.5;
                let inside = ((point - p) * least).length();
                let image = (matrix.transform_point3(p) - q).length();
                assert!(inside <= image + deviation, "{inside} {image} {deviation} {least}");
                most = most.max((by * least).length() / matrix.transform_vector3(by).length());
                if let Some(shear) = shear {
                    let inside = (shear * (point - p)).length();
                    assert!(inside <= image + deviation, "{inside} {image} {deviation} {shear}");
                    let ratio = (shear * by).length() / matrix.transform_vector3(by).length();
                    (most_of_shear, least_of_shear) = (most_of_shear.max(ratio), least_of_shear.min(ratio));
                }
            }
            sheared += usize::from(shear.is_some());
            assert!(shear.is_none() || most_of_shear <= 1.0 && least_of_shear > 1.0 - 1e-5);
            assert!(most <= 1.0 + 1e-12);
            if round % 2 == 0 {
                assert!((least - scale.abs()).abs().cmple(scale.abs() * 1e-12).all(), "{least} {scale}");
                assert!(shear.is_none());
            }
        }
        assert!(sheared > 600, "{sheared}");
    }

    #[test]
    fn nothing_is_known_of_maps_that_flatten_space() {
        let flat = DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z);
        for matrix3 in [flat, DMat3::ZERO, DMat3::from_diagonal(DVec3::new(1.0, f64::NAN, 1.0))] {
            let placement = Placement::new(DAffine3 { matrix3, translation: DVec3::ZERO });
            let preimage = placement.preimage(DVec3::ONE, Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE });
            assert!(preimage.least == DVec3::ZERO && preimage.point.is_finite());
        }
    }
}
