//! The ray of a query in tree space.

use super::hit::SetHit;
use super::slabs::Slabs;
use crate::geometry::{Frame, KERNEL_ULPS, Ray, ULP};
use glam::{DVec3, Vec3, Vec3A};

/// A ray in tree space: origin rebased and led to the scene, direction scaled by a power of two so that its largest
/// component lies in [1, 2), and `t` scaled to match.
///
/// Here is what nodes need, and what must be known before anything else. What triangles need besides is made of it when a
/// ray comes to the first ([`Sheared`](super::shear::Sheared)): many rays never do.
pub(crate) struct TreeRay<'a> {
    /// The ray as nodes want it. Components of the direction smaller than [`LEAST_COMPONENT`] count as that.
    pub slabs: Slabs,
    /// Where it begins; the fourth entry makes any two-bit index valid.
    pub origin: [f32; 4],
    /// The range of answers as distances from the origin in tree space, rounded outward where that is inexact.
    pub begin: f32,
    pub end: f32,
    /// How much boxes must be larger than they are, per axis: [`KERNEL_ULPS`] of the origin's largest coordinate, or
    /// somewhat more.
    pub slack: f32,
    /// How far the origin was led along the ray, in tree space.
    pub advance: f64,
    /// The origin as it was asked, in tree space and f64.
    pub from: [f64; 4],
    /// Tree `t` per world `t`, a power of two.
    t_per_world: f64,
    /// The ray as it was asked. Not a copy: that would wait for the caller's last store to it.
    pub original: &'a Ray,
}

/// Farther origins than this (in scene sizes) see nothing: their rays would be off by more than about 2^-20 of the scene.
const FARTHEST: f64 = 4294967296.0;

/// Origins up to here (in scene sizes) are not led to the scene: boxes grow by [`KERNEL_ULPS`] of as much, some 2e-5 of the
/// scene, which costs less than leading.
const NEAR: f32 = 16.0;

/// Smaller components of a direction are taken as this where it is divided by: over the way to a hit the ray
/// then strays by less than an ULP of it.
pub(crate) const LEAST_COMPONENT: f32 = ULP;

/// Slack whatever the origin is, 2^-100: more than products of denormal numbers lose, and more than twice what half a denormal `t`
/// is at [`MOST_T_PER_WORLD`].
const LEAST_SLACK: f32 = 1.0 / (1u128 << 100) as f32;

/// Where a unit of `t` is longer than this in tree space, 2^48, hits far behind the origin have a `t` that is rounded to zero, and so
/// they are hits of a ray that begins at its origin.
const MOST_T_PER_WORLD: f64 = (1u64 << 48) as f64;

/// Half an ULP of `t` above a distance and half an ULP below another are this part of it, with as much again to spare.
const T_ROUNDING: f64 = 1.0 / 4194304.0;

/// The same for a `t` that is denormal, in units of the direction.
const T_DENORMAL: f64 = 1.0 / ((1u128 << 126) as f64 * 4194304.0);

/// Exponent fields of a longest component with which reciprocals and slopes neither overflow nor lose bits, whatever
/// the other components are.
const EXPONENT_RANGE: core::ops::RangeInclusive<u32> = 64..=190;

