//! The watertight ray-triangle test (Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection",
//! JCGT 2013), in f64.
//!
//! The ray is sheared onto an axis, the corners are translated and sheared with it, and three edge functions of the
//! sheared corners tell on which side of each edge the ray passes. Two triangles that share an edge compute the same
//! sheared corners for it, so if the *sign* of an edge function is exact, the ray cannot slip between them. All of this
//! is done in f64, with the origin and the keys of the vertices as given. A rounded difference of rounded products
//! never has the wrong sign, only sometimes a zero that should not be one; zeros are recomputed with 106 bits. So signs
//! are exact, the test is watertight, and nothing is hit outside of the sheared triangle.
//!
//! The weights of the corners are edge functions as well. If the products of one cancel to less than [`CANCELLED`] of them, all
//! three are recomputed with 106 bits: otherwise the rounding of products, 2^-52 of them, might be more than the weights, and a
//! triangle whose corners are nearly in a line could be hit far away from the ray. So weights are off by less than 2^-30 of their
//! sum.
//!
//! The sheared triangle differs from the true one by some 2^-53 of `|corner| + |origin|`. `t` is a weighted mean of the corners'
//! depths, so it belongs to a point of the triangle that the ray passes within that distance and 2^-30 of the triangle's size.
//! Boxes that hold the triangle and are padded by more never cull an accepted hit, not even of a triangle split into
//! sub-references: the point is in one of them.
//!
//! Most tested triangles are missed, and f32 is enough to prove it: the lanes of the wide layout
//! (`ray/traversal/candidates.rs`), and [`Sheared::may_hit`] for one triangle, reject triangles beyond margins for the rounding
//! of f32 ([`super::shear`]). The remaining ones are decided here, so every layout gives the same answers bit for bit.
//!
//! Coordinates are within 2^102 of zero in tree space and directions within 2^128, so no product overflows in f64, and
//! products of numbers that are not denormal in f32 keep all their bits.

use super::shear::Sheared;
use super::tree_ray::TreeRay;
use crate::geometry::DoubleDouble;
use crate::ray::hit::SetHit;
use crate::simd::{Mask, Portable, Simd};
use glam::{DVec2, DVec3};

impl TreeRay<'_> {
    /// Decides whether the ray passes through a triangle within its range and up to `limit`, and where. The corners are in
    /// tree space: one vector for each of the axes `kx`, `ky` and `kz`, with one corner in each lane.
    ///
    /// Triangles that are degenerate as seen along the ray are not hit.
    #[inline(always)]
    pub(in crate::ray) fn decide<S: Simd>(
        &self,
        s: S,
        sheared: &Sheared,
        corners: [S::D; 3],
        limit: f32,
    ) -> Option<SetHit> {
        let [x, y, z] = sheared.axes();
        let (ox, oy, oz) = (self.from[x], self.from[y], self.from[z]);
        let dir: &[f32; 3] = self.original.dir.as_ref();
        let (dx, dy, dz) = (f64::from(dir[x]), f64::from(dir[y]), f64::from(dir[z]));
        let z = corners[2] - s.splat_d(oz);
        let x = along(s, corners[0] - s.splat_d(ox), z, dx, dz);
        let y = along(s, corners[1] - s.splat_d(oy), z, dy, dz);
        // Of corners a, b and c the edge functions c x b, a x c and b x a, in lanes.
        let product = s.rotate_right(x) * s.rotate_left(y);
        let mut edges = product - s.rotate_right(y) * s.rotate_left(x);
        let signs = Signs::of(s, edges);
        // Signs are exact but for zeros, which count as both: a miss needs no more bits.
        if signs.are_mixed() {
            return None;
        }
        let magnitude = |x: S::D| s.max_d(x, s.splat_d(0.0) - x);
        // Zeros are among them.
        if s.le_d(magnitude(edges), magnitude(product) * s.splat_d(CANCELLED)) & ALL != 0 {
            edges = s.load_d(&exact_edges(s.lanes_d(x), s.lanes_d(y)));
            let signs = Signs::of(s, edges);
            if (signs.zero() == ALL) | signs.are_mixed() {
                return None;
            }
        }
        let ([u, v, w, _], [za, zb, zc, _]) = (s.lanes_d(edges), s.lanes_d(z));
        let det = u + v + w;
        let distance = (u * za + v * zb + w * zc) / (det * f64::from(sheared.dz));
        let t = self.answer_at(distance);
        // Comparisons in this form reject NaN.
        (self.t_min() <= t && t <= limit).then(|| {
            let (u, v) = ((v / det) as f32, (w / det) as f32);
            SetHit { t, reach: self.reach_at(distance, t), u, v }
        })
    }

    /// The same for one triangle at a time.
    #[inline(always)]
    pub fn decide_one(&self, sheared: &Sheared, [a, b, c]: [DVec3; 3], limit: f32) -> Option<SetHit> {
        let (x, y, z) = ([a.x, b.x, c.x, 0.0], [a.y, b.y, c.y, 0.0], [a.z, b.z, c.z, 0.0]);
        // A branch that is constant for one ray, where an index would go through memory.
        let [x, y, z] = match sheared.axes()[2] {
            0 => [y, z, x],
            1 => [z, x, y],
            _ => [x, y, z],
        };
        self.decide(Portable, sheared, [Portable.load_d(&x), Portable.load_d(&y), Portable.load_d(&z)], limit)
    }
}

