//! The ray of a query in tree space.

use super::Hit;
use super::hit::SetHit;
use super::triangle::{Sheared, hit_slack};
use crate::geometry::{Frame, Ray, ULP};
use glam::{Vec3, Vec3A};

/// A ray in tree space: origin rebased, direction scaled by a power of two so that its largest
/// component lies in [1, 2), and `t` scaled to match. All scalings are exact.
pub(crate) struct TreeRay {
    pub origin: Vec3,
    pub dir: Vec3,
    /// One over each component of the direction, where components smaller than [`LEAST_COMPONENT`] count as that.
    pub inverse: Vec3A,
    pub t_min: f32,
    pub t_max: f32,
    pub time: f32,
    /// The direction as the triangle test wants it.
    pub shear: Sheared,
    /// [`hit_slack`] of the ray, or somewhat more.
    pub slack: f32,
    /// How far behind its origin the ray begins; 0 for one that begins before it.
    pub behind: f32,
    /// World `t` per tree `t`, a power of two.
    t_scale: f64,
    /// The ray as it was asked.
    pub world: Ray,
}

/// Farther origins than this (in scene sizes) see nothing: f32 could no longer tell where they look.
const FARTHEST: f32 = 4294967296.0;

/// Origins up to here have the slack of this distance, instead of one of their own.
const NEAR: f32 = 3.0;

/// Smaller components of a direction are taken as this where it is divided by: over any distance within reach the
/// ray then strays by less than a thousandth of the slack.
pub(crate) const LEAST_COMPONENT: f32 = 1e-12;

/// Exponent fields of a longest component with which reciprocals and slopes neither overflow nor lose bits, whatever
/// the other components are.
const MODERATE: core::ops::RangeInclusive<u32> = 64..=190;

impl TreeRay {
    /// The ray in tree space, or nothing where it means nothing (see [`Ray`]).
    ///
    /// Every query begins with this, and nothing of a query can begin before it is done. So the usual ray is told by one
    /// branch, after which nothing depends on what differs from ray to ray; the direction is looked at as integers, which
    /// are compared in one cycle and need no trip through memory to be chosen from; and its reciprocals do not
    /// wait for its scaling. All others are left to a function of their own, since a call among this code would push
    /// what is in registers out of them, whether it is made or not.
    #[inline(always)]
    pub fn new(ray: &Ray, frame: &Frame) -> Option<TreeRay> {
        let origin = frame.point(ray.origin);
        let field = longest(ray.dir) >> 23;
        // Bits order like numbers, after all numbers come infinity and NaN, and after these what has a sign.
        let (begin, end) = (ray.t_min.to_bits(), ray.t_max.to_bits());
        let usual = MODERATE.contains(&field)
            & Vec3A::from(origin).abs().cmple(Vec3A::splat(NEAR)).all()
            & (begin <= end)
            & (end <= f32::INFINITY.to_bits())
            & (ray.time.to_bits() <= 1f32.to_bits());
        if !usual {
            return TreeRay::unusual(ray, frame);
        }
        const SLACK: f32 = 16.0 * ULP * (1.0 + NEAR);
        Some(TreeRay::scaled(ray, origin, frame.scale, Direction { dir: ray.dir, field, more: 0 }, SLACK))
    }

    /// The same for rays of any kind.
    #[cold]
    #[inline(never)]
    fn unusual(ray: &Ray, frame: &Frame) -> Option<TreeRay> {
        let origin = frame.point(ray.origin);
        let longest = longest(ray.dir);
        // NaN fails every one of these comparisons.
        let fine = (longest.wrapping_sub(1) < f32::MAX.to_bits())
            & Vec3A::from(origin).abs().cmple(Vec3A::splat(FARTHEST)).all()
            & (ray.t_min <= ray.t_max)
            & (0.0 <= ray.time)
            & (ray.time <= 1.0);
        if !fine {
            return None;
        }
        let mut dir = Direction { dir: ray.dir, field: longest >> 23, more: 0 };
        if !MODERATE.contains(&dir.field) {
            let more = (f64::from(f32::from_bits(longest)).to_bits() >> 52) as i32 - 1023;
            dir = Direction { dir: (ray.dir.as_dvec3() * power_of_two(-more)).as_vec3(), field: 127, more };
        }
        let mut of = TreeRay::scaled(ray, origin, frame.scale, dir, hit_slack(origin));
        // Minus zero is below zero as well.
        if of.t_min.is_sign_negative() {
            // Nothing is hit farther back than this, and rounding a sum with it is an ULP of as much.
            let reach = 2.0 * (1.0 + origin.abs().max_element());
            of.slack += 8.0 * ULP * reach;
            of.t_min = of.t_min.max(-reach);
            of.behind = -of.t_min;
        }
        Some(of)
    }

