//! The shear of the watertight test ([`super::triangle`]), which maps the ray to an axis; and the error bounds of this test in f32.
//!
//! **Corners.** A corner relative to the ray is off by at most [`deviation`], sheared or not. Let `m` be the largest coordinate of
//! a vertex plus that of the origin, and `u` an [`ULP`].
//!
//! - Interpolation puts a vertex off by 3u of itself, and the rounding of the origin by u of the origin: together at most 3um.
//!   Their difference is at most m and is rounded by um: 4um. Leaf blocks add the motion to that difference instead, with the same
//!   roundings of the same sizes.
//! - Slopes are at most 1 and off by 2u. So the product of a slope with a depth is off by (4 + 2)um and rounded by um: 7um.
//! - The sheared coordinate is at most 2m and is rounded by 2um: 13um in all.
//! - Vertices that are kept in f64 are in leaf blocks as the nearest f32 numbers. That puts a corner off by um, between keys too,
//!   and a sheared coordinate by 2um: 15um. [`DEVIATION_ULPS`] is one more, which covers roundings of roundings.
//!
//! **Corners near the origin.** These roundings are of numbers that become small near the origin, so rays that begin on a surface
//! have tighter bounds ([`Deviation`]). Let `o` be the largest coordinate of the origin, `r` that of a corner relative to it, and
//! `s` that of the vertex at the keys around the ray's time.
//!
//! - The rounding of the origin puts a corner off by uo. The nearer key minus the origin is at most r + s and is rounded by u of
//!   that; the motion from there is half of the difference of two keys at most, so us for the rounding of this difference and us
//!   for that of the product; their sum is rounded by ur. Together this is u(o + 2r + 3s), and u(o + r) without motion.
//! - The slope and its product add 3ur to the error of the depth, and the sheared coordinate is rounded by 2ur: u(2o + 9r + 6s) in
//!   all.
//! - Without motion a corner is off by u(o + r) only, and the sheared coordinate by u(2o + 7r). Vertices that are kept in f64 add
//!   2u of the vertex, which is 2us in motion and at most 2u(o + r) without: u(2o + 9r + 8s) and u(4o + 9r).
//! - Moving the origin to the scene puts it off by at most a tenth of the slack that it adds, and the sheared coordinate by twice
//!   that. A fifth of a ray's slack is more than that and 2uo together.
//! - A ray that hits the triangle meets its plane between the corners: sheared coordinates are at most twice the triangle's extent,
//!   and depths differ by at most the extent. So r is at most three times the extent plus the depth of the first corner, which is
//!   at most twice its distance. (This also holds for a triangle that f32 shows to be hit, up to the error itself.)
//!
//! A corner's distance is off by half of this bound: u(o + 2r + 3s) for its depth, u of the vertex if it is kept in f64, and 2ur
//! for the reciprocal and the product. Roundings of roundings are covered since the code counts 4uo, 10ur and 8us.
//!
//! Fused products, here and below, have fewer roundings. No product overflows: in tree space vertices are within about 1 of zero,
//! and origins that are not moved to the scene are within 2^32.
//!
//! **Edge functions.** An edge function is `c x b`. Let `B` and `C` be the sums of both coordinates of the two corners. The errors
//! of the corners put it off by `deviation (B + C + 2 deviation)`. The roundings of its two products and of their difference put it
//! off by 2u of the products. A coordinate is at most 2m, so that is at most `1/4 deviation B`; and near the origin, where it is at
//! most 2r, less than `2/9 deviation (B + C)`, since the products are less than `2r B` as well as `2r C`. Together this is less
//! than [`edge_margin`].

use super::tree_ray::{Direction, TreeRay, is_in_range};
use crate::geometry::{KERNEL_ULPS, ULP};
use crate::simd::Simd;
use glam::Vec3;

/// The data of a ray for the triangle test: the shear that maps it to an axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sheared {
    /// The axes of [`Sheared::axes`], two bits each.
    axes: u32,
    /// The slopes of the ray along `kx` and `ky`.
    pub sx: f32,
    pub sy: f32,
    /// The component along `kz` of the scaled direction, in whose multiples distances in tree space are measured, and its
    /// reciprocal.
    pub dz: f32,
    pub inverse: f32,
}

impl Sheared {
    /// The shear of a ray.
    #[inline(always)]
    pub fn new(ray: &TreeRay) -> Sheared {
        let (mut of, regular) = Sheared::of(ray);
        if !regular {
            of.recompute(ray);
        }
        of
    }

    /// The shear of a ray, and whether its direction is regular. If not, the caller calls [`Sheared::recompute`] before use. That
    /// function works in place, for the reason given at [`TreeRay::of`].
    #[inline(always)]
    pub fn of(ray: &TreeRay) -> (Sheared, bool) {
        let dir: &[f32; 3] = ray.original.dir.as_ref();
        let size = |axis: usize| dir[axis].to_bits() & 0x7fff_ffff;
        let (x, y, z) = (size(0), size(1), size(2));
        let not_x = (y > x) | (z > x);
        let kz = usize::from(not_x) * (1 + usize::from(z > y));
        // `kx` and `ky` follow `kz` cyclically.
        let axes = 0b10_01_00_01_00_10_00_10_01u32 >> (6 * kz) & 0b11_11_11;
        let [kx, ky, kz] = unpacked(axes);
        let dz = dir[kz];
        let field = dz.to_bits() >> 23 & 0xff;
        // Products with powers of two are exact, and the reciprocal is known already.
        let shrink = f32::from_bits(254u32.wrapping_sub(field) << 23);
        let inverses: &[f32; 3] = ray.slabs.inverse.as_ref();
        let inverse = inverses[kz];
        let (sx, sy) = (dir[kx] * shrink * inverse, dir[ky] * shrink * inverse);
        (Sheared { axes, sx, sy, dz: dz * shrink, inverse }, is_in_range(field))
    }

