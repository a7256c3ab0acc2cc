//! Ray against moving triangle, exactly.
//!
//! With the corners relative to the origin, the three volumes `d . (q x q')` tell on which side of each edge the ray
//! passes. Their sum is the determinant, their shares of it are the barycentric weights.

use super::{Given, Moving, Ratio, Vector, ulp32};
use core::cmp::Ordering;
use mbkd::Ray;
use mbkd::glam::DVec3;

/// A ray in exact numbers.
pub struct ExactRay {
    /// The ray.
    pub ray: Ray,
    origin: Vector,
    dir: Vector,
    /// The greatest error of each coordinate of the origin.
    origin_doubt: DVec3,
    /// The greatest error of each coordinate of the direction.
    dir_doubt: DVec3,
}

impl ExactRay {
    /// A ray whose origin was given in some precision. Its direction is always f32.
    pub fn new(ray: &Ray, origin: Given) -> ExactRay {
        ExactRay {
            ray: *ray,
            origin: Vector::new(ray.origin),
            dir: Vector::new(ray.dir),
            origin_doubt: origin.doubt(ray.origin),
            dir_doubt: ray.dir.as_dvec3().to_array().map(|d| ulp32(d) / 2.0 * f64::from(d != 0.0)).into(),
        }
    }

    pub(super) fn origin(&self) -> &Vector {
        &self.origin
    }

    pub(super) fn dir(&self) -> &Vector {
        &self.dir
    }

    /// The range of `t`. Distances beyond f32, before or behind, are misses.
    pub(super) fn range(&self) -> [f64; 2] {
        [self.ray.t_min.max(f32::MIN).into(), self.ray.t_max.min(f32::MAX).into()]
    }

    /// Whether a distance is in the range.
    pub(super) fn within(&self, t: &Ratio) -> bool {
        let [low, high] = self.range();
        t.cmp_float(low) != Ordering::Less && t.cmp_float(high) != Ordering::Greater
    }

    /// The greatest error of the ray's point at `t`.
    pub(super) fn doubt_at(&self, t: f64) -> DVec3 {
        self.origin_doubt + self.dir_doubt * t.abs()
    }
}

/// The intersection of a ray and a triangle.
#[derive(Clone, Debug)]
pub struct Meeting {
    /// Whether the ray's line passes through the closed triangle and `t` is within the ray's range.
    pub hit: bool,
    /// How certain `hit` is, in units of the condition: input with an error of fewer half ulps than this (about) gives
    /// the same verdict. Infinite if nothing is in doubt.
    pub margin: f64,
    /// Distance in units of the direction; `None` if ray and plane are parallel.
    pub t: Option<Ratio>,
    /// Barycentric weights of the second and the third corner.
    pub weights: Option<[Ratio; 2]>,
    /// How far `t` moves when all input has an error of half an ulp.
    pub t_doubt: f64,
    /// How far the weights move then.
    pub weight_doubts: [f64; 2],
}

/// How far each of the three signed volumes moves when all input has an error of half an ulp, in f64.
fn volumes_in_doubt(ray: &ExactRay, q: [DVec3; 3], corners: [DVec3; 3]) -> [f64; 3] {
    let d = ray.ray.dir.as_dvec3();
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        q[i].cross(q[j]).abs().dot(ray.dir_doubt)
            + q[j].cross(d).abs().dot(corners[i])
            + d.cross(q[i]).abs().dot(corners[j])
            + d.cross(q[i] - q[j]).abs().dot(ray.origin_doubt)
    })
}