    #[inline(always)]
    fn scaled(ray: &Ray, origin: Vec3, scale: f64, of: Direction, slack: f32) -> TreeRay {
        let Direction { dir, field, more } = of;
        // 2^-exponent of the longest component, and 2^exponent.
        let (shrink, grow) = (f32::from_bits((254 - field) << 23), f32::from_bits(field << 23));
        let d = Vec3A::from(dir);
        let inverse = ((Vec3A::ONE / d).abs() * grow).min(Vec3A::splat(1.0 / LEAST_COMPONENT)).copysign(d);
        let mut shear = Sheared::new(dir);
        shear.dz *= shrink;
        let t_per_world = scale * power_of_two(field as i32 - 127 + more);
        let inward = |t: f32| (f64::from(t) * t_per_world) as f32;
        TreeRay {
            origin,
            dir: dir * shrink,
            inverse,
            t_min: inward(ray.t_min),
            t_max: inward(ray.t_max),
            time: ray.time,
            shear,
            slack,
            behind: 0.0,
            t_scale: inverse_of_power(t_per_world),
            world: *ray,
        }
    }

    /// A world `t` in tree space.
    pub fn tree_t(&self, t: f32) -> f32 {
        (f64::from(t) / self.t_scale) as f32
    }

    /// A tree-space hit as an answer.
    #[inline(always)]
    pub fn answer(&self, hit: SetHit, (mesh, primitive): (u32, u32)) -> Hit {
        Hit { t: (f64::from(hit.t) * self.t_scale) as f32, u: hit.u, v: hit.v, mesh, primitive }
    }
}

/// A direction to be scaled: the exponent field of its longest component, and the power of two by which it
/// was shrunk before.
struct Direction {
    dir: Vec3,
    field: u32,
    more: i32,
}

/// The bits of the longest component of a direction, without the sign: they order like numbers, and after all
/// numbers come infinity and NaN.
#[inline(always)]
fn longest(dir: Vec3) -> u32 {
    magnitude(dir.x).max(magnitude(dir.y)).max(magnitude(dir.z))
}

/// The bits of a number without its sign.
#[inline(always)]
fn magnitude(x: f32) -> u32 {
    x.to_bits() & 0x7fff_ffff
}

/// 2^e for the exponents of f32 and of frames, all normal in f64.
#[inline(always)]
fn power_of_two(e: i32) -> f64 {
    f64::from_bits(((e + 1023) as u64) << 52)
}

/// 1 / x of a normal power of two.
#[inline(always)]
fn inverse_of_power(x: f64) -> f64 {
    f64::from_bits((2046 << 52) - x.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn scaling_a_ray_is_exact() {
        let frame = Frame { origin: DVec3::new(1.0, 2.0, 3.0), scale: 0.25 };
        for length in [1e-42f32, 1e-30, 0.3, 1.0, 7.0, 1e38] {
            let ray = Ray::new(DVec3::new(5.0, 2.0, 3.0), Vec3::new(0.1, -1.0, 0.25) * length).between(0.5, 2.0);
            let tree = TreeRay::new(&ray, &frame).unwrap();
            assert_eq!(tree.origin, Vec3::X);
            let longest = tree.dir.abs().max_element();
            assert!((1.0..2.0).contains(&longest), "{longest}");
            let hit = tree.answer(SetHit { t: tree.t_min, u: 0.0, v: 0.0 }, (0, 0));
            assert_eq!(hit.t, 0.5, "there and back at length {length}");
        }
    }

    #[test]
    fn rays_that_mean_nothing_are_refused() {
        let frame = Frame { origin: DVec3::ZERO, scale: 1.0 };
        let good = Ray::new(Vec3::ZERO, Vec3::X);
        assert!(TreeRay::new(&good, &frame).is_some());
        let bad = [
            Ray { dir: Vec3::ZERO, ..good },
            Ray { dir: Vec3::new(0.0, f32::NAN, 1.0), ..good },
            Ray { dir: Vec3::new(f32::INFINITY, 0.0, 0.0), ..good },
            Ray { origin: DVec3::new(f64::NAN, 0.0, 0.0), ..good },
            Ray { origin: DVec3::new(0.0, 1e300, 0.0), ..good },
            Ray { t_min: 2.0, t_max: 1.0, ..good },
            Ray { t_max: f32::NAN, ..good },
            good.at_time(-0.1),
            good.at_time(1.1),
            good.at_time(f32::NAN),
        ];
        for ray in bad {
            assert!(TreeRay::new(&ray, &frame).is_none(), "{ray:?}");
        }
    }
}
