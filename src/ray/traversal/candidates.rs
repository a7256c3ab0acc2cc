//! Candidates: the triangles of a leaf block that a ray may hit, as far as f32 can tell.
//!
//! Deciding one triangle in f64 (`ray/kernel/triangle.rs`) takes as long as testing a whole block in f32. So f32 makes two tests.
//! The first test uses one margin for all triangles of the block and rules out most blocks. If any triangles are left, the second
//! test uses a margin for each triangle, and also compares its distance with the ray's range. The distance matters: rays that begin
//! on a surface meet more triangles just behind their origin than ahead of it.
//!
//! **Margins of edge functions** ([`crate::ray::kernel::shear`] derives them). First test: slopes are at most 1, so the sheared
//! corners of a triangle that is hit are at most twice its extent away per axis. The sheared coordinates of two corners add up to
//! at most eight times the extent plus four times the [`deviation`]. Second test: the coordinates of all three corners are summed,
//! and the sum serves for all three edges.
//!
//! **Margin of the distance.** The distance of a hit is the mean of its corners' distances, weighted by the edge functions. So it
//! lies between them. Let `dev` be the [`Deviation`] of the corners, `u` an [`ULP`](crate::geometry::ULP) and `r` as there.
//!
//! - If the weights are off by the margin, the mean moves by the margin times the sum of the differences between the corners'
//!   distances and the mean, divided by the sum of the weights. That sum is at most twice the difference between the greatest
//!   distance and the least. The code takes twice the margin instead.
//! - A corner's distance is off by dev / 2. So the difference of two is off by dev, and its rounding by 2ur: less than 1.3 dev. The
//!   code adds 2.5 dev.
//! - The mean is off by dev / 2 as well, and by 5ur for the roundings of its sums and of the sum with its own margin. The sum of
//!   the weights, its product with an end of the ray's range and that end are off by 5u of it, which matters only where the end is
//!   below 2r. Together this is less than 2.2 dev. The code adds 2.5 dev.
//!
//! **Vague edge functions.** A triangle that is small relative to these margins, or degenerate as seen along the ray, has edge
//! functions within them wherever it is. But what is hit holds the ray in the range of its sheared coordinates along both axes,
//! since the signs of the decision in f64 are exact. The coordinates are off by dev (for a triangle that is hit), and 2.5 dev is at
//! hand. So such triangles are also compared with these ranges. They are few elsewhere; where rays lie in the planes of walls or
//! begin on them, or a mesh has triangles without area, most candidates are.
//!
//! The range itself may be rounded by more; up to where hits are certain then, [`TreeRay::certain_end`] tells.

use super::collect::Collect;
use crate::layout::{block_sizes, inverse_extent};
use crate::ray::kernel::shear::{Deviation, deviation};
use crate::ray::kernel::tree_ray::TreeRay;
use crate::simd::{LANES, Lanes, Mask, Simd};

/// The edge functions of the triangles of a block, one triangle per lane.
pub(in crate::ray) struct Edges<S: Simd> {
    /// Sheared coordinates of the corners.
    x: [S::F; 3],
    y: [S::F; 3],
    /// The edge functions of the edges opposite to the corners.
    edges: [S::F; 3],
    least: S::F,
    greatest: S::F,
}

impl<S: Simd> Edges<S> {
    #[inline(always)]
    pub fn new(s: S, x: [S::F; 3], y: [S::F; 3]) -> Edges<S> {
        let u = s.negated_mul_add(y[2], x[1], x[2] * y[1]);
        let v = s.negated_mul_add(y[0], x[2], x[0] * y[2]);
        let w = s.negated_mul_add(y[1], x[0], x[1] * y[0]);
        Edges { x, y, edges: [u, v, w], least: s.min(u, s.min(v, w)), greatest: s.max(u, s.max(v, w)) }
    }

