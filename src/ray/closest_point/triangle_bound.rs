//! Lower bounds of the distances from a point to sixteen triangles, in f32.
//!
//! The picture: a plane between the point and a triangle proves a distance. If no corner of a triangle is nearer than `r` along a
//! direction `g`, no point of the triangle is. So `g` may be any vector at all, and its errors cannot make the bound wrong, only
//! weak. It is chosen towards the closest point of the triangle (for which the bound is the distance itself), found in f32 without
//! any care for slivers: it is the foot of the perpendicular if that seems to be inside, and otherwise the nearest of the closest
//! points of the three edges (the regions of Ericson, *Real-Time Collision Detection*, section 5.1.5).
//!
//! **The margin.** Let `u` be an [`ULP`], `q` the query point, `p` the same rounded to f32, `a` a corner, `d` the distance between
//! `q` and the triangle, and `e` the longest edge at `a`. The computed bound is
//! `r = (g . (a - p) + min(0, g . (b - a), g . (c - a))) / |g|`.
//!
//! - `a - p` is off by u |a - p|, each edge by ue, and by as much again where they are stretched. The products with `g` and their
//!   sums add 3u and the last sum u, so the numerator divided by `|g|` is off by u (6 |a - p| + 6e), and by |q - p|.
//! - `|g|` is off by 2.5u of itself, and the quotient by u. As r is at most |a - p|, this is less than 3.6u |a - p|.
//! - `|a - p|` is at most d + e + |q - p|. So d (1 + 10u) is at least r - 16ue - |q - p|, up to roundings of roundings.
//! - `e` is at most the root of three times the largest extent of a triangle, and `|q - p|` at most that many times u times the
//!   largest coordinate of `p`. Extents of triangles that move are off by 6u of the largest coordinate in the block, as the corners
//!   are rounded.
//!
//! What f64 rounds in the distance that decides is far less than what the code adds beyond this. Products may underflow; `|g|` is
//! at least 2^-63 as computed, so this puts `r` off by less than 2^-85. Nothing overflows if no coordinate of `p` is greater than
//! [`FARTHEST`], stretched.
//!
//! Where distances count more along some axes ([`Stretch`]), all of this holds for the stretched space, in which `e` and `|q - p|`
//! are greater by the greatest factor at most. Under a shear, stretched vectors are off by four roundings relative to that factor
//! and to their length before, of which `e` has a share of the margin, and `d` adds to the relative error.

use super::stretch::Stretch;
use crate::geometry::ULP;
use crate::simd::Simd;
use glam::Vec3;

/// From points with a larger coordinate in tree space, there are no bounds: the margin would be larger than the scene.
pub(super) const FARTHEST: f32 = 16777216.0;

/// How much greater than 1 the factor of the distance is: 10u, and the rounding of the difference between `r` and the margin.
const RELATIVE: f64 = 12.0 * ULP as f64;

/// What is added to the margin for underflow.
const UNDERFLOW: f32 = 1e-24;

/// Bounds from a point.
#[derive(Clone, Copy)]
pub(super) struct TriangleBound {
    /// The query point in tree space, rounded.
    from: Vec3,
    /// By how much a bound is too large at most, but for its relative error.
    margin: f32,
    stretch: Stretch,
}

impl TriangleBound {
    /// For the triangles of a block of these sizes ([`block_sizes`](crate::layout::block_sizes)), whose corners in f32 are off by
    /// at most `error`.
    #[inline(always)]
    pub fn new(from: Vec3, (size, extent): (f32, f32), error: f32, stretch: Stretch) -> TriangleBound {
        let extent = extent + 8.0 * ULP * size;
        let margin = ULP * (28.0 * extent + 3.0 * from.abs().max_element()) + UNDERFLOW + error;
        TriangleBound { from, margin: margin * stretch.most(), stretch }
    }

    /// The least number that proves, as a bound of [`TriangleBound::of`], that a distance is above `reach`.
    #[inline(always)]
    pub fn beyond(reach: f64, stretch: &Stretch) -> f32 {
        ((reach * (1.0 + RELATIVE + stretch.rounding())) as f32).next_up()
    }

