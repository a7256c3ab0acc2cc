//! Angles without the platform's sine: scenes must have the same bits on every machine.
//!
//! Angles are counted in whole turns. Sine and cosine are polynomials in f64, which need only additions
//! and products, so IEEE arithmetic defines every bit.

use glam::{Mat3, Vec3};
use std::f64::consts::FRAC_PI_2;

/// Cosine and sine of an angle in turns.
pub(super) fn cos_sin(turns: f32) -> (f32, f32) {
    let quarters = f64::from(turns) * 4.0;
    let nearest = quarters.round();
    // In [-pi/4, pi/4] the Taylor polynomials below are good to 1e-14.
    let x = (quarters - nearest) * FRAC_PI_2;
    let x2 = x * x;
    let c = polynomial(x2, &[1.0, -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0, -1.0 / 3628800.0]);
    let s = x * polynomial(x2, &[1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0, -1.0 / 39916800.0]);
    let (c, s) = match nearest.rem_euclid(4.0) as u8 {
        0 => (c, s),
        1 => (-s, c),
        2 => (-c, -s),
        _ => (s, -c),
    };
    (c as f32, s as f32)
}

fn polynomial(x: f64, coefficients: &[f64]) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// The rotation by an angle in turns about a unit axis (Rodrigues' formula).
pub(super) fn rotation(axis: Vec3, turns: f32) -> Mat3 {
    let (c, s) = cos_sin(turns);
    let a = axis;
    let k = a * (1.0 - c);
    Mat3::from_cols(
        Vec3::new(c + k.x * a.x, k.x * a.y + s * a.z, k.x * a.z - s * a.y),
        Vec3::new(k.y * a.x - s * a.z, c + k.y * a.y, k.y * a.z + s * a.x),
        Vec3::new(k.z * a.x + s * a.y, k.z * a.y - s * a.x, c + k.z * a.z),
    )
}

/// Two unit vectors that make a right-handed frame with a unit vector (Duff et al., "Building an
/// Orthonormal Basis, Revisited", JCGT 2017).
///
/// ```
/// use glam::Vec3;
/// let (u, v) = mbkd_scenes::frame(Vec3::Z);
/// assert_eq!(u.cross(v), Vec3::Z);
/// ```
pub fn frame(n: Vec3) -> (Vec3, Vec3) {
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn close_to_the_platform_and_on_the_circle() {
        for i in -4000..4000 {
            let turns = i as f32 / 777.0;
            let (c, s) = cos_sin(turns);
            let angle = f64::from(turns) * std::f64::consts::TAU;
            assert!((f64::from(c) - angle.cos()).abs() < 1e-7 && (f64::from(s) - angle.sin()).abs() < 1e-7);
        }
        assert_eq!(cos_sin(0.25), (0.0, 1.0));
        assert_eq!(cos_sin(-0.5), (-1.0, 0.0));
    }

    #[test]
    fn rotations_turn_right_handed() {
        let turned = rotation(Vec3::Z, 0.25) * Vec3::X;
        assert!((turned - Vec3::Y).length() < 1e-6);
        let n = Vec3::new(0.6, -0.64, 0.48);
        let (u, v) = frame(n);
        assert!((u.cross(v) - n).length() < 1e-6 && u.dot(n).abs() < 1e-6);
    }
}