    /// The first test: the triangles that may be hit, judged by the sizes of the block ([`block_sizes`]).
    #[inline(always)]
    pub fn may_be_hit(&self, s: S, sizes: u32, slack: f32) -> Mask {
        let (size, extent) = block_sizes(sizes);
        let deviation = deviation_of(s, size, slack);
        // `edge_margin` for the largest possible sum of coordinates.
        let margin = s.mul_add_one(1.25 * deviation, s.mul_add_one(6.0, deviation, 8.0 * extent), f32::MIN_POSITIVE);
        // All edge functions have the same sign, up to the margin.
        !(s.lt(self.least, s.splat(-margin)) & s.lt(s.splat(margin), self.greatest))
    }

    /// The triangles beside which the ray passes along one of the sheared axes, by more than `deviation`.
    #[inline(always)]
    fn beside(&self, s: S, deviation: S::F) -> Mask {
        beyond(s, self.x, deviation) | beyond(s, self.y, deviation)
    }
}

/// The lanes where zero is outside of the range of three numbers by more than a margin.
#[inline(always)]
fn beyond<S: Simd>(s: S, [a, b, c]: [S::F; 3], margin: S::F) -> Mask {
    let (least, greatest) = (s.min(a, s.min(b, c)), s.max(a, s.max(b, c)));
    s.lt(margin, least) | s.lt(greatest + margin, s.splat(0.0))
}

/// If the magnitudes of the edge functions of a triangle add up to at most this many margins, their signs tell little. (Not fitted:
/// a triangle without any size has three edge functions of less than a margin each.)
const VAGUE: f32 = 4.0;

/// Computes [`deviation`] with fewer instructions.
#[inline(always)]
fn deviation_of<S: Simd>(s: S, size: f32, slack: f32) -> f32 {
    s.mul_add_one(deviation(1.0, 0.0), size, deviation(0.0, slack))
}

/// The triangles of a block that may be hit.
#[derive(Clone, Copy)]
pub(in crate::ray) struct Candidates {
    pub(super) lanes: Mask,
    /// The candidates that are certainly hit. Known only for queries that accept a hit anywhere ([`Collect::ANYWHERE`]).
    pub(super) certain: Mask,
    /// A lower bound of the distance of each hit in tree space. Known only if several candidates must be ordered.
    pub(super) near: Lanes<f32>,
}

