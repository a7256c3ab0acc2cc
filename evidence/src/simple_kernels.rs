//! Common ray-triangle tests, for comparison with the library's test.

use mbkd::glam::{DVec3, Vec3};

/// Distance, and the barycentric weights of the second and the third corner.
pub type Met = (f32, f32, f32);

/// Möller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection" (1997), in f32.
pub fn moller_trumbore([a, b, c]: [Vec3; 3], origin: Vec3, dir: Vec3) -> Option<Met> {
    let (ab, ac) = (b - a, c - a);
    let p = dir.cross(ac);
    let inverse = 1.0 / ab.dot(p);
    let s = origin - a;
    let u = s.dot(p) * inverse;
    let q = s.cross(ab);
    let v = dir.dot(q) * inverse;
    let t = ac.dot(q) * inverse;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some((t, u, v))
}

/// The same in f64, with the answer rounded to f32.
pub fn moller_trumbore_f64([a, b, c]: [DVec3; 3], origin: DVec3, dir: DVec3) -> Option<Met> {
    let (ab, ac) = (b - a, c - a);
    let p = dir.cross(ac);
    let inverse = 1.0 / ab.dot(p);
    let s = origin - a;
    let u = s.dot(p) * inverse;
    let q = s.cross(ab);
    let v = dir.dot(q) * inverse;
    let t = ac.dot(q) * inverse;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some((t as f32, u as f32, v as f32))
}

/// Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (2013), in f32; edge functions that are zero are
/// recomputed in f64, as in the paper.
pub fn watertight([a, b, c]: [Vec3; 3], origin: Vec3, dir: Vec3) -> Option<Met> {
    let size = dir.abs();
    let z = if size.x > size.y && size.x > size.z {
        0
    } else if size.y > size.z {
        1
    } else {
        2
    };
    let (x, y) = ((z + 1) % 3, (z + 2) % 3);
    let shear = [dir[x] / dir[z], dir[y] / dir[z], 1.0 / dir[z]];
    let [a, b, c] = [a, b, c].map(|p| p - origin);
    let flat = |p: Vec3| [p[x] - shear[0] * p[z], p[y] - shear[1] * p[z]];
    let [fa, fb, fc] = [flat(a), flat(b), flat(c)];
    let edge = |p: [f32; 2], q: [f32; 2]| p[0] * q[1] - p[1] * q[0];
    let mut weights = [edge(fc, fb), edge(fa, fc), edge(fb, fa)];
    if weights.contains(&0.0) {
        let edge =
            |p: [f32; 2], q: [f32; 2]| (f64::from(p[0]) * f64::from(q[1]) - f64::from(p[1]) * f64::from(q[0])) as f32;
        weights = [edge(fc, fb), edge(fa, fc), edge(fb, fa)];
    }
    if weights.iter().any(|&w| w < 0.0) && weights.iter().any(|&w| w > 0.0) {
        return None;
    }
    let det = weights[0] + weights[1] + weights[2];
    if det == 0.0 {
        return None;
    }
    let t = (weights[0] * a[z] + weights[1] * b[z] + weights[2] * c[z]) * shear[2] / det;
    (t >= 0.0).then_some((t, weights[1] / det, weights[2] / det))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_agree_on_an_easy_triangle() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let (origin, dir) = (Vec3::new(0.25, 0.5, 2.0), Vec3::NEG_Z);
        assert_eq!(moller_trumbore(corners, origin, dir), Some((2.0, 0.25, 0.5)));
        assert_eq!(watertight(corners, origin, dir), Some((2.0, 0.25, 0.5)));
        let wide = corners.map(|p| p.as_dvec3());
        assert_eq!(moller_trumbore_f64(wide, origin.as_dvec3(), dir.as_dvec3()), Some((2.0, 0.25, 0.5)));
        assert_eq!(moller_trumbore(corners, Vec3::new(0.75, 0.5, 2.0), dir), None);
        assert_eq!(watertight(corners, Vec3::new(0.75, 0.5, 2.0), dir), None);
    }
}