/// An edge function that is less than this fraction of its products is recomputed with more bits.
const CANCELLED: f64 = 1.0 / (1 << 20) as f64;

/// Lanes of the three edge functions.
const ALL: Mask = 0b111;

/// Which edge functions are at most zero, and which are at least zero.
#[derive(Clone, Copy)]
struct Signs {
    at_most_zero: Mask,
    at_least_zero: Mask,
}

impl Signs {
    #[inline(always)]
    fn of<S: Simd>(s: S, edges: S::D) -> Signs {
        let zero = s.splat_d(0.0);
        Signs { at_most_zero: s.le_d(edges, zero) & ALL, at_least_zero: s.le_d(zero, edges) & ALL }
    }

    #[inline(always)]
    fn zero(self) -> Mask {
        self.at_most_zero & self.at_least_zero
    }

    /// Whether some edge function is below zero and some other one above it.
    #[inline(always)]
    fn are_mixed(self) -> bool {
        (self.at_least_zero != ALL) & (self.at_most_zero != ALL)
    }
}

/// Sheared coordinates of corners relative to the ray, times the direction's longest component.
#[inline(always)]
fn along<S: Simd>(s: S, x: S::D, z: S::D, dx: f64, dz: f64) -> S::D {
    x * s.splat_d(dz) - s.splat_d(dx) * z
}

/// The three edge functions, with exact signs and zero only where the exact function is; the fourth lane is 0.
#[cold]
#[inline(never)]
fn exact_edges(x: [f64; 4], y: [f64; 4]) -> [f64; 4] {
    // A wall seen along an axis, which the ray lies in.
    let zero = |x: [f64; 4]| x[0] == 0.0 && x[1] == 0.0 && x[2] == 0.0;
    if zero(x) || zero(y) {
        return [0.0; 4];
    }
    let corner = |i: usize| DVec2::new(x[i], y[i]);
    let (a, b, c) = (corner(0), corner(1), corner(2));
    [exact_edge(c, b), exact_edge(a, c), exact_edge(b, a), 0.0]
}