    /// The bounds for sixteen triangles, given by their corners. Not below zero; zero if nothing is known, as for triangles with
    /// NaN.
    #[inline(always)]
    pub fn of<S: Simd>(&self, s: S, [a, b, c]: [[S::F; 3]; 3]) -> S::F {
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let from = [s.splat(self.from.x), s.splat(self.from.y), s.splat(self.from.z)];
        let [pa, ab, ac] = [
            self.stretch.of(s, minus::<S>(a, from)),
            self.stretch.of(s, minus::<S>(b, a)),
            self.stretch.of(s, minus::<S>(c, a)),
        ];
        // Squared distances, but for that of the first corner, are quadratic in the weights x and y of the other corners:
        // xx * x^2 + 2 xy * x y + yy * y^2 + 2 x1 * x + 2 y1 * y.
        let [xx, xy, yy, x1, y1] = [dot(s, ab, ab), dot(s, ab, ac), dot(s, ac, ac), dot(s, ab, pa), dot(s, ac, pa)];
        // The foot of the perpendicular, by elimination of x.
        let inverse = one / xx;
        let [along, slope] = [zero - x1 * inverse, xy * inverse];
        let yy_left = s.negated_mul_add(xy, slope, yy);
        let y = s.negated_mul_add(slope, x1, y1) / (zero - yy_left);
        let x = s.negated_mul_add(slope, y, along);
        // The closest points of the edges from the first corner, and of the third edge.
        let (x2, y2) = (x1 + x1, y1 + y1);
        let on_ab = s.max(s.min(along, one), zero);
        let on_ac = s.max(s.min((zero - y1) / yy, one), zero);
        let (at_b, fall) = (xx + x2, (xx - xy) + (x1 - y1));
        let length = (xx - xy) + (yy - xy);
        let on_bc = s.max(s.min(fall / length, one), zero);
        let square_ab = on_ab * s.mul_add(xx, on_ab, x2);
        let square_ac = on_ac * s.mul_add(yy, on_ac, y2);
        let square_bc = s.mul_add(on_bc, s.mul_add(length, on_bc, zero - (fall + fall)), at_b);
        let second = s.lt(square_ac, square_ab);
        let third = s.lt(square_bc, s.min(square_ac, square_ab));
        let edge_x = s.select(third, one - on_bc, s.select(second, zero, on_ab));
        let edge_y = s.select(third, on_bc, s.select(second, on_ac, zero));
        // Of a sliver at the first corner, the foot is unreliable, and an edge is about as near.
        let inside = s.le(zero, x) & s.le(zero, y) & s.le(x + y, one) & s.lt(s.splat(SLIVER) * yy, yy_left);
        let (x, y) = (s.select(inside, x, edge_x), s.select(inside, y, edge_y));
        let mut towards = pa;
        for axis in 0..3 {
            towards[axis] = s.mul_add(y, ac[axis], s.mul_add(x, ab[axis], pa[axis]));
        }
        let others = s.min(s.min(dot(s, towards, ab), dot(s, towards, ac)), zero);
        let least = dot(s, towards, pa) + others;
        let length = s.sqrt(dot(s, towards, towards) + s.splat(f32::MIN_POSITIVE));
        // The second operand, zero, if the first is NaN.
        s.max(least / length - s.splat(self.margin), zero)
    }
}

/// The squared sine of the angle below which a triangle is taken for its edges.
const SLIVER: f32 = 1.0 / 65536.0;