impl Candidates {
    /// The second test: which of the given lanes may be hit within the ray's range and within the distance that still matters.
    /// `distances` are those of the corners in tree space, `of` is their deviation. If `FEW`, all lanes lie in the lower half.
    #[inline(always)]
    pub fn new<S: Simd, C: Collect, const FEW: bool>(
        s: S,
        edges: &Edges<S>,
        (lanes, distances, sizes): (Mask, [S::F; 3], u32),
        (ray, of): (&TreeRay, Deviation),
        collect: &C,
    ) -> Candidates {
        let (size, extent) = block_sizes(sizes);
        let [da, db, dc] = distances;
        // Two and a half times the deviation.
        let deviation = s.mul_add(magnitude(s, da), s.splat(2.5 * of.far), s.splat(2.5 * of.near));
        // For any e > 0, the sum of six magnitudes is at most half of (6e + the sum of their squares divided by e). Three short
        // sums have a shorter dependency chain than one long sum.
        let ([xa, xb, xc], [ya, yb, yc]) = (edges.x, edges.y);
        let squares = s.mul_add(xb, xb, xa * xa) + s.mul_add(ya, ya, xc * xc) + s.mul_add(yc, yc, yb * yb);
        // Twice `edge_margin` is two and a half deviations times the sum of magnitudes and twice the deviation, which here is
        // bounded for the whole block: no corner is farther away than the largest coordinate plus the origin, and the slack is 20u
        // of the origin.
        let most = s.mul_add_one(of.far, size, of.near + ray.slack);
        let aside = s.mul_add_one(2.0, most, 1.5 * extent);
        let aside = s.mul_add(squares, s.splat(inverse_extent(sizes)), s.splat(aside));
        let tiny = s.splat(2.5 * f32::MIN_POSITIVE);
        let margin = s.mul_add(deviation, aside, tiny);
        let differ = s.max(da, s.max(db, dc)) - s.min(da, s.min(db, dc)) + deviation;
        let [u, v, w] = [magnitude(s, edges.edges[0]), magnitude(s, edges.edges[1]), magnitude(s, edges.edges[2])];
        let weights = u + v + w;
        // The distance times the sum of the weights, and a bound of its error.
        let distance = s.mul_add(w, dc, s.mul_add(v, db, u * da));
        let off = s.mul_add(margin, differ, s.mul_add(weights, deviation, s.splat(f32::MIN_POSITIVE)));
        let (least, greatest) = (distance - off, distance + off);
        let begin = weights * s.splat(ray.begin);
        // A comparison with NaN is false, so such a triangle is kept.
        let mut out = s.lt(greatest, begin);
        if C::ORDERED {
            out |= s.lt(weights * s.splat(collect.reach()), least);
        }
        let left = lanes & !out;
        let mut candidates = Candidates { lanes, certain: 0, near: [f32::NEG_INFINITY; LANES] };
        if left == 0 {
            candidates.lanes = 0;
            return candidates;
        }
        // A single candidate of the first test needs neither its lane nor its distance from here. The branch above predicts that it
        // is left, so its decision in f64 does not wait for this test.
        if several(lanes) {
            candidates.lanes = left;
            if C::ORDERED {
                let distances = least / weights;
                s.store(if FEW { s.lower_half(distances) } else { distances }, &mut candidates.near);
            }
        }
        if C::ANYWHERE {
            // Computed anew instead of as `-margin`, which would have to wait for `margin`.
            let below = s.negated_mul_add(deviation, aside, s.splat(-2.5 * f32::MIN_POSITIVE));
            let inside = s.lt(margin, edges.least) | s.lt(edges.greatest, below);
            candidates.certain =
                left & inside & s.le(begin, least) & s.le(greatest, weights * s.splat(collect.certain(ray)));
        }
        // A wrong candidate is decided sooner than it is looked for here, where there are no others and where one is a certain hit.
        if several(left) & (candidates.certain == 0) {
            let vague = left & s.le(weights, s.splat(VAGUE) * margin);
            if vague != 0 {
                candidates.lanes &= !(vague & edges.beside(s, deviation));
            }
        }
        candidates
    }

    /// Takes a candidate that is certainly hit, if there is one.
    #[inline(always)]
    pub fn certain(&mut self) -> Option<usize> {
        let lane = self.certain.trailing_zeros() as usize % LANES;
        let some = self.certain != 0;
        self.certain &= self.certain.wrapping_sub(1);
        some.then_some(lane)
    }

    /// The other candidates whose lower bound of the distance is that of a candidate just taken: among them are all with the same
    /// corners.
    #[inline(always)]
    pub fn alike<S: Simd, C: Collect>(&self, s: S, _: &C, i: usize) -> Mask {
        if C::ORDERED && self.lanes != 0 { self.lanes & s.eq(s.load(&self.near), s.splat(self.near[i])) } else { 0 }
    }

    /// Takes the next candidate to decide. If order matters, this is the nearest one; `None` if it lies beyond the distance that
    /// still matters.
    #[inline(always)]
    pub fn next<C: Collect>(&mut self, collect: &C) -> Option<usize> {
        if self.lanes == 0 {
            return None;
        }
        let mut next = self.lanes.trailing_zeros() as usize % LANES;
        if C::ORDERED {
            let mut others = self.lanes & (self.lanes - 1);
            while others != 0 {
                let lane = others.trailing_zeros() as usize % LANES;
                others &= others - 1;
                if self.near[lane] < self.near[next] {
                    next = lane;
                }
            }
            if self.near[next] > collect.reach() {
                return None;
            }
        }
        self.lanes ^= 1 << next;
        Some(next)
    }
}

/// Whether a mask has more than one lane.
#[inline(always)]
pub(super) fn several(lanes: Mask) -> bool {
    lanes & lanes.wrapping_sub(1) != 0
}

/// The absolute values.
#[inline(always)]
fn magnitude<S: Simd>(s: S, x: S::F) -> S::F {
    s.from_bits(s.to_bits(x) & s.splat_u(0x7fff_ffff))
}