/// An edge function, with an exact sign and zero only where the exact function is.
fn exact_edge(p: DVec2, q: DVec2) -> f64 {
    let product = |a: f64, b: f64| DoubleDouble::from(a) * DoubleDouble::from(b);
    (product(p.x, q.y) - product(p.y, q.x)).to_f64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Frame;
    use crate::random::Random;
    use crate::ray::Ray;
    use crate::ray::traversal::intersect::intersect_triangle;
    use glam::Vec3;

    fn intersect(ray: &Ray, corners: [Vec3; 3]) -> Option<SetHit> {
        let ray = TreeRay::new(ray, &Frame::WORLD).unwrap();
        intersect_triangle(&ray, &Sheared::new(&ray), corners, 0.0, || corners.map(Vec3::as_dvec3))
    }

    #[test]
    fn distance_and_barycentrics() {
        let corners = [Vec3::new(0.0, 0.0, 0.5), Vec3::new(1.0, 0.0, 0.5), Vec3::new(0.0, 1.0, 0.5)];
        for dir in [Vec3::Z, Vec3::new(0.0, -0.0, 1.5)] {
            let hit = intersect(&Ray::new(Vec3::new(0.25, 0.5, -0.5), dir), corners).unwrap();
            assert_eq!((hit.u, hit.v), (0.25, 0.5));
            assert_eq!(hit.t * dir.z, 1.0);
        }
        let behind = Ray::new(Vec3::new(0.25, 0.5, 0.75), Vec3::Z);
        assert_eq!(intersect(&behind, corners), None);
    }

    #[test]
    fn a_ray_at_a_shared_edge_or_corner_hits_one_of_its_triangles() {
        let mut random = Random(5);
        let mut next = || random.signed();
        for i in 0..200_000 {
            // A fan of four triangles around `hub`, seen from far away; every ray ends at the hub or on a spoke.
            let hub = Vec3::new(next(), next(), 0.1 * next()) * 0.1;
            let rim = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
                .map(|(x, y)| Vec3::new(x * (0.4 + 0.2 * next()), y * (0.4 + 0.2 * next()), 0.1 * next()));
            let origin = Vec3::new(next(), next(), 4.0 + next());
            let target = if i % 2 == 0 { hub } else { hub + (rim[i % 4] - hub) * 0.5 * (1.0 + next()).min(0.95) };
            let ray = Ray::new(origin, target - origin);
            let hits = (0..4).filter(|&k| intersect(&ray, [hub, rim[k], rim[(k + 1) % 4]]).is_some()).count();
            assert!(hits >= 1, "leak at {origin} -> {target}");
        }
    }

    #[test]
    fn f32_rules_out_no_hit_and_would_without_its_margin() {
        let mut random = Random(15);
        let mut next = || random.signed();
        let (mut hits, mut without) = (0, 0);
        for i in 0..300_000 {
            let size = 10f32.powi(-(i % 9));
            let mut point = |scale: f32| Vec3::new(next(), next(), next()) * scale;
            let place = point(1.0);
            let corners = [point(size) + place, point(size) + place, point(size) + place];
            let origin = point(3.0) * if i % 2 == 0 { 1.0 } else { size };
            let target = corners[0].lerp(corners[1], if i % 3 == 0 { 0.0 } else { 0.5 + 0.5 * next() });
            let original = Ray::new(origin, target - origin);
            let Some(ray) = TreeRay::new(&original, &Frame::WORLD) else { continue };
            let sheared = Sheared::new(&ray);
            if ray.decide_one(&sheared, corners.map(Vec3::as_dvec3), f32::INFINITY).is_none() {
                continue;
            }
            let [a, b, c] = corners.map(|p| sheared.corner(p, ray.origin));
            assert!(Sheared::may_hit([a, b, c], 0.0, ray.slack), "{corners:?} {original:?}");
            let edges = [c[0] * b[1] - c[1] * b[0], a[0] * c[1] - a[1] * c[0], b[0] * a[1] - b[1] * a[0]];
            hits += 1;
            without += usize::from(edges.iter().any(|&e| e < 0.0) && edges.iter().any(|&e| e > 0.0));
        }
        assert!(hits > 50_000 && without > 1000, "{without} of {hits}");
    }

    #[test]
    fn triangles_nearly_in_a_line_are_hit_where_the_ray_is() {
        let mut random = Random(21);
        let mut next = || f64::from(random.signed());
        let (mut hits, mut far) = (0, 0);
        for i in 0..300_000 {
            // Three points of a line, rounded to f64, and a ray from another point of it or to one.
            let (from, along) = (DVec3::new(next(), next(), next()), DVec3::new(next(), next(), next()));
            let on_line = |by: f64| from + along * by;
            let corners = [on_line(next()), on_line(next()), on_line(next())];
            let (place, other) = (on_line(next()), DVec3::new(next(), next(), next()));
            let original =
                if i % 2 == 0 { Ray::new(place, other.as_vec3()) } else { Ray::new(other, (place - other).as_vec3()) };
            let Some(ray) = TreeRay::new(&original, &Frame::WORLD) else { continue };
            let Some(hit) = ray.decide_one(&Sheared::new(&ray), corners, f32::INFINITY) else { continue };
            let [a, b, c] = corners;
            let point = a + (b - a) * f64::from(hit.u) + (c - a) * f64::from(hit.v);
            let on_ray = original.origin + original.dir.as_dvec3() * f64::from(hit.t);
            hits += 1;
            far += u32::from((point - on_ray).length() > 1e-6 * (1.0 + on_ray.length()));
        }
        assert!(hits > 100 && far == 0, "{far} of {hits}");
    }

    #[test]
    fn triangles_without_area_are_not_hit() {
        let ray = Ray::new(Vec3::new(0.0, 0.0, -1.0), Vec3::Z);
        for corners in [[Vec3::ZERO; 3], [Vec3::NEG_X, Vec3::X, Vec3::X], [Vec3::NEG_X, Vec3::ZERO, Vec3::X]] {
            assert_eq!(intersect(&ray, corners), None);
        }
    }

    #[test]
    fn edges_are_told_exactly_however_near_the_ray_passes() {
        // The ray is the axis and corners are integers: products of 24 bits, whose differences fit i64.
        let mut random = Random(9);
        let mut next = |bits: u32| (random.bits() >> 33) as i64 % (1 << bits);
        let original = Ray::new(Vec3::ZERO, Vec3::Z);
        let ray = TreeRay::new(&original, &Frame::WORLD).unwrap();
        let sheared = Sheared::new(&ray);
        let (mut near, mut inside) = (0, 0);
        for _ in 0..100_000 {
            // Two corners on opposite sides of the axis and nearly in a line with it, the third off that line.
            let (x, y) = (next(22) + 1, next(22) - (1 << 21));
            let b = [x, y];
            let c = [-x + next(3) - 4, -y + next(3) - 4];
            let a = [-y / 2, x / 2];
            let cross = |p: [i64; 2], q: [i64; 2]| p[0] * q[1] - p[1] * q[0];
            let exact = [cross(c, b), cross(a, c), cross(b, a)];
            let sum: i64 = exact.iter().sum();
            let outside = exact.iter().any(|&e| e < 0) && exact.iter().any(|&e| e > 0);
            let corners = [a, b, c].map(|[x, y]| [x as f32, y as f32, 1.0]);
            let hit = ray.decide_one(&sheared, corners.map(|p| DVec3::from(p.map(f64::from))), f32::INFINITY).is_some();
            assert_eq!(hit, !outside && sum != 0, "{corners:?}");
            // An edge function within 1e-6 of zero, relative to the sum, and on the wrong side.
            near += u32::from(outside && exact.iter().any(|&e| e != 0 && (e as f64).abs() < 1e-6 * (sum as f64).abs()));
            inside += u32::from(hit);
        }
        assert!(near > 1000 && inside > 1000, "{near} {inside}");
    }
}
