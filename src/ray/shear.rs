//! The shear of the watertight test ([`super::triangle`]): a ray becomes an axis, and corners move along; and by how much that
//! is off in f32.
//!
//! Corners relative to the ray are off by at most [`deviation`], sheared or not. Let `m` be the largest coordinate of a vertex plus that of the
//! origin, and `u` an [`ULP`]. Interpolation puts a vertex off by 3u of itself and rounding the origin by u of that, together at most 3um;
//! their difference, at most m, is rounded by um: 4um. (Leaf blocks add the motion to that difference instead: the same roundings of the same
//! sizes. Fused products, here and below, are rounded less often; none overflows, since vertices are within about 1 of zero in tree space and
//! origins, unless they are led to the scene, within 2^32.) Slopes, at most 1, are off by 2u, so their product with a depth is off by
//! 4 + 2 um and rounded by um: 7um. The sheared coordinate, at most 2m, is rounded by 2um: 13um in all. [`DEVIATION_ULPS`] is one more, for
//! what roundings of roundings add.
//!
//! An edge function is `c x b`. If `B` and `C` are the sums of both coordinates of these corners, then the corners put it off by
//! `deviation (B + C + 2 deviation)`, and the rounding of its two products and their difference by 2u of the products; since a coordinate is at most
//! 2m, that is less than `2/7 deviation B`. Together this is less than [`edge_margin`].

use super::tree_ray::{Direction, TreeRay, is_in_range};
use crate::geometry::{KERNEL_ULPS, ULP};
use glam::Vec3;

/// A ray as triangles are tested against it: the shear that turns it into an axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sheared {
    /// See [`Sheared::axes`], two bits each.
    axes: u32,
    /// Slopes of the ray along `kx` and `ky`.
    pub sx: f32,
    pub sy: f32,
    /// Component along `kz` of the direction of which distances in tree space are multiples, and its reciprocal.
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

    /// The shear of a ray, and whether its direction is of the usual kind; any other is to be mended ([`Sheared::recompute`]) first, in place,
    /// as a ray is.
    #[inline(always)]
    pub fn of(ray: &TreeRay) -> (Sheared, bool) {
        let dir: &[f32; 3] = ray.original.dir.as_ref();
        let size = |axis: usize| dir[axis].to_bits() & 0x7fff_ffff;
        let (x, y, z) = (size(0), size(1), size(2));
        let not_x = (y > x) | (z > x);
        let kz = usize::from(not_x) * (1 + usize::from(z > y));
        // `kx` and `ky` follow it cyclically.
        let axes = 0b10_01_00_01_00_10_00_10_01u32 >> (6 * kz) & 0b11_11_11;
        let [kx, ky, kz] = unpacked(axes);
        let dz = dir[kz];
        let field = dz.to_bits() >> 23 & 0xff;
        // Products with powers of two are exact, and the reciprocal is there already.
        let shrink = f32::from_bits(254u32.wrapping_sub(field) << 23);
        let inverses: &[f32; 3] = ray.slabs.inverse.as_ref();
        let inverse = inverses[kz];
        let (sx, sy) = (dir[kx] * shrink * inverse, dir[ky] * shrink * inverse);
        (Sheared { axes, sx, sy, dz: dz * shrink, inverse }, is_in_range(field))
    }

    /// Makes the shear what it should be for a direction so long or short that its slopes are not exact enough.
    #[cold]
    #[inline(never)]
    pub fn recompute(&mut self, ray: &TreeRay) {
        let direction = Direction::of(ray.original.dir);
        let [dx, dy, dz] = self.axes().map(|axis| direction.dir[axis]);
        let inverse = 1.0 / dz;
        (self.sx, self.sy) = (dx * inverse, dy * inverse);
        (self.dz, self.inverse) = (dz * direction.shrink(), inverse * direction.grow());
    }

    /// `kx`, `ky` and `kz`: the last is the ray's longest axis.
    #[inline(always)]
    pub fn axes(&self) -> [usize; 3] {
        unpacked(self.axes)
    }

    /// A corner relative to the ray: sheared x and y, and the unsheared depth along `kz`.
    #[inline(always)]
    pub fn corner(&self, v: Vec3, origin: [f32; 4]) -> [f32; 3] {
        let a = v - Vec3::new(origin[0], origin[1], origin[2]);
        // A branch that always goes the same way for one ray, where an index would go through memory.
        let (x, y, z) = match self.axes()[2] {
            0 => (a.y, a.z, a.x),
            1 => (a.z, a.x, a.y),
            _ => (a.x, a.y, a.z),
        };
        [x - self.sx * z, y - self.sy * z, z]
    }

    /// Whether the ray may pass through the triangle of three sheared corners; `slack` is the ray's.
    #[inline(always)]
    pub fn may_hit([a, b, c]: [[f32; 3]; 3], slack: f32) -> bool {
        let signs = [c[0] * b[1] - c[1] * b[0], a[0] * c[1] - a[1] * c[0], b[0] * a[1] - b[1] * a[0]];
        // Each compared by itself: the least and the greatest of numbers that may be NaN take several times as long.
        let some_beyond = |margin: f32| {
            let below = (signs[0] < -margin) | (signs[1] < -margin) | (signs[2] < -margin);
            let above = (signs[0] > margin) | (signs[1] > margin) | (signs[2] > margin);
            below & above
        };
        if !some_beyond(0.0) {
            return true;
        }
        // Of numbers; `f32::max` would look for NaN.
        let max = |a: f32, b: f32| if a > b { a } else { b };
        let beside = |p: [f32; 3]| max(p[0].abs(), p[1].abs());
        let aside = max(max(beside(a), beside(b)), beside(c));
        let ahead = max(max(a[2].abs(), b[2].abs()), c[2].abs());
        // A vertex is no farther from zero than this and the origin.
        !some_beyond(edge_margin(4.0 * aside, deviation(aside + ahead, 2.0 * slack)))
    }
}

/// Three axes of two bits each.
#[inline(always)]
fn unpacked(axes: u32) -> [usize; 3] {
    [axes as usize & 3, axes as usize >> 2 & 3, axes as usize >> 4 & 3]
}

/// ULP of a vertex plus the origin by which corners in f32 are off.
const DEVIATION_ULPS: f32 = 14.0;

/// By how much corners in f32 relative to a ray are off, per axis, where no coordinate of a vertex is larger than `size`. A ray's slack is
/// [`KERNEL_ULPS`] of its origin, and ten times what the origin may have strayed when it was moved.
#[inline(always)]
pub(crate) fn deviation(size: f32, slack: f32) -> f32 {
    DEVIATION_ULPS * ULP * size + DEVIATION_ULPS / KERNEL_ULPS * slack
}

/// How far on the wrong side an edge function in f32 may be of a triangle that is hit; `aside` is what the sheared coordinates of both
/// of its corners add up to. (Products that are denormal err by less than what is added.)
#[inline(always)]
pub(crate) fn edge_margin(aside: f32, deviation: f32) -> f32 {
    1.25 * deviation * (aside + 2.0 * deviation) + f32::MIN_POSITIVE
}
