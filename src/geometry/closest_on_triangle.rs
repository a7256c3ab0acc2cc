//! The closest point on a triangle to a given point.

use glam::DVec3;

/// A point of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OnTriangle {
    pub point: DVec3,
    /// Barycentric weights of the second and third corner.
    pub u: f64,
    pub v: f64,
    pub distance_squared: f64,
}

/// The closest point on a triangle, in f64.
///
/// The regions are those of Ericson, *Real-Time Collision Detection*, section 5.1.5: the nearest point lies on an edge
/// (or at a corner, its end), or it is the foot of the perpendicular if that is inside. Ericson finds the region first, by
/// signs of differences that cancel in thin triangles, and a wrong region gives a wrong point. Here the nearest
/// point of each edge is always computed, and so is the foot, and the nearest of these is taken. Degenerate triangles
/// need no special case: they are their edges.
///
/// Every candidate is a point of the triangle up to the rounding of f64, and the distance is that of the candidate itself, so
/// the distance is never too small. It is too large by less than 2e-8 of the longest edge: with edges below `l` and the
/// height `h` above the longest, the error of the foot from the cross products is less than `8 e l² / h`, where `e` = 2^-53, and
/// if that is more than `h` the longest edge is nearer; the worst case is that both are equal, `h² = 8 e l²`.
///
/// The point is clamped to the box of the corners, so that a box that holds the corners holds it exactly, which queries
/// rely on; this moves it by at most one f64 rounding.
#[inline(always)]
pub(crate) fn closest_on_triangle(q: DVec3, [a, b, c]: [DVec3; 3]) -> OnTriangle {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let candidate = |point: DVec3, u: f64, v: f64| {
        let point = point.clamp(low, high);
        OnTriangle { point, u, v, distance_squared: (point - q).length_squared() }
    };
    let (point, t) = closest_on_segment(q, a, b);
    let mut best = candidate(point, t, 0.0);
    let mut improve = |other: OnTriangle| {
        if other.distance_squared < best.distance_squared {
            best = other;
        }
    };
    let (point, t) = closest_on_segment(q, b, c);
    improve(candidate(point, 1.0 - t, t));
    let (point, t) = closest_on_segment(q, a, c);
    improve(candidate(point, 0.0, t));
    let (ab, ac, aq) = (b - a, c - a, q - a);
    let n = ab.cross(ac);
    let area = n.length_squared();
    let (u, v) = (aq.cross(ac).dot(n), ab.cross(aq).dot(n));
    if area > 0.0 && u >= 0.0 && v >= 0.0 && u + v <= area {
        let (u, v) = (u / area, v / area);
        improve(candidate(a + ab * u + ac * v, u, v));
    }
    best
}

/// The nearest point between `a` and `b`, and how far along it is.
#[inline(always)]
fn closest_on_segment(q: DVec3, a: DVec3, b: DVec3) -> (DVec3, f64) {
    let ab = b - a;
    let (along, length) = ((q - a).dot(ab), ab.length_squared());
    let t = along / length;
    let between = a + ab * t;
    // Selections without branches, which would often be mispredicted. Also right if both numbers are 0.
    let (at_a, at_b) = ((along <= 0.0) | (length == 0.0), along >= length);
    let of = |a: f64, b: f64, between: f64| {
        let other = if at_b { b } else { between };
        if at_a { a } else { other }
    };
    let point = DVec3::new(of(a.x, b.x, between.x), of(a.y, b.y, between.y), of(a.z, b.z, between.z));
    (point, of(0.0, 1.0, t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Box3;
    use crate::random::Random;
    use glam::Vec3;

    /// A vector of whole numbers, for exact arithmetic.
    type Whole = [i128; 3];

    fn minus(a: Whole, b: Whole) -> Whole {
        [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
    }

    fn dot(a: Whole, b: Whole) -> i128 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn cross(a: Whole, b: Whole) -> Whole {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    }

    /// The squared distance to a triangle of whole numbers, exact but for the last division.
    fn exact(q: Whole, [a, b, c]: [Whole; 3]) -> f64 {
        let segment = |a: Whole, b: Whole| {
            let (ab, aq) = (minus(b, a), minus(q, a));
            let (along, length) = (dot(aq, ab), dot(ab, ab));
            if along <= 0 {
                dot(aq, aq) as f64
            } else if along >= length {
                dot(minus(q, b), minus(q, b)) as f64
            } else {
                (dot(aq, aq) * length - along * along) as f64 / length as f64
            }
        };
        let edges = segment(a, b).min(segment(b, c)).min(segment(a, c));
        let (ab, ac, aq) = (minus(b, a), minus(c, a), minus(q, a));
        let n = cross(ab, ac);
        let (area, u, v) = (dot(n, n), dot(cross(aq, ac), n), dot(cross(ab, aq), n));
        if area > 0 && u >= 0 && v >= 0 && u + v <= area {
            let height = dot(aq, n);
            edges.min(height as f64 * height as f64 / area as f64)
        } else {
            edges
        }
    }

    #[test]
    fn distances_are_those_of_exact_arithmetic() {
        let mut random = Random(9);
        let mut next = |reach: i128| i128::from(random.bits() >> 33) % (2 * reach + 1) - reach;
        let (mut inside, mut thin) = (0, 0);
        for round in 0..200_000 {
            // Small triangles, many of them flat or coincident, large ones, and slivers: a corner next to an edge.
            let reach = [2, 50, 1 << 20][round % 3];
            let mut point = || [next(reach), next(reach), next(reach)];
            let (a, b, mut c, q) = (point(), point(), point(), point());
            if round % 2 == 0 {
                c = core::array::from_fn(|i| (a[i] + b[i]) / 2 + next(1));
                thin += 1;
            }
            let corners = [a, b, c].map(|p: Whole| Vec3::from(p.map(|x| x as f32)));
            let near = if round % 4 < 2 { q } else { core::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3 + next(1)) };
            let found = closest_on_triangle(DVec3::from(near.map(|x| x as f64)), corners.map(Vec3::as_dvec3));
            let expected = exact(near, [a, b, c]).sqrt();
            let size = corners.into_iter().fold(Box3::EMPTY, Box3::include);
            let allowed = 2e-8 * f64::from((size.max - size.min).length()) + 1e-12 * expected;
            assert!((found.distance_squared.sqrt() - expected).abs() <= allowed, "{near:?} {corners:?} {found:?}");
            let [a, b, c] = corners.map(|p| p.as_dvec3());
            let of_weights = a + (b - a) * found.u + (c - a) * found.v;
            assert!(
                (of_weights - found.point).length() <= 1e-12 * (1.0 + f64::from(size.max.abs().max_element())) * 1e3
            );
            assert!(found.u >= 0.0 && found.v >= 0.0 && found.u + found.v <= 1.0 + 1e-12);
            inside += usize::from(found.u > 0.0 && found.v > 0.0 && found.u + found.v < 1.0);
        }
        assert!(inside > 10_000 && thin > 10_000, "{inside} {thin}");
    }

    #[test]
    fn triangles_without_area_are_points_and_segments() {
        let q = DVec3::new(3.0, 4.0, 0.0);
        let point = closest_on_triangle(q, [DVec3::ZERO; 3]);
        assert_eq!((point.point, point.distance_squared), (DVec3::ZERO, 25.0));
        for corners in [[DVec3::ZERO, DVec3::X * 9.0, DVec3::X], [DVec3::X, DVec3::ZERO, DVec3::X * 9.0]] {
            assert_eq!(closest_on_triangle(q, corners).point, DVec3::X * 3.0);
        }
    }
}