#[inline(always)]
fn minus<S: Simd>(a: [S::F; 3], b: [S::F; 3]) -> [S::F; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn dot<S: Simd>(s: S, a: [S::F; 3], b: [S::F; 3]) -> S::F {
    s.mul_add(a[2], b[2], s.mul_add(a[1], b[1], a[0] * b[0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Aabb, KeyTime, Placement, closest_on_triangle};
    use crate::layout::block_sizes;
    use crate::random::Random;
    use crate::simd::{LANES, Lanes, Portable};
    use glam::{DAffine3, DVec3};

    /// Triangles of a block at a time, and the sizes that the block states.
    struct Block {
        corners: Lanes<[Vec3; 3]>,
        sizes: (f32, f32),
    }

    impl Block {
        /// Triangles of a size around a place, every fourth of them a sliver. If they move, that far and each its own way.
        fn random(random: &mut Random, place: Vec3, size: f32, far: f32) -> Block {
            let time = KeyTime::new(random.unit(), 2);
            let (mut most, mut extent) = (0.0f32, 0.0f32);
            let corners = core::array::from_fn(|i| {
                let motion = random.vec() * far;
                let mut near = [0; 3].map(|_| place + random.vec() * size);
                if i % 4 == 0 {
                    near[2] = near[0].lerp(near[1], random.unit()) + random.vec() * size * 1e-5;
                }
                let next = near.map(|p| p + motion + random.vec() * if far > 0.0 { size } else { 0.0 });
                for [a, b, c] in [near, next] {
                    most = most.max(a.abs().max(b.abs()).max(c.abs()).max_element());
                    extent = extent.max((a.max(b).max(c) - a.min(b).min(c)).max_element());
                }
                [0, 1, 2].map(|c| if far > 0.0 { time.position(near[c], next[c]) } else { near[c] })
            });
            let exponent = |x: f32| (x.to_bits() >> 23) + 1;
            Block { corners, sizes: block_sizes(exponent(most) << 24 | exponent(extent) << 16) }
        }

        fn lanes(&self) -> [[<Portable as Simd>::F; 3]; 3] {
            [0, 1, 2].map(|corner| [0, 1, 2].map(|axis| Portable.load(&self.corners.map(|t| t[corner][axis]))))
        }
    }

    /// The stretch of a space that is scaled along its axes, or sheared.
    fn stretch(random: &mut Random, kind: usize) -> Stretch {
        let scale = [DVec3::ONE, DVec3::new(1.0, 3.0, 7.5), DVec3::new(900.0, 1.0, 1.0)][kind % 3];
        let mut matrix = DAffine3::from_scale(scale);
        if kind >= 3 {
            matrix.matrix3.y_axis += matrix.matrix3.x_axis * f64::from(random.signed() * 3.0);
            matrix.matrix3.z_axis += matrix.matrix3.y_axis * f64::from(random.signed());
        }
        Stretch::new(&Placement::new(matrix).preimage(DVec3::ZERO, Aabb { min: DVec3::ZERO, max: DVec3::ZERO })).0
    }

    /// Triangles of many sizes, in motion and at rest, slivers among them, and points at corners, in edges and triangles, near them
    /// and far away.
    #[test]
    fn no_triangle_within_reach_is_ruled_out_and_some_would_be_without_the_margin() {
        let mut random = Random(8);
        let (mut tested, mut lost, mut lost_nearby, mut tight) = (0, 0, 0, 0);
        for i in 0..40_000 {
            let size = 10f32.powi(-(i % 6));
            let place = random.vec();
            let block = Block::random(&mut random, place, size, if i % 4 < 2 { 0.0 } else { 1.0 });
            let [a, b, c] = block.corners[i as usize % LANES];
            let on = a + (b - a) * random.unit() + (c - a) * random.unit() * 0.5;
            let away = random.vec().as_dvec3();
            let q = match i % 5 {
                0 => a.as_dvec3(),
                1 => on.as_dvec3() + away * f64::from(size) * 1e-3,
                2 => on.as_dvec3() + away * f64::from(size),
                3 => away,
                _ => away * 10f64.powi(i / 5 % 8),
            };
            let from = q.as_vec3();
            let stretch = stretch(&mut random, i as usize / 7 % 5);
            let stretched = |p: DVec3| stretch.exactly(p);
            if from.abs().max_element() * stretch.most() >= FARTHEST {
                continue;
            }
            let bound = TriangleBound::new(from, block.sizes, 0.0, stretch);
            let (with, without) = (bound.of(Portable, block.lanes()), TriangleBound { margin: 0.0, ..bound });
            let without = without.of(Portable, block.lanes());
            for lane in 0..LANES {
                let corners = block.corners[lane].map(Vec3::as_dvec3);
                let distance = closest_on_triangle(stretched(q), corners.map(stretched)).distance_squared.sqrt();
                let bound = Portable.lane(with, lane);
                assert!(
                    bound <= TriangleBound::beyond(distance, &stretch),
                    "{q} {corners:?}: {bound} instead of {distance}"
                );
                tested += 1;
                let ruled_out = Portable.lane(without, lane) > distance as f32;
                lost += usize::from(ruled_out);
                lost_nearby += usize::from(ruled_out && distance < f64::from(size));
                tight += usize::from(f64::from(bound) > 0.99 * distance);
            }
        }
        assert!(tested > 500_000 && tight * 10 > tested * 7, "{tight} of {tested} are tight");
        assert!(lost > 20_000 && lost_nearby > 2000, "{lost} {lost_nearby}");
    }

    /// Corners that are off by an error: the distance is at most that much smaller.
    #[test]
    fn an_error_of_the_corners_lowers_bounds() {
        let corners = [Vec3::new(0.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0)];
        let block = Block { corners: [corners; LANES], sizes: (2.0, 2.0) };
        let of = |error: f32| TriangleBound::new(Vec3::new(0.2, 0.2, 0.0), block.sizes, error, Stretch::NONE);
        let least = |error: f32| Portable.lane(of(error).of(Portable, block.lanes()), 0);
        assert!(least(0.0) > 1.0 - 1e-5 && least(0.0) < 1.0);
        assert!(least(0.25) > 0.75 - 1e-5 && least(0.25) < 0.75);
        assert_eq!(least(2.0), 0.0);
    }

    #[test]
    fn triangles_without_area_have_bounds_and_nan_has_none() {
        let (p, far) = (Vec3::X, Vec3::splat(f32::NAN));
        let mut corners = [[p; 3]; LANES];
        corners[1] = [p, p, p * 3.0];
        corners[2] = [p, p * 2.0, p * 3.0];
        corners[3] = [p, far, p];
        corners[4] = [far; 3];
        let block = Block { corners, sizes: (4.0, 4.0) };
        let bounds = TriangleBound::new(Vec3::ZERO, block.sizes, 0.0, Stretch::NONE).of(Portable, block.lanes());
        for lane in [0, 1, 2] {
            let bound = Portable.lane(bounds, lane);
            assert!(bound > 1.0 - 1e-4 && bound < 1.0, "{lane}: {bound}");
        }
        for lane in [3, 4] {
            assert_eq!(Portable.lane(bounds, lane), 0.0);
        }
        let from = DVec3::ZERO;
        assert_eq!(closest_on_triangle(from, corners[1].map(Vec3::as_dvec3)).distance_squared, 1.0);
    }
}
