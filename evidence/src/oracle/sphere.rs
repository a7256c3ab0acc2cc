//! Ray against moving sphere: the roots of a quadratic with exact coefficients.
//!
//! Whether there are roots is the sign of an exact discriminant. A root is an algebraic number, enclosed between two
//! quotients that differ by far less than any float resolves.

use super::triangle::range_margin;
use super::{Dyadic, ExactRay, HALF_ULP_F64, Ratio, Vector, fraction};
use mbkd::MovingSphere;
use mbkd::glam::DVec3;

/// How a ray and a sphere meet.
#[derive(Clone, Debug)]
pub struct SphereHit {
    /// Whether the ray meets the sphere, tangents not counted, with `t` in its range.
    pub hit: bool,
    /// How certain that is, in units of the condition.
    pub margin: f64,
    /// Two bounds of the exact distance, closer to each other than 2^-200 relative.
    pub t: Option<[Ratio; 2]>,
    /// How far `t` moves when all input has an error of half an ulp.
    pub t_doubt: f64,
}

/// Leading bits of a square root.
const BITS: usize = 400;

/// The hit of a ray on a sphere.
pub fn meet_sphere(ray: &ExactRay, sphere: &MovingSphere) -> SphereHit {
    let nothing = |margin| SphereHit { hit: false, margin, t: None, t_doubt: f64::INFINITY };
    let keys = &sphere.keys;
    if keys.is_empty() {
        return nothing(f64::INFINITY);
    }
    let (segment, s) = fraction(ray.ray.time, keys.len());
    let (a, b) = (keys[segment], keys[(segment + 1).min(keys.len() - 1)]);
    let (p, q) = (Vector::new(a.0), Vector::new(b.0));
    let center = &p + &(&q - &p).times(&s);
    let (ra, rb) = (Dyadic::new(a.1).abs(), Dyadic::new(b.1).abs());
    let radius = &ra + &(&(&rb - &ra) * &s);
    // A t² - 2 B t + C = 0
    let to_center = &center - ray.origin();
    let (aa, bb) = (ray.dir().length_squared(), ray.dir().dot(&to_center));
    let cc = &to_center.length_squared() - &radius.squared();
    let discriminant = &bb.squared() - &(&aa * &cc);
    let w = s.to_f64();
    let half = HALF_ULP_F64;
    let moved = |a: f64, b: f64| {
        let displacement = (b - a).abs() * (keys.len().max(2) - 1) as f64 * f64::from(ray.ray.time);
        (a.abs() * (1.0 - w) + b.abs() * w) * half + displacement * half
    };
    let radius_doubt = moved(a.1.abs(), b.1.abs());
    let doubt_at = |t: f64| {
        let center = DVec3::new(moved(a.0.x, b.0.x), moved(a.0.y, b.0.y), moved(a.0.z, b.0.z));
        ray.doubt_at(t) + center
    };
    // The distance of the ray's line from the sphere's surface, relative to its doubt.
    let middle = Ratio::new(bb.clone(), aa.clone()).map_or(0.0, |m| m.to_f64());
    let pass_doubt = doubt_at(middle).length() + radius_doubt;
    let size = radius.to_f64();
    // sqrt(D) / A = half the chord in t; D / A = radius² - (distance of the line)².
    let depth = Ratio::new(discriminant.clone(), aa.clone()).map_or(0.0, |m| m.to_f64());
    let line = depth.abs() / (2.0 * size.max(depth.abs().sqrt()) * pass_doubt).max(f64::MIN_POSITIVE);
    if discriminant.sign() <= 0 {
        return nothing(line);
    }
    let (below, above) = discriminant.sqrt_between(BITS);
    let ratio = |upper: Dyadic| Ratio::new(upper, aa.clone()).expect("a direction of some length");
    let near = [ratio(&bb - &above), ratio(&bb - &below)];
    let far = [ratio(&bb + &below), ratio(&bb + &above)];
    let mut margin = line;
    for t in [near, far] {
        let about = t[0].to_f64();
        let within = ray.within(&t[0]);
        // Normal . direction at the hit is half the chord.
        let slope = discriminant.to_f64().sqrt() / size;
        let out = &(ray.origin() + &ray.dir().times(&Dyadic::new(about))) - &center;
        let normal = out.to_dvec3() / size;
        let t_doubt = (normal.abs().dot(doubt_at(about)) + radius_doubt) / slope.max(f64::MIN_POSITIVE);
        margin = margin.min(range_margin(&t[0], ray.range(), t_doubt, within));
        if within {
            return SphereHit { hit: true, margin, t: Some(t), t_doubt };
        }
    }
    nothing(margin)
}
