//! The watertight ray-triangle test (Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection",
//! JCGT 2013), finished in f64.
//!
//! The ray is sheared onto an axis, the corners are translated and sheared with it in f32, and three
//! edge functions of the sheared corners say on which sides the ray passes. Two triangles that share an
//! edge compute the same sheared corners for it, so if the *sign* of an edge function is exact, the
//! ray cannot slip between them. In f64 the products of two f32 are exact and their difference is
//! rounded once, which keeps the sign; so the test below is watertight.
//!
//! The lanes of the wide layout first look at the signs in f32 ([`Sheared`](super::shear::Sheared)): two rounded products and a
//! rounded difference never have the wrong sign, only sometimes a zero that should not be one. Lanes with
//! agreeing signs or a zero go on to the f64 test, which alone decides, so every layout gives the
//! same answers bit for bit.
//!
//! The sheared f32 triangle differs from the true one by the rounding of translation and shear, by some ULP of
//! `|corner| + |origin|` ([`KERNEL_ULPS`](crate::geometry::KERNEL_ULPS)): far more than a nearby hit may be off by, where the triangle is
//! large. So that triangle only says *whether* there is a hit. *Where* it is, is computed from the true corners and the
//! true origin in f64 ([`TreeRay::place`]).
//!
//! Traversals that grow boxes by more than `KERNEL_ULPS` never cull an accepted hit, not even of a triangle cut into
//! parts, since the ray passes within it of the place of the hit, which is a point of the triangle:
//!
//! * where the ray passes through the true triangle, that is where it does;
//! * otherwise there are two points of the triangle to choose from. One has the weights of the sheared triangle. There the ray passes
//!   through zero, and all corners are within `KERNEL_ULPS` of the sheared ones, hence so is the same mean of them. The other
//!   is taken only where it is nearer to the ray.
//!
//! All this holds for any coordinates within 2^102 of zero. Products of f32 may overflow or become denormal there: rounding
//! is monotone, so a difference of rounded products still never has the wrong sign, and infinity less infinity is
//! NaN, which is no sign. In f64 a product of two is at least 2^-298 and of three at most 2^306: nothing is lost.

use super::hit::SetHit;
use super::tree_ray::TreeRay;
use glam::DVec3;

impl TreeRay {
    /// Decides whether the ray passes through the triangle of three sheared corners within its range and up to `limit`,
    /// and where; `fine` are its corners in f64, in tree space.
    ///
    /// Triangles without area as seen by the ray are not hit.
    #[inline(always)]
    pub fn decide(&self, corners: [[f32; 3]; 3], limit: f32, fine: impl FnOnce() -> [DVec3; 3]) -> Option<SetHit> {
        // Each conversion by itself: mapped arrays become calls.
        let [a, b, c] = corners;
        let (ax, ay) = (f64::from(a[0]), f64::from(a[1]));
        let (bx, by) = (f64::from(b[0]), f64::from(b[1]));
        let (cx, cy) = (f64::from(c[0]), f64::from(c[1]));
        let u = cx * by - cy * bx;
        let v = ax * cy - ay * cx;
        let w = bx * ay - by * ax;
        let outside = ((u < 0.0) | (v < 0.0) | (w < 0.0)) & ((u > 0.0) | (v > 0.0) | (w > 0.0));
        let det = u + v + w;
        if outside | (det == 0.0) {
            return None;
        }
        let Place { distance, u, v } = self.place(fine(), [u, v, w]);
        let t = self.answer_at(distance);
        // NaN is no hit in this form.
        (self.t_min <= t && t <= limit).then(|| SetHit { t, reach: self.reach_at(distance, t), u, v })
    }

    /// Where the ray meets a triangle of these corners that it hits; `rough` are the edge functions that say so.
    #[inline(always)]
    fn place(&self, [a, b, c]: [DVec3; 3], rough: [f64; 3]) -> Place {
        // Each by itself: mapped arrays become calls.
        let (a, b, c) = (self.fine_sheared(a), self.fine_sheared(b), self.fine_sheared(c));
        let u = c.x * b.y - c.y * b.x;
        let v = a.x * c.y - a.y * c.x;
        let w = b.x * a.y - b.y * a.x;
        let outside = ((u < 0.0) | (v < 0.0) | (w < 0.0)) & ((u > 0.0) | (v > 0.0) | (w > 0.0));
        let det = u + v + w;
        if outside | (det == 0.0) {
            return self.place_beside([a, b, c], [u, v, w], rough);
        }
        let depth = u * a.z + v * b.z + w * c.z;
        Place { distance: self.fine_distance(depth, det), u: (v / det) as f32, v: (w / det) as f32 }
    }

    /// The same where the ray passes beside the triangle in f64.
    #[cold]
    #[inline(never)]
    fn place_beside(&self, corners: [DVec3; 3], fine: [f64; 3], rough: [f64; 3]) -> Place {
        let mean = |weights: [f64; 3]| {
            let [a, b, c] = corners;
            a * weights[0] + b * weights[1] + c * weights[2]
        };
        let sum = |weights: [f64; 3]| weights[0] + weights[1] + weights[2];
        let sign = sum(fine).signum();
        let clamped = fine.map(|e| (e * sign).max(0.0));
        // From the ray, up to a factor that both have.
        let beside = |weights: [f64; 3]| (mean(weights) / sum(weights)).truncate().abs().max_element();
        // NaN, where all is clamped, is not less.
        let weights = if beside(clamped) < beside(rough) { clamped } else { rough };
        let det = sum(weights);
        Place {
            distance: self.fine_distance(mean(weights).z, det),
            u: (weights[1] / det) as f32,
            v: (weights[2] / det) as f32,
        }
    }

