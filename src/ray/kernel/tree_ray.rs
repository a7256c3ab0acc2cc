//! The ray of a query in tree space.

use super::slabs::Slabs;
use crate::geometry::{Frame, KERNEL_ULPS, Ray, ULP};
use crate::ray::hit::SetHit;
use glam::{DVec3, Vec3, Vec3A};

/// A ray in tree space: the origin is mapped there and moved along the ray to the scene, the direction is scaled by a power of two
/// so that its largest component lies in [1, 2), and `t` is scaled to match.
///
/// This struct holds the data for tests of nodes. The data for tests of triangles ([`Sheared`](super::shear::Sheared)) is derived
/// from it when a ray reaches its first triangle; many rays never do.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TreeRay<'a> {
    /// The data of the slab test. Components of the direction smaller than [`LEAST_COMPONENT`] are replaced by it.
    pub slabs: Slabs,
    /// The origin; the fourth entry makes any two-bit index valid.
    pub origin: [f32; 4],
    /// The range of answers as distances from the origin in tree space, rounded outward if inexact.
    pub begin: f32,
    pub end: f32,
    /// By how much boxes must be enlarged, per axis: [`KERNEL_ULPS`] of the origin's largest coordinate, or somewhat more.
    pub slack: f32,
    /// Whether this is one of several pieces of the ray ([`TreeRay::next_piece`]).
    pub in_pieces: bool,
    /// How far the origin was moved along the ray, in tree space.
    pub advance: f64,
    /// The origin of the original ray, in tree space and f64.
    pub from: [f64; 4],
    /// Distance in tree space per `t`, a power of two.
    t_per_world: f64,
    /// The caller's ray. A reference, since a copy would wait for the caller's last store to it.
    pub original: &'a Ray,
    /// Its index in a task of a batch, for filters; 0 for a single ray.
    pub index: usize,
}

/// Rays with origins farther away than this (in scene sizes) hit nothing: their errors would exceed about 2^-20 of the scene.
const FARTHEST: f64 = 4294967296.0;

/// Origins up to this far away (in scene sizes) are not moved to the scene. Boxes grow by [`KERNEL_ULPS`] of this distance, some
/// 8e-5 of the scene, which costs less than moving the origin. Of rays in the spaces of small instances, most begin that far away.
const NEAR: f32 = 64.0;

/// Smaller components of a direction are replaced by this as divisors. On the way to a hit, this moves the ray by less than an ULP
/// of the distance.
pub(crate) const LEAST_COMPONENT: f32 = ULP;

/// The least slack of any ray, 2^-100. It is more than the error of products of denormal numbers, and more than twice the distance
/// of half a denormal `t` at [`MOST_T_PER_WORLD`].
const LEAST_SLACK: f32 = 1.0 / (1u128 << 100) as f32;

/// If a unit of `t` is longer than this in tree space, 2^48, the `t` of hits far behind the origin is rounded to zero. So they are
/// hits of a ray that begins at its origin.
const MOST_T_PER_WORLD: f64 = (1u64 << 48) as f64;

/// Somewhat less than the greatest `t`.
const GREATEST: f64 = f32::MAX as f64 * (1.0 - 1.0 / 1048576.0);

/// The relative size of half an ULP of `t` above one distance and half an ULP below another, doubled for safety.
const T_ROUNDING: f64 = 1.0 / 4194304.0;

/// The same for a denormal `t`, in units of the direction.
const T_DENORMAL: f64 = 1.0 / ((1u128 << 126) as f64 * 4194304.0);

/// Exponent fields of the longest component of a direction for which reciprocals and slopes neither overflow nor lose bits,
/// whatever the other components are.
const EXPONENT_RANGE: core::ops::RangeInclusive<u32> = 64..=190;