#[cfg(test)]
mod tests {
    use super::super::collect::{Any, Closest, Found};
    use super::*;
    use crate::geometry::{Frame, Ray};
    use crate::primitive::Scene;
    use crate::random::Random;
    use crate::ray::kernel::shear::Sheared;
    use crate::simd::Portable;
    use glam::{DVec3, Vec3};

    const ALL: Mask = Mask::MAX;

    /// The contents of a leaf block: triangles at the key nearest to a time and at the next one, and the word with their sizes.
    struct Block {
        near: Lanes<[Vec3; 3]>,
        far: Lanes<[Vec3; 3]>,
        /// The same as they decide hits, which may be more precise.
        fine: [Lanes<[DVec3; 3]>; 2],
        /// From the nearest key to the next, at most 1/2; 0 without motion.
        fraction: f32,
        sizes: u32,
    }

    impl Block {
        fn new(near: Lanes<[Vec3; 3]>, far: Lanes<[Vec3; 3]>, fraction: f32) -> Block {
            let both = || near.iter().chain(&far);
            let largest = |of: fn(&[Vec3; 3]) -> Vec3| both().map(|t| of(t).max_element()).fold(0.0, f32::max);
            let size = largest(|[a, b, c]| a.abs().max(b.abs()).max(c.abs()));
            let extent = largest(|[a, b, c]| a.max(*b).max(*c) - a.min(*b).min(*c));
            let exponent = |x: f32| (x.to_bits() >> 23) + 1;
            let fine = [near, far].map(|key| key.map(|corners| corners.map(Vec3::as_dvec3)));
            Block { near, far, fine, fraction, sizes: exponent(size) << 24 | exponent(extent) << 16 }
        }

        /// The same triangles with corners in f64, of which those in the block are the nearest f32 numbers.
        fn kept_in_f64(mut self, random: &mut Random) -> Block {
            for x in self.fine.as_flattened_mut().as_flattened_mut().iter_mut().flat_map(|corner| corner.as_mut()) {
                let rounded = *x as f32;
                *x += f64::from(random.signed().signum()) * 0.49 * f64::from(rounded.next_up() - rounded);
            }
            self
        }

        /// Triangles of a size around a place; if they move, that far, together but for their size.
        fn random(random: &mut Random, place: Vec3, size: f32, far: f32) -> Block {
            let fraction = if far > 0.0 { 0.5 * random.unit() } else { 0.0 };
            let motion = random.vec() * far;
            let jitter = if far > 0.0 { size } else { 0.0 };
            let mut near = [[Vec3::ZERO; 3]; LANES];
            let mut next = near;
            for (a, b) in near.as_flattened_mut().iter_mut().zip(next.as_flattened_mut()) {
                let moved = motion + random.vec() * jitter;
                *a = place + random.vec() * size - moved * fraction;
                *b = *a + moved;
            }
            Block::new(near, next, fraction)
        }

        /// The corners of a triangle in f64.
        fn corners(&self, i: usize) -> [DVec3; 3] {
            core::array::from_fn(|c| {
                let [a, b] = [0, 1].map(|key: usize| self.fine[key][i][c]);
                a + (b - a) * f64::from(self.fraction)
            })
        }

        /// The lanes that are hit.
        fn hit(&self, ray: &TreeRay, sheared: &Sheared) -> Mask {
            let hit = |i: usize| ray.decide_one(sheared, self.corners(i), ray.t_max()).is_some();
            (0..LANES).filter(|&i| hit(i)).fold(0, |mask, i| mask | 1 << i)
        }

        /// The deviation of the corners.
        fn deviation(&self, slack: f32) -> Deviation {
            let (size, extent) = block_sizes(self.sizes);
            Deviation::of(Portable, extent, if self.fraction > 0.0 { size } else { 0.0 }, slack)
        }