/// The intersection of a ray with a triangle of three moving corners.
pub fn meet_triangle(ray: &ExactRay, corners: [&Moving; 3]) -> Meeting {
    let q = corners.map(|c| &c.position - &ray.origin);
    let cross = [q[1].cross(&q[2]), q[2].cross(&q[0]), q[0].cross(&q[1])];
    let volumes = [0, 1, 2].map(|k| ray.dir.dot(&cross[k]));
    let det = &(&volumes[0] + &volumes[1]) + &volumes[2];
    let near = [0, 1, 2].map(|k| q[k].to_dvec3());
    let doubts = volumes_in_doubt(ray, near, corners.map(|c| c.doubt));
    let certain = [0, 1, 2].map(|k| volumes[k].to_f64() / doubts[k].max(f64::MIN_POSITIVE));
    let line = line_margin(certain);
    let on_line = volumes.iter().all(|v| v.sign() >= 0) || volumes.iter().all(|v| v.sign() <= 0);
    let parallel = Meeting {
        hit: false,
        margin: if on_line { 0.0 } else { line.abs() },
        t: None,
        weights: None,
        t_doubt: f64::INFINITY,
        weight_doubts: [f64::INFINITY; 2],
    };
    let Some(t) = Ratio::new(q[0].dot(&cross[0]), det.clone()) else { return parallel };
    let weight = |k: usize| Ratio::new(volumes[k].clone(), det.clone()).expect("a determinant that is not zero");
    let (about, weights) = (t.to_f64(), [0, 1, 2].map(|k| weight(k).to_f64().abs()));
    // The relative displacement of the ray's point and the triangle's point by input errors.
    let mut apart = ray.doubt_at(about);
    for (corner, weight) in corners.iter().zip(weights) {
        apart += corner.doubt * weight;
    }
    let d = ray.ray.dir.as_dvec3();
    // Differences are computed exactly before they become f64: edges of slivers far from zero would otherwise lose all
    // their bits.
    let edge = |i: usize, j: usize| (&q[j] - &q[i]).to_dvec3();
    let normal = (&(&cross[0] + &cross[1]) + &cross[2]).to_dvec3();
    let det = det.to_f64().abs();
    let t_doubt = normal.abs().dot(apart) / det;
    let weight_doubts = [d.cross(edge(0, 2)), d.cross(edge(0, 1))].map(|g| g.abs().dot(apart) / det);
    let in_range = ray.within(&t);
    let range = range_margin(&t, ray.range(), t_doubt, in_range);
    let hit = on_line && in_range;
    let margin = match (on_line, in_range) {
        (true, true) => line.abs().min(range),
        (true, false) => range,
        (false, true) => line.abs(),
        (false, false) => line.abs().max(range),
    };
    Meeting { hit, margin, t: Some(t), weights: Some([weight(1), weight(2)]), t_doubt, weight_doubts }
}

/// How certain it is that the ray's line passes through (positive) or beside the triangle (negative), given the three
/// volumes in units of their doubts.
fn line_margin(certain: [f64; 3]) -> f64 {
    let least = certain.into_iter().fold(f64::INFINITY, |m, v| m.min(v.abs()));
    let positive = certain.into_iter().fold(0.0, f64::max);
    let negative = certain.into_iter().fold(0.0, |m: f64, v| m.max(-v));
    let beside = positive.min(negative);
    if beside > 0.0 { -beside } else { least }
}

/// How certain it is that `t` is within or outside a range. The ends are taken as exact.
pub(super) fn range_margin(t: &Ratio, [low, high]: [f64; 2], doubt: f64, within: bool) -> f64 {
    let away = |end: f64| if end.is_infinite() { f64::INFINITY } else { t.error_of(end).abs() };
    let distance =
        if within { away(low).min(away(high)) } else { away(if t.cmp_float(low).is_lt() { low } else { high }) };
    // The answer is compared with the range after rounding to f32.
    distance / (doubt + ulp32(t.to_f64()) / 2.0)
}

/// A quick test in f64 that ray and triangle miss each other by more than `units` of doubt. `corners` are positions and
/// doubts.
pub fn clearly_missed(ray: &ExactRay, corners: [(DVec3, DVec3); 3], units: f64) -> bool {
    let (o, d) = (ray.ray.origin, ray.ray.dir.as_dvec3());
    let q = corners.map(|(p, _)| p - o);
    let doubts = volumes_in_doubt(ray, q, corners.map(|(_, doubt)| doubt));
    // A generous bound on the rounding error in f64: 2^-48 of the input numbers.
    let size = corners.iter().fold(o.abs().max_element(), |m, (p, _)| m.max(p.abs().max_element()));
    let reach = q.iter().fold(0.0, |m: f64, q| m.max(q.abs().max_element()));
    let rounding = size * reach * d.abs().max_element() * 3.6e-15 * 6.0;
    let volumes = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| d.dot(q[i].cross(q[j])));
    let certain = [0, 1, 2].map(|k| {
        let v = volumes[k];
        (v.abs() > units * doubts[k] + rounding).then_some(v > 0.0)
    });
    certain.contains(&Some(true)) && certain.contains(&Some(false))
}