impl<'a> TreeRay<'a> {
    /// The ray in tree space; `None` if the ray is invalid (see [`Ray`]).
    #[inline(always)]
    pub fn new(ray: &'a Ray, frame: &Frame) -> Option<TreeRay<'a>> {
        let (mut of, regular) = TreeRay::of(ray, frame, f32::INFINITY);
        if !regular {
            of.recompute(frame, f32::INFINITY);
        }
        if of.has_empty_range() { None } else { Some(of) }
    }

    /// Whether the ray's range is empty: the ray is invalid, or the scene is not in front of it.
    #[inline(always)]
    pub fn has_empty_range(&self) -> bool {
        self.begin > self.end
    }

    /// The ray in tree space, and whether it is regular. If not, the caller calls [`TreeRay::recompute`] before use. No ray is that
    /// begins farther than `near` from the origin of tree space.
    ///
    /// Every query begins with this function, and the rest of the query waits for it. So it is written for low latency:
    ///
    /// - One branch recognizes regular rays. After it, no branch depends on the ray.
    /// - Components of the direction are compared as integers, which takes one cycle, and the longest is selected without going
    ///   through memory.
    /// - The reciprocals do not wait for the scaling of the direction.
    /// - Irregular rays have a function of their own. A call within this code would spill registers, even if it is not made.
    /// - That function changes the caller's variable in place. Returning a ray would copy it by wide loads, which stall on the
    ///   preceding narrow stores.
    #[inline(always)]
    pub fn of(ray: &'a Ray, frame: &Frame, near: f32) -> (TreeRay<'a>, bool) {
        let from = frame.fine_point(ray.origin);
        let origin = from.as_vec3();
        let field = longest(ray.dir) >> 23;
        let away = Vec3A::from(origin).abs();
        // The bits order like the numbers; infinity and NaN come after all numbers, and negative values after these.
        let (begin, end) = (ray.t_min.to_bits(), ray.t_max.to_bits());
        let regular = is_in_range(field)
            & away.cmple(Vec3A::splat((NEAR * frame.reach).min(near))).all()
            & (begin <= end)
            & (end <= f32::INFINITY.to_bits())
            & (ray.time.to_bits() <= 1f32.to_bits());
        let dir = Direction { dir: ray.dir, field, more: 0 };
        let of = TreeRay::scaled(ray, from, origin, slack(away.max_element()), frame.scale, dir);
        let regular = regular & (of.t_per_world <= MOST_T_PER_WORLD);
        (of, regular)
    }

    /// Recomputes a ray that is not regular. The range of an invalid ray becomes empty. A ray that begins farther than `near` from
    /// the origin of tree space becomes its first piece.
    #[cold]
    #[inline(never)]
    pub fn recompute(&mut self, frame: &Frame, near: f32) {
        match TreeRay::general(self.original, frame) {
            Some(of) => *self = TreeRay { index: self.index, ..of },
            None => (self.begin, self.end) = (1.0, 0.0),
        }
        self.cut(frame, near);
    }

    /// A ray with `more` slack, in tree space, than rounding needs.
    pub fn with_slack(ray: &'a Ray, frame: &Frame, more: f32) -> Option<TreeRay<'a>> {
        let mut of = TreeRay::new(ray, frame)?;
        of.slack += more;
        of.slabs = of.slabs_with(of.slack, of.slabs.behind());
        Some(of)
    }

    /// The ray in tree space, for any ray; `None` if it is invalid.
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
        let away = from.abs().max_element();
        let mut advance = 0.0;
        if away > f64::from(NEAR) * reach {
            let line = ray.t_min.is_sign_negative() | (dir.t_per_world(frame.scale) > MOST_T_PER_WORLD);
            advance = distance_to_scene(from, dir.step(), 1.001 * reach, line)?;
        }
        Some(TreeRay::advanced(ray, frame, (from, dir), advance))
    }

    /// The ray with its origin moved along it, by a distance in tree space of 29 bits.
    pub(super) fn advanced(ray: &'a Ray, frame: &Frame, (from, dir): (DVec3, Direction), advance: f64) -> TreeRay<'a> {
        // A begin of minus zero counts as negative as well, and so does one that is rounded to zero.
        let line = ray.t_min.is_sign_negative() | (dir.t_per_world(frame.scale) > MOST_T_PER_WORLD);
        let (mut origin, mut lost) = (from, 0.0);
        if advance != 0.0 {
            let away = from.abs().max_element();
            origin = from + dir.step() * advance;
            // The origin in f64 was rounded three times, and so are the kernel's computations with the original one, and those of
            // custom primitives. Together this is less than a tenth of what is allowed for.
            lost = (32.0 * f64::EPSILON * away) as f32;
        }
        let origin = origin.as_vec3();
        let slack = slack(origin.abs().max_element()) + lost;
        let mut of = TreeRay::scaled(ray, from, origin, slack, frame.scale, dir);
        of.advance = advance;
        // One float outward for the rounding of `t`, and one for that of the distance.
        let distance = |t: f32| (f64::from(t) * of.t_per_world - advance) as f32;
        let (begin, end) = (distance(ray.t_min.next_down()), distance(ray.t_max.next_up()));
        (of.begin, of.end) = (begin.next_down(), end.next_up());
        let mut behind = 0.0;
        if !line {
            of.begin = of.begin.max(0.0);
        } else if of.begin < 0.0 {
            // Nothing is hit farther behind the origin than `back`, and a sum with it is rounded by an ULP of it.
            let back = 2.0 * (frame.reach + origin.abs().max_element());
            of.slack += 8.0 * ULP * back;
            of.begin = of.begin.max(-back);
            behind = -of.begin;
        }
        of.slabs = of.slabs_with(of.slack, behind);
        of
    }

    /// The data of the slab test with this slack, for a ray that begins `behind` behind its origin.
    pub(in crate::ray) fn slabs_with(&self, slack: f32, behind: f32) -> Slabs {
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
            in_pieces: false,
            advance: 0.0,
            from: [from.x, from.y, from.z, 0.0],
            t_per_world,
            original: ray,
            index: 0,
        }
    }

    /// A distance in tree space up to which everything beyond the begin is within the range, except for two ULP at either end.
    /// Minus infinity if there is none that is simple to compute: for lines that begin behind their origin, for ranges that begin
    /// or end at a denormal `t`, of which the next one may be far away, and for rays whose origin was moved beyond the begin of
    /// their range.
    #[inline(always)]
    pub fn certain_end(&self) -> f32 {
        // Zero is not denormal: one less, its bits are the greatest number.
        let begins = self.original.t_min.to_bits().wrapping_sub(1) >= f32::MIN_POSITIVE.to_bits() - 1;
        let usual = (self.advance == 0.0) & (self.begin >= 0.0) & (self.original.t_max >= f32::MIN_POSITIVE) & begins;
        if usual {
            self.end.min((GREATEST * self.t_per_world) as f32)
        } else if self.advance != 0.0 {
            self.certain_end_of_moved()
        } else {
            f32::NEG_INFINITY
        }
    }

    /// The same for a ray whose origin was moved to the scene. One step of `t` may be longer than the scene, so the range is not
    /// that of distances from the moved origin: a hit counts if its distance `d` from there, as the decision in f64 has it, fulfils
    /// `t_min <= (d + advance) / t_per_world <= t_max` with the quotient rounded to f32.
    ///
    /// **Proof that what is certain is hit.** Both ends are f32, and rounding is monotone, so it suffices that the exact quotient
    /// fulfils this: the division by a power of two is exact, and so are the products here. The decision computes `d + advance`
    /// with some ten roundings of 2^-53 of the origin's largest coordinate, of which the slack has sixty-four; the sums here round
    /// three times.
    /// - The range begins before the moved origin, by more than that, and what is certain does not lie behind that origin.
    /// - The end is moved inward by the slack, and by 2^-22 of itself, four times what the conversion to f32 rounds.
    #[inline(always)]
    fn certain_end_of_moved(&self) -> f32 {
        let slack = f64::from(self.slack);
        let begins = (self.begin >= 0.0) & (f64::from(self.t_min()) * self.t_per_world + slack <= self.advance);
        let end = f64::from(self.t_max()) * self.t_per_world - self.advance - slack;
        if begins { (end - end.abs() * T_ROUNDING) as f32 } else { f32::NEG_INFINITY }
    }

    /// The time of the ray.
    #[inline(always)]
    pub fn time(&self) -> f32 {
        self.slabs.time()
    }

    /// The least `t` of an answer. No answer has an infinite `t`, in front of the origin or behind it.
    #[inline(always)]
    pub fn t_min(&self) -> f32 {
        self.original.t_min.max(f32::MIN)
    }

    /// The greatest `t` of an answer.
    #[inline(always)]
    pub fn t_max(&self) -> f32 {
        self.original.t_max.min(f32::MAX)
    }

    /// The `t` of an answer at a distance in tree space from the original origin, rounded once. (Zero is added last, so that there
    /// is no -0.)
    #[inline(always)]
    pub fn answer_at(&self, distance: f64) -> f32 {
        (distance * inverse_of_power(self.t_per_world)) as f32 + 0.0
    }

    /// A distance in tree space beyond which no answer is as near as the one at `distance` from the original origin.
    ///
    /// Both distances are rounded to f32 (by 2^-24 of themselves, or half the least denormal) and may then be equal; the sum here
    /// allows for twice as much. The next box of the traversal waits for this result, so it does not depend on the `t` of the
    /// answer. Only rays whose origin was moved to the scene use `t`, since the distance of their origin is rounded as well.
    #[inline(always)]
    pub fn reach_at(&self, distance: f64, t: f32) -> f32 {
        if self.advance != 0.0 {
            return self.reach(t);
        }
        (distance + (distance.abs() * T_ROUNDING + T_DENORMAL * self.t_per_world)) as f32
    }

    /// A distance in tree space beyond which no answer is as near as `t`, up to the rounding of a distance, which the slack covers.
    #[inline(always)]
    pub fn reach(&self, t: f32) -> f32 {
        (f64::from(t.next_up()) * self.t_per_world - self.advance) as f32
    }

    /// The hit that a caller's primitive returned, if it is within the range.
    #[inline(always)]
    pub fn hit(&self, t: f32, u: f32, v: f32) -> Option<SetHit> {
        // With these comparisons, NaN is no hit.
        (self.t_min() <= t && t <= self.t_max()).then(|| SetHit { t: t + 0.0, reach: self.reach(t), u, v })
    }
}

/// The slack for an origin with this largest coordinate: [`KERNEL_ULPS`] of it.
#[inline(always)]
fn slack(away: f32) -> f32 {
    KERNEL_ULPS * ULP * away + LEAST_SLACK
}

/// The distance along a ray at which it enters the cube around zero with this half size, or a little less; `None` if the ray misses
/// the cube or, unless it is a `line`, the cube lies behind it.
///
/// The result has [29 bits](in_29_bits). The half size exceeds the scene by far more than the error of the reciprocals.
fn distance_to_scene(origin: DVec3, dir: DVec3, half: f64, line: bool) -> Option<f64> {
    // If a component of the direction is zero, both are infinite: of equal signs outside the slab, and of different signs inside.
    let inverse = DVec3::ONE / dir;
    let (a, b) = ((-half - origin) * inverse, (half - origin) * inverse);
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    let met = near <= far && (line || far >= 0.0);
    met.then(|| in_29_bits(near))
}

/// A distance or a little less, whose product with a direction in f32 is exact in f64.
pub(super) fn in_29_bits(distance: f64) -> f64 {
    f64::from_bits(distance.to_bits() & !0xff_ffff)
}

/// A direction to be scaled: the exponent field of its longest component, and the power of two by which it was already divided.
pub(in crate::ray) struct Direction {
    pub dir: Vec3,
    field: u32,
    more: i32,
}

impl Direction {
    /// For a direction of any length except zero.
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