        /// The edge functions, and the depths of the corners.
        fn edges(&self, ray: &TreeRay, sheared: &Sheared) -> (Edges<Portable>, [<Portable as Simd>::F; 3]) {
            let s = Portable;
            let [x, y, z, _] = ray.origin;
            let corners: Lanes<[[f32; 3]; 3]> = core::array::from_fn(|i| {
                core::array::from_fn(|c| {
                    let (a, b) = (self.near[i][c], self.far[i][c]);
                    sheared.corner((b - a) * self.fraction + (a - Vec3::new(x, y, z)), [0.0; 4])
                })
            });
            let row = |corner: usize, axis: usize| s.load(&corners.map(|c| c[corner][axis]));
            let rows = |axis: usize| [row(0, axis), row(1, axis), row(2, axis)];
            (Edges::new(s, rows(0), rows(1)), rows(2))
        }

        /// The lanes that pass the first test, those that pass the second test (closest and any hit), and those that are certain.
        fn tests(&self, ray: &TreeRay, sheared: &Sheared, sizes: u32, deviation: Deviation) -> [Mask; 4] {
            let s = Portable;
            let (edges, depths) = self.edges(ray, sheared);
            let first = edges.may_be_hit(s, sizes, ray.slack);
            let of = (ALL, depths.map(|depth| depth * s.splat(sheared.inverse)), sizes);
            let closest = Closest::new(ray);
            let any = Any::new(ray, true);
            let closest = Candidates::new::<_, _, false>(s, &edges, of, (ray, deviation), &closest);
            let any = Candidates::new::<_, _, false>(s, &edges, of, (ray, deviation), &any);
            assert_eq!(closest.certain, 0);
            [first, closest.lanes, any.lanes, any.certain]
        }
    }

    /// Triangles of many sizes, at rest and in motion, rays from near and from far to their corners and edges, and ranges that end
    /// at hits or one float beside them.
    #[test]
    fn no_hit_is_ruled_out_and_no_miss_is_certain_and_both_would_be_without_margins() {
        let mut random = Random(15);
        let (mut hits, mut certain, mut lost, mut lost_by_range, mut wrong, mut lost_in_f64) = (0, 0, 0, 0, 0, 0);
        for i in 0..60_000 {
            let size = 10f32.powi(-(i % 7));
            let place = random.vec();
            let block = Block::random(&mut random, place, size, if i % 4 < 2 { 0.0 } else { 1.0 });
            let in_f64 = i % 5 == 0;
            let block = if in_f64 { block.kept_in_f64(&mut random) } else { block };
            let origin = if i % 2 == 0 { random.vec() * 3.0 } else { place + random.vec() * 3.0 * size };
            let [a, b, _] = block.corners(i as usize % LANES).map(|p| p.as_vec3());
            let target = if i % 3 == 0 { a } else { a.lerp(b, random.unit()) };
            let whole = Ray::new(origin, target - origin);
            let Some(ray) = TreeRay::new(&whole, &Frame::WORLD) else { continue };
            let sheared = Sheared::new(&ray);
            let decide = |i: usize| ray.decide_one(&sheared, block.corners(i), f32::INFINITY);
            let Some(hit) = (0..LANES).find_map(decide) else { continue };
            for (begin, end) in [
                (0.0, f32::INFINITY),
                (hit.t, f32::INFINITY),
                (hit.t.next_up(), f32::INFINITY),
                (0.0, hit.t),
                (0.0, hit.t.next_down().max(0.0)),
            ] {
                let part = whole.between(begin, end);
                let Some(mut ray) = TreeRay::new(&part, &Frame::WORLD) else { continue };
                let hit = block.hit(&ray, &sheared);
                let deviation = block.deviation(ray.slack);
                let [first, closest, any, sure] = block.tests(&ray, &sheared, block.sizes, deviation);
                assert_eq!(hit & !first, 0, "{part:?}");
                assert_eq!(hit & !closest, 0, "{part:?}");
                assert_eq!(hit & !any, 0, "{part:?}");
                assert_eq!(sure & !hit, 0, "{part:?}");
                hits += hit.count_ones();
                certain += sure.count_ones();
                // The margins for rounding removed.
                ray.slack = 0.0;
                let none = Deviation { near: 0.0, far: 0.0 };
                let [first, closest, _, sure] = block.tests(&ray, &sheared, block.sizes & 0xff_ffff, none);
                lost += (hit & !first).count_ones();
                lost_in_f64 += if in_f64 { (hit & !first).count_ones() } else { 0 };
                lost_by_range += (hit & first & !closest).count_ones();
                wrong += (sure & !hit).count_ones();
            }
        }
        assert!(hits > 200_000 && certain > hits / 4, "{certain} of {hits}");
        assert!(lost > 2000 && lost_by_range > 2000 && wrong > 2000, "{lost} {lost_by_range} {wrong}");
        assert!(lost_in_f64 > lost / 5, "rounded vertices lose less: {lost_in_f64} of {lost}");
    }