    /// A corner relative to the ray: sheared x and y, both times the direction's longest component, and the unsheared depth.
    #[inline(always)]
    fn fine_sheared(&self, corner: DVec3) -> DVec3 {
        let (p, d) = (corner - self.from, self.world.dir.as_dvec3());
        // A branch that always goes the same way for one ray, where an index would go through memory.
        let (x, y, z, dx, dy, dz) = match self.shear.kz {
            0 => (p.y, p.z, p.x, d.y, d.z, d.x),
            1 => (p.z, p.x, p.y, d.z, d.x, d.y),
            _ => (p.x, p.y, p.z, d.x, d.y, d.z),
        };
        DVec3::new(x * dz - dx * z, y * dz - dy * z, z)
    }

    /// The distance from the ray's origin in tree space at a depth, given with its weight.
    #[inline(always)]
    fn fine_distance(&self, depth: f64, weight: f64) -> f64 {
        depth / (weight * f64::from(self.shear.dz)) - self.advance
    }
}

/// Where a ray meets a triangle: a distance from the ray's origin in tree space, and the weights of the second and third
/// corner.
struct Place {
    distance: f64,
    u: f32,
    v: f32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Frame;
    use crate::ray::Ray;
    use crate::ray::intersect::intersect_triangle;
    use glam::Vec3;

    fn intersect(ray: &TreeRay, corners: [Vec3; 3]) -> Option<SetHit> {
        intersect_triangle(ray, corners, || corners.map(Vec3::as_dvec3))
    }

    fn tree_ray(origin: Vec3, dir: Vec3) -> TreeRay {
        TreeRay::new(&Ray::new(origin, dir), &Frame::WORLD).unwrap()
    }

    #[test]
    fn distance_and_barycentrics() {
        let corners = [Vec3::new(0.0, 0.0, 0.5), Vec3::new(1.0, 0.0, 0.5), Vec3::new(0.0, 1.0, 0.5)];
        for dir in [Vec3::Z, Vec3::new(0.0, -0.0, 1.5)] {
            let hit = intersect(&tree_ray(Vec3::new(0.25, 0.5, -0.5), dir), corners).unwrap();
            assert_eq!((hit.u, hit.v), (0.25, 0.5));
            assert_eq!(hit.t * dir.z, 1.0);
        }
        let behind = tree_ray(Vec3::new(0.25, 0.5, 0.75), Vec3::Z);
        assert_eq!(intersect(&behind, corners), None);
    }

    #[test]
    fn a_ray_at_a_shared_edge_or_corner_hits_one_of_its_triangles() {
        let mut state = 5u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f32 / (1 << 23) as f32 - 1.0
        };
        for i in 0..200_000 {
            // A fan of four triangles around `hub`, seen from far away; all rays end at the hub or a spoke.
            let hub = Vec3::new(next(), next(), 0.1 * next()) * 0.1;
            let rim = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
                .map(|(x, y)| Vec3::new(x * (0.4 + 0.2 * next()), y * (0.4 + 0.2 * next()), 0.1 * next()));
            let origin = Vec3::new(next(), next(), 4.0 + next());
            let target = if i % 2 == 0 { hub } else { hub + (rim[i % 4] - hub) * 0.5 * (1.0 + next()).min(0.95) };
            let ray = tree_ray(origin, target - origin);
            let hits = (0..4).filter(|&k| intersect(&ray, [hub, rim[k], rim[(k + 1) % 4]]).is_some()).count();
            assert!(hits >= 1, "leak at {origin} -> {target}");
        }
    }

    #[test]
    fn triangles_without_area_are_not_hit() {
        let ray = tree_ray(Vec3::new(0.0, 0.0, -1.0), Vec3::Z);
        for corners in [[Vec3::ZERO; 3], [Vec3::NEG_X, Vec3::X, Vec3::X], [Vec3::NEG_X, Vec3::ZERO, Vec3::X]] {
            assert_eq!(intersect(&ray, corners), None);
        }
    }

    #[test]
    fn edges_are_told_exactly_however_near_the_ray_passes() {
        // The ray is the axis, corners are integers: products of 24 bits, whose differences i64 holds.
        let mut state = 9u64;
        let mut next = |bits: u32| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as i64 % (1 << bits)
        };
        let ray = tree_ray(Vec3::ZERO, Vec3::Z);
        let (mut near, mut inside) = (0, 0);
        for _ in 0..100_000 {
            // Two corners on opposite sides of the axis and nearly in a line with it, the third aside.
            let (x, y) = (next(22) + 1, next(22) - (1 << 21));
            let b = [x, y];
            let c = [-x + next(3) - 4, -y + next(3) - 4];
            let a = [-y / 2, x / 2];
            let cross = |p: [i64; 2], q: [i64; 2]| p[0] * q[1] - p[1] * q[0];
            let exact = [cross(c, b), cross(a, c), cross(b, a)];
            let sum: i64 = exact.iter().sum();
            let outside = exact.iter().any(|&e| e < 0) && exact.iter().any(|&e| e > 0);
            let corners = [a, b, c].map(|[x, y]| [x as f32, y as f32, 1.0]);
            let hit = ray.decide(corners, f32::INFINITY, || corners.map(|p| DVec3::from(p.map(f64::from)))).is_some();
            assert_eq!(hit, !outside && sum != 0, "{corners:?}");
            // An edge function within 1e-6 of zero, relative to the sum, and on the wrong side.
            near += u32::from(outside && exact.iter().any(|&e| e != 0 && (e as f64).abs() < 1e-6 * (sum as f64).abs()));
            inside += u32::from(hit);
        }
        assert!(near > 1000 && inside > 1000, "{near} {inside}");
    }
}