    /// The direction, scaled so that its longest component lies in [1, 2): what a distance in tree space of 1 is.
    pub(super) fn step(&self) -> DVec3 {
        self.dir.as_dvec3() * power_of_two(127 - self.field as i32)
    }

    /// Distance in tree space per `t`, in a tree space of this scale.
    #[inline(always)]
    fn t_per_world(&self, scale: f64) -> f64 {
        scale * power_of_two(self.field as i32 - 127 + self.more)
    }

    /// 2^exponent of the longest component.
    #[inline(always)]
    pub fn grow(&self) -> f32 {
        f32::from_bits(self.field << 23)
    }

    /// The power of two that scales the longest component into [1, 2).
    #[inline(always)]
    pub fn shrink(&self) -> f32 {
        f32::from_bits(254u32.wrapping_sub(self.field) << 23)
    }
}

/// Whether reciprocals and slopes of a direction neither overflow nor lose bits, by the exponent field of its longest component.
#[inline(always)]
pub(in crate::ray) fn is_in_range(field: u32) -> bool {
    EXPONENT_RANGE.contains(&field)
}

/// The bits of the longest component of a direction, without the sign. They order like the numbers; infinity and NaN come after all
/// numbers.
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
    use super::super::shear::Sheared;
    use super::*;
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
    fn invalid_rays_are_refused() {
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