    /// Recomputes the shear for a direction that is so long or so short that its slopes are not exact enough.
    #[cold]
    #[inline(never)]
    pub fn recompute(&mut self, ray: &TreeRay) {
        let direction = Direction::of(ray.original.dir);
        let [dx, dy, dz] = self.axes().map(|axis| direction.dir[axis]);
        let inverse = 1.0 / dz;
        (self.sx, self.sy) = (dx * inverse, dy * inverse);
        (self.dz, self.inverse) = (dz * direction.shrink(), inverse * direction.grow());
    }

    /// `kx`, `ky` and `kz`. `kz` is the axis of the direction's largest component.
    #[inline(always)]
    pub fn axes(&self) -> [usize; 3] {
        unpacked(self.axes)
    }

    /// A corner relative to the ray: sheared x and y, and the depth along `kz`, which is not sheared.
    #[inline(always)]
    pub fn corner(&self, v: Vec3, origin: [f32; 4]) -> [f32; 3] {
        let a = v - Vec3::new(origin[0], origin[1], origin[2]);
        // A branch, which has the same outcome for all corners of a ray. Indexing would go through memory.
        let (x, y, z) = match self.axes()[2] {
            0 => (a.y, a.z, a.x),
            1 => (a.z, a.x, a.y),
            _ => (a.x, a.y, a.z),
        };
        [x - self.sx * z, y - self.sy * z, z]
    }

    /// Whether the ray may pass through the triangle of three sheared corners; `slack` is the ray's. `size` is at least the largest
    /// coordinate of the vertices between which the corners were interpolated, since that is what their rounding is relative to: in
    /// motion through zero the corners are far smaller. It is 0 for corners that do not move.
    #[inline(always)]
    pub fn may_hit([a, b, c]: [[f32; 3]; 3], size: f32, slack: f32) -> bool {
        let signs = [c[0] * b[1] - c[1] * b[0], a[0] * c[1] - a[1] * c[0], b[0] * a[1] - b[1] * a[0]];
        // Each number is compared separately: minimum and maximum of numbers that may be NaN take several times as long.
        let some_beyond = |margin: f32| {
            let below = (signs[0] < -margin) | (signs[1] < -margin) | (signs[2] < -margin);
            let above = (signs[0] > margin) | (signs[1] > margin) | (signs[2] > margin);
            below & above
        };
        if !some_beyond(0.0) {
            return true;
        }
        // Without the test for NaN that `f32::max` has.
        let max = |a: f32, b: f32| if a > b { a } else { b };
        let beside = |p: [f32; 3]| max(p[0].abs(), p[1].abs());
        let aside = max(max(beside(a), beside(b)), beside(c));
        let ahead = max(max(a[2].abs(), b[2].abs()), c[2].abs());
        // No coordinate of a corner is larger than `aside + ahead` plus the origin.
        !some_beyond(edge_margin(4.0 * aside, deviation(max(aside + ahead, size), 2.0 * slack)))
    }
}

/// Three axes of two bits each.
#[inline(always)]
fn unpacked(axes: u32) -> [usize; 3] {
    [axes as usize & 3, axes as usize >> 2 & 3, axes as usize >> 4 & 3]
}

/// The error of corners in f32, in ULP of a vertex plus the origin.
const DEVIATION_ULPS: f32 = 16.0;

/// The error bound, per axis, of corners in f32 relative to a ray, if no coordinate of a vertex is larger than `size`. A ray's
/// slack is [`KERNEL_ULPS`] of its origin plus ten times the error of moving the origin to the scene.
#[inline(always)]
pub(crate) fn deviation(size: f32, slack: f32) -> f32 {
    DEVIATION_ULPS * ULP * size + DEVIATION_ULPS / KERNEL_ULPS * slack
}

/// The error bound, per axis, of the corners of a triangle in f32 relative to a ray: `near`, plus `far` times the magnitude of the
/// first corner's distance in tree space. For triangles near the origin it is far less than [`deviation`].
#[derive(Clone, Copy)]
pub(crate) struct Deviation {
    pub near: f32,
    pub far: f32,
}

impl Deviation {
    /// For triangles of at most this extent along an axis, whose vertices have no coordinate larger than `moving` at the keys; 0 if
    /// they do not move.
    #[inline(always)]
    pub fn of<S: Simd>(s: S, extent: f32, moving: f32, slack: f32) -> Deviation {
        let near = s.mul_add_one(8.0 * ULP, moving, s.mul_add_one(30.0 * ULP, extent, 0.2 * slack));
        Deviation { near, far: 20.0 * ULP }
    }
}

/// How far an edge function in f32 may have the wrong sign for a triangle that is hit. `aside` is the sum of the sheared
/// coordinates of both corners. (The added constant is more than the error of denormal products.)
#[inline(always)]
pub(crate) fn edge_margin(aside: f32, deviation: f32) -> f32 {
    1.25 * deviation * (aside + 2.0 * deviation) + f32::MIN_POSITIVE
}