    /// Takes a hit as certain up to a distance.
    struct UpTo(f32);

    impl Collect for UpTo {
        const ORDERED: bool = false;
        const ANYWHERE: bool = true;

        fn limit(&self) -> f32 {
            f32::MAX
        }

        fn reach(&self) -> f32 {
            f32::INFINITY
        }

        fn take(&mut self, _: Found, _: &Scene) -> bool {
            true
        }

        fn move_on(&mut self, _: &TreeRay) {}

        fn certain(&self, _: &TreeRay) -> f32 {
            self.0
        }
    }

    /// Rays from a hundred to a billion sizes away, of whose `t` one step may be longer than all triangles.
    #[test]
    fn of_rays_from_far_away_no_miss_is_certain_and_some_would_be_within_the_rounded_range() {
        let mut random = Random(27);
        let (mut hits, mut certain, mut wrong) = (0, 0, 0);
        for i in 0..40_000 {
            // All within the scene, to which origins are moved.
            let (size, place) = (0.2 * 10f32.powi(-(i % 3)), 0.4 * random.vec());
            let block = Block::random(&mut random, place, size, if i % 2 == 0 { 0.0 } else { 0.1 });
            let [a, b, c] = block.corners(i as usize % LANES);
            let (target, dir) = ((a + b + c) / 3.0, random.vec() * 10f32.powi(i % 5 - 2));
            let far = 10f64.powi(2 + i % 8) / f64::from(dir.abs().max_element());
            let whole = Ray::new(target - dir.as_dvec3() * far, dir);
            let Some(ray) = TreeRay::new(&whole, &Frame::WORLD) else { continue };
            let sheared = Sheared::new(&ray);
            let Some(hit) = ray.decide_one(&sheared, [a, b, c], f32::INFINITY) else { continue };
            for (begin, end) in [
                (0.0, f32::INFINITY),
                (f32::NEG_INFINITY, f32::INFINITY),
                (hit.t, f32::INFINITY),
                (hit.t.next_up(), f32::INFINITY),
                (0.0, hit.t),
                (0.0, hit.t.next_down()),
                (-hit.t, hit.t * 1.01),
            ] {
                let part = whole.between(begin, end);
                let Some(ray) = TreeRay::new(&part, &Frame::WORLD) else { continue };
                let hit = block.hit(&ray, &sheared);
                let [first, closest, any, sure] = block.tests(&ray, &sheared, block.sizes, block.deviation(ray.slack));
                assert_eq!(hit & !(first & closest & any), 0, "{part:?}");
                assert_eq!(sure & !hit, 0, "{part:?}");
                (hits, certain) = (hits + hit.count_ones(), certain + sure.count_ones());
                let (edges, depths) = block.edges(&ray, &sheared);
                let of = (ALL, depths.map(|depth| depth * Portable.splat(sheared.inverse)), block.sizes);
                let (ray, within) = ((&ray, block.deviation(ray.slack)), UpTo(ray.end));
                let sure = Candidates::new::<_, _, false>(Portable, &edges, of, ray, &within).certain;
                wrong += (sure & !hit).count_ones();
            }
        }
        assert!(hits > 200_000 && certain > hits / 5 && wrong > 1000, "{certain} of {hits} are certain, {wrong} wrong");
    }