impl<'a> TreeRay<'a> {
    /// The ray in tree space, or nothing where it means nothing (see [`Ray`]).
    #[inline(always)]
    pub fn new(ray: &'a Ray, frame: &Frame) -> Option<TreeRay<'a>> {
        let (mut of, regular) = TreeRay::of(ray, frame);
        if !regular {
            of.recompute(frame);
        }
        if of.sees_nothing() { None } else { Some(of) }
    }

    /// Whether no distance is within the ray's range: it means nothing, or has nothing before it.
    #[inline(always)]
    pub fn sees_nothing(&self) -> bool {
        self.begin > self.end
    }

    /// The ray in tree space, and whether it is of the usual kind; any other is to be mended ([`TreeRay::recompute`]) first.
    ///
    /// Every query begins with this, and nothing of a query can begin before it is done. So the usual ray is told by one
    /// branch, after which nothing depends on what differs from ray to ray; the direction is looked at as integers, which
    /// are compared in one cycle and need no trip through memory to be chosen from; and its reciprocals do not
    /// wait for its scaling. All others are left to a function of their own, since a call among this code would push
    /// what is in registers out of them, whether it is made or not. That function mends the caller's variable in place: a
    /// ray that is handed on is copied, by wide loads that wait for the narrow stores before them.
    #[inline(always)]
    pub fn of(ray: &'a Ray, frame: &Frame) -> (TreeRay<'a>, bool) {
        let from = frame.fine_point(ray.origin);
        let origin = from.as_vec3();
        let field = longest(ray.dir) >> 23;
        let away = Vec3A::from(origin).abs();
        // Bits order like numbers, after all numbers come infinity and NaN, and after these what has a sign.
        let (begin, end) = (ray.t_min.to_bits(), ray.t_max.to_bits());
        let regular = is_in_range(field)
            & away.cmple(Vec3A::splat(NEAR * frame.reach)).all()
            & (begin <= end)
            & (end <= f32::INFINITY.to_bits())
            & (ray.time.to_bits() <= 1f32.to_bits());
        let dir = Direction { dir: ray.dir, field, more: 0 };
        let of = TreeRay::scaled(ray, from, origin, slack(away.max_element()), frame.scale, dir);
        let regular = regular & (of.t_per_world <= MOST_T_PER_WORLD);
        (of, regular)
    }

    /// Makes a ray of any kind what it should be. One that means nothing sees nothing.
    #[cold]
    #[inline(never)]
    pub fn recompute(&mut self, frame: &Frame) {
        match TreeRay::general(self.original, frame) {
            Some(of) => *self = of,
            None => (self.begin, self.end) = (1.0, 0.0),
        }
    }

    /// A ray with more slack than what rounding takes, in tree space.
    pub fn with_slack(ray: &'a Ray, frame: &Frame, more: f32) -> Option<TreeRay<'a>> {
        let mut of = TreeRay::new(ray, frame)?;
        of.slack += more;
        of.slabs = of.slabs_with(of.slack, of.slabs.behind());
        Some(of)
    }

    /// A ray of any kind; nothing where it means nothing.
    fn general(ray: &'a Ray, frame: &Frame) -> Option<TreeRay<'a>> {
        let reach = f64::from(frame.reach);
        let from = frame.fine_point(ray.origin);
        let longest = longest(ray.dir);
        // NaN fails every one of these comparisons.
        let fine = (longest.wrapping_sub(1) < f32::MAX.to_bits())
            & from.abs().cmple(DVec3::splat(FARTHEST * reach)).all()
            & (ray.t_min <= ray.t_max)
            & (0.0 <= ray.time)
            & (ray.time <= 1.0);
        if !fine {
            return None;
        }
        let dir = Direction::of(ray.dir);
        // Minus zero is below zero as well, and so is what is rounded to zero.
        let line = ray.t_min.is_sign_negative() | (dir.t_per_world(frame.scale) > MOST_T_PER_WORLD);
        let away = from.abs().max_element();
        let (mut origin, mut advance, mut lost) = (from, 0.0, 0.0);
        if away > f64::from(NEAR) * reach {
            let step = dir.dir.as_dvec3() * power_of_two(127 - dir.field as i32);
            advance = way_to_scene(from, step, 1.001 * reach, line)?;
            origin = from + step * advance;
            // The origin in f64 was rounded three times, and so is what the caller's own primitives compute with it.
            lost = (16.0 * f64::EPSILON * away) as f32;
        }
        let origin = origin.as_vec3();
        let slack = slack(origin.abs().max_element()) + lost;
        let mut of = TreeRay::scaled(ray, from, origin, slack, frame.scale, dir);
        of.advance = advance;
        // A step outward for the rounding of `t`, and one for that of the distance.
        let distance = |t: f32| (f64::from(t) * of.t_per_world - advance) as f32;
        let (begin, end) = (distance(ray.t_min.next_down()), distance(ray.t_max.next_up()));
        (of.begin, of.end) = (begin.next_down(), end.next_up());
        let mut behind = 0.0;
        if !line {
            of.begin = of.begin.max(0.0);
        } else if of.begin < 0.0 {
            // Nothing is hit farther back than this, and rounding a sum with it is an ULP of as much.
            let back = 2.0 * (frame.reach + origin.abs().max_element());
            of.slack += 8.0 * ULP * back;
            of.begin = of.begin.max(-back);
            behind = -of.begin;
        }
        of.slabs = of.slabs_with(of.slack, behind);
        Some(of)
    }

    /// The ray as nodes want it, with some slack, if it begins so far behind its origin.
    pub(super) fn slabs_with(&self, slack: f32, behind: f32) -> Slabs {
        let [x, y, z, _] = self.origin;
        Slabs::new(
            (Vec3A::new(x, y, z), self.original.dir, self.slabs.inverse),
            slack,
            (self.begin, behind),
            self.slabs.time(),
        )
    }

    #[inline(always)]
    fn scaled(ray: &'a Ray, from: DVec3, origin: Vec3, slack: f32, scale: f64, of: Direction) -> TreeRay<'a> {
        let dir = of.dir;
        let d = Vec3A::from(dir);
        let inverse = ((Vec3A::ONE / d).abs() * of.grow()).min(Vec3A::splat(1.0 / LEAST_COMPONENT)).copysign(d);
        let t_per_world = of.t_per_world(scale);
        let inward = |t: f32| (f64::from(t) * t_per_world) as f32;
        let (begin, end) = (inward(ray.t_min), inward(ray.t_max));
        let o = Vec3A::from(origin);
        TreeRay {
            slabs: Slabs::new((o, dir, inverse), slack, (begin, 0.0), ray.time),
            origin: o.extend(0.0).to_array(),
            begin,
            end,
            slack,
            advance: 0.0,
            from: [from.x, from.y, from.z, 0.0],
            t_per_world,
            original: ray,
        }
    }

    /// A distance in tree space up to which whatever is beyond the begin is within the range, but for two ULP of either. Minus infinity
    /// where there is none: for rays that were led to the scene, of whose `t` a step may be longer than the scene, and for lines that begin
    /// where `t` is not finite.
    #[inline(always)]
    pub fn certain_end(&self) -> f32 {
        let finite = ((f64::from(f32::MAX) * self.t_per_world) as f32).next_down();
        let denormal = |t: f32| t.abs() < f32::MIN_POSITIVE;
        let (begin, end) = (self.original.t_min, self.original.t_max);
        let coarse = self.begin < 0.0 && denormal(begin) || denormal(end);
        if self.advance != 0.0 || self.begin < -finite || coarse {
            return f32::NEG_INFINITY;
        }
        self.end.min(finite)
    }

    /// When it looks.
    #[inline(always)]
    pub fn time(&self) -> f32 {
        self.slabs.time()
    }

    /// The least `t` of an answer. None is infinite, in front of the origin or behind it.
    #[inline(always)]
    pub fn t_min(&self) -> f32 {
        self.original.t_min.max(f32::MIN)
    }

    /// The greatest `t` of an answer, likewise.
    #[inline(always)]
    pub fn t_max(&self) -> f32 {
        self.original.t_max.min(f32::MAX)
    }

    /// The answer's `t` at a distance in tree space from the origin as it was asked: rounded once. (Zero is added last, so
    /// that there is no -0.)
    #[inline(always)]
    pub fn answer_at(&self, distance: f64) -> f32 {
        (distance * inverse_of_power(self.t_per_world)) as f32 + 0.0
    }

    /// A distance in tree space beyond which no answer is as near as the one at this distance from the origin as it was asked.
    ///
    /// Both are rounded to f32 (2^-24 of themselves, or half the least denormal) and may then be equal; the sum here leaves room for
    /// twice as much. It does not wait for the `t` of the answer, since the next box of the traversal waits for it. Only
    /// rays that were led to the scene wait: the distance of their origin is rounded as well.
    #[inline(always)]
    pub fn reach_at(&self, distance: f64, t: f32) -> f32 {
        if self.advance != 0.0 {
            return self.reach(t);
        }
        (distance + (distance.abs() * T_ROUNDING + T_DENORMAL * self.t_per_world)) as f32
    }

    /// A distance in tree space beyond which no answer is as near as `t`, up to the rounding of a distance, for which
    /// there is slack.
    #[inline(always)]
    pub fn reach(&self, t: f32) -> f32 {
        (f64::from(t.next_up()) * self.t_per_world - self.advance) as f32
    }

    /// What a primitive of the caller's answers, if that is within the range.
    #[inline(always)]
    pub fn hit(&self, t: f32, u: f32, v: f32) -> Option<SetHit> {
        // In this form NaN is no hit.
        (self.t_min() <= t && t <= self.t_max()).then(|| SetHit { t: t + 0.0, reach: self.reach(t), u, v })
    }
}

/// [`KERNEL_ULPS`] of an origin whose largest coordinate this is.
#[inline(always)]
fn slack(away: f32) -> f32 {
    KERNEL_ULPS * ULP * away + LEAST_SLACK
}

/// How far along a ray the cube of this half size about zero begins, or a little less; nothing where the ray misses it,
/// or, unless it is a `line`, has it behind.
///
/// The product of a direction in f32 and the result, which has 29 bits, is exact in f64. What the reciprocals are off by is far
/// less than the half size is larger than the scene.
fn way_to_scene(origin: DVec3, dir: DVec3, half: f64, line: bool) -> Option<f64> {
    // Along an axis without direction these are infinite, of like signs outside and of different signs inside.
    let inverse = DVec3::ONE / dir;
    let (a, b) = ((-half - origin) * inverse, (half - origin) * inverse);
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    let met = near <= far && (line || far >= 0.0);
    met.then(|| f64::from_bits(near.to_bits() & !0xff_ffff))
}

/// A direction to be scaled: the exponent field of its longest component, and the power of two by which it
/// was shrunk before.
pub(super) struct Direction {
    pub dir: Vec3,
    field: u32,
    more: i32,
}

impl Direction {
    /// Of a direction of any length but zero.
    #[inline(always)]
    pub fn of(dir: Vec3) -> Direction {
        let field = longest(dir) >> 23;
        if is_in_range(field) { Direction { dir, field, more: 0 } } else { Direction::rescaled(dir) }
    }

    #[cold]
    #[inline(never)]
    fn rescaled(dir: Vec3) -> Direction {
        let more = (f64::from(f32::from_bits(longest(dir))).to_bits() >> 52) as i32 - 1023;
        Direction { dir: (dir.as_dvec3() * power_of_two(-more)).as_vec3(), field: 127, more }
    }

    /// Tree `t` per world `t` in a tree space of this scale.
    #[inline(always)]
    fn t_per_world(&self, scale: f64) -> f64 {
        scale * power_of_two(self.field as i32 - 127 + self.more)
    }

    /// 2^exponent of the longest component.
    #[inline(always)]
    pub fn grow(&self) -> f32 {
        f32::from_bits(self.field << 23)
    }

    /// What scales it so that its longest component is in [1, 2): a power of two.
    #[inline(always)]
    pub fn shrink(&self) -> f32 {
        f32::from_bits(254u32.wrapping_sub(self.field) << 23)
    }
}

/// Whether reciprocals and slopes of a direction neither overflow nor lose bits, by the exponent field of its longest component.
#[inline(always)]
pub(super) fn is_in_range(field: u32) -> bool {
    EXPONENT_RANGE.contains(&field)
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
    f64::from_bits((2046u64 << 52).wrapping_sub(x.to_bits()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ray::shear::Sheared;
    use glam::DVec3;

    #[test]
    fn scaling_a_ray_is_exact() {
        let frame = Frame { origin: DVec3::new(1.0, 2.0, 3.0), scale: 0.25, ..Frame::WORLD };
        for length in [1e-42f32, 1e-30, 0.3, 1.0, 7.0, 1e38] {
            let ray = Ray::new(DVec3::new(5.0, 2.0, 3.0), Vec3::new(0.1, -1.0, 0.25) * length).between(0.5, 2.0);
            let tree = TreeRay::new(&ray, &frame).unwrap();
            assert_eq!(tree.origin, [1.0, 0.0, 0.0, 0.0]);
            let dz = Sheared::new(&tree).dz;
            assert!((1.0..2.0).contains(&dz.abs()), "{dz}");
            assert_eq!(tree.answer_at(0.5 * tree.t_per_world), 0.5, "there and back at length {length}");
        }
    }

    #[test]
    fn rays_that_mean_nothing_are_refused() {
        let frame = Frame::WORLD;
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