    /// Points beside the ray, triangles in planes through it, and triangles on it that are as small as the rounding of their
    /// corners: all have edge functions within their margins.
    #[test]
    fn triangles_whose_signs_tell_nothing_are_ruled_out_beside_the_ray_only() {
        let mut random = Random(21);
        let (mut points, mut hits, mut out, mut lost) = ([0, 0], 0, 0, 0);
        for i in 0..20_000 {
            let whole = Ray::new(random.vec() * 3.0, random.vec());
            let Some(ray) = TreeRay::new(&whole, &Frame::WORLD) else { continue };
            let sheared = Sheared::new(&ray);
            let (along, across) = (whole.dir.normalize(), random.vec().cross(whole.dir).normalize());
            let normal = along.cross(across);
            let mut corners = [[Vec3::ZERO; 3]; LANES];
            for triangle in &mut corners {
                let place = whole.point(random.unit()).as_vec3();
                let beside = random.vec();
                for corner in triangle {
                    let in_plane = along * random.signed() + across * random.signed();
                    *corner = place
                        + match i % 4 {
                            1 => in_plane * 0.1 + normal * random.signed() * 1e-7,
                            3 => random.vec() * 4e-7,
                            _ => beside,
                        };
                }
            }
            let block = Block::new(corners, corners, 0.0);
            let hit = block.hit(&ray, &sheared);
            let deviation = block.deviation(ray.slack);
            let [first, closest, any, _] = block.tests(&ray, &sheared, block.sizes, deviation);
            assert_eq!(hit & !(first & closest & any), 0, "{whole:?}");
            if i % 2 == 0 {
                points = [points[0] + first.count_ones(), points[1] + (closest | any).count_ones()];
                continue;
            }
            // Neither is a hit ruled out where other tests leave no choice.
            let (s, (edges, depths)) = (Portable, block.edges(&ray, &sheared));
            let distance = magnitude(s, depths[0] * s.splat(sheared.inverse));
            let error = s.mul_add(distance, s.splat(deviation.far), s.splat(deviation.near));
            assert_eq!(hit & edges.beside(s, error), 0, "{whole:?}");
            hits += hit.count_ones();
            out += (first & !closest).count_ones();
            lost += (hit & edges.beside(s, s.splat(0.0))).count_ones();
        }
        assert!(points[0] > 100_000 && points[1] < points[0] / 1000, "{points:?} of points");
        assert!(hits > 10_000 && out > 10_000 && lost > 0, "{hits} {out} {lost}");
    }

    #[test]
    fn the_nearest_comes_first_and_what_is_beyond_it_never() {
        let wall =
            |depth: f32| [Vec3::new(-1.0, -1.0, depth), Vec3::new(3.0, -1.0, depth), Vec3::new(-1.0, 3.0, depth)];
        let walls = core::array::from_fn(|i| wall((i * 7 % LANES) as f32 / LANES as f32 - 0.25));
        let block = Block::new(walls, walls, 0.0);
        let part = Ray::new(DVec3::ZERO, Vec3::Z).between(0.01, f32::INFINITY);
        let ray = TreeRay::new(&part, &Frame::WORLD).unwrap();
        let sheared = Sheared::new(&ray);
        let s = Portable;
        let corners = block.near.map(|t| t.map(|p| sheared.corner(p, ray.origin)));
        let row = |corner: usize, axis: usize| s.load(&corners.map(|c| c[corner][axis]));
        let rows = |axis: usize| [row(0, axis), row(1, axis), row(2, axis)];
        assert_eq!(sheared.inverse, 1.0);
        let edges = Edges::new(s, rows(0), rows(1));
        let mut collect = Closest::new(&ray);
        let mut candidates = Candidates::new::<_, _, false>(
            s,
            &edges,
            (ALL, rows(2), block.sizes),
            (&ray, block.deviation(ray.slack)),
            &collect,
        );
        let depth = |lane: usize| block.near[lane][0].z;
        assert_eq!(candidates.lanes.count_ones(), 11, "triangles behind the begin of the range are no candidates");
        assert_eq!(candidates.next(&collect).map(depth), Some(0.0625));
        assert_eq!(candidates.next(&collect).map(depth), Some(0.125));
        collect.reach = 0.15;
        assert_eq!(candidates.next(&collect), None);
    }
}
