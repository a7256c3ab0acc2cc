//! Leaves that list shapes: spheres and custom primitives.
//!
//! Spheres are tested sixteen at a time in f32, which rules out most of them and knows of many that they are hit. The others are
//! decided one by one in f64, with the arithmetic of [`MovingSphere`]. Other primitives are tested one by one by their own
//! function, if the ray meets their boxes.
//!
//! **The test.** With the shear of [`crate::ray::kernel::shear`] a center relative to the ray is `(z sx + X, z sy + Y, z)`, and
//! `e = (sx, sy, 1)` is the direction, of which no component is greater than 1. The ray's distance from the center is that of
//! `(X, Y, 0)`: with `W = X sy - Y sx` and `Q = X^2 + Y^2 + W^2` its square is `Q / |e|^2`. The foot of the perpendicular has the
//! depth `z + (sx X + sy Y) / |e|^2`, and the depths of the hits are that much and `sqrt(r^2 |e|^2 - Q) / |e|^2` more or less.
//!
//! **Its margins.** Let `m` be the size of the block plus the largest coordinate of the origin, and `u` an ULP; [`deviation`] is
//! 16um.
//!
//! - `X` and `Y` are off by 13um each, and the ray's distance is no longer than `(X, Y)`: off by 19um. The radius is off by 4um, as
//!   it is rounded and interpolated like a coordinate. Both are less than twice the deviation, which the radius is enlarged by,
//!   with the error that the block states (of the interpolation, and of the sphere's own function).
//! - The squares, their sums and `|e|^2` are rounded by less than 16u of themselves, by which the square of the enlarged radius is
//!   greater. So the root, too, is an upper bound: it would be even if it were rounded by 8u of the radius.
//! - The depth of the foot is off by 4um for `z`, by 10um for `X` and `Y` (`|sx| + |sy|` is at most .71 of `|e|^2`), and by 4um for
//!   the sums; the reciprocal of the direction puts a distance off by 2u of it, and the rounding of `t` by 2u as well, where no
//!   distance that matters is greater than 2m. Together this is less than the four deviations by which distances are moved.
//! - Squares of numbers below 2^-63 are not rounded by u of themselves, but by up to 2^-150. The radius is enlarged by 2^-60 more
//!   ([`LEAST_SQUARED`]), in units of tree space, whose scenes have about the size of 1. Then its square is at least 2^-120, of
//!   which 16u are far more.
//! - A hit is certain if all of this, the other way round, does not prevent it.

use super::candidates::{Candidates, several};
use super::collect::{Collect, Found};
use super::traverser::Traverser;
use crate::geometry::{KeyTime, LEAST_SQUARED, ULP};
use crate::layout::{
    Between, ChildRef, ListBoxes, NODE_ROWS, SPHERE_ROWS, STATIC_NODE_ROWS, SphereLeaf, block_sizes, sphere_row,
};
use crate::primitive::MovingSphere;
use crate::ray::filter::Filter;
use crate::ray::kernel::shear::{Sheared, deviation};
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;
use crate::simd::{LANES, Mask, Rows, Simd, first_lanes};

impl<F: Filter> Traverser<'_, F> {
    /// Tests the primitives of a list of ids; true ends the query.
    #[inline(always)]
    pub(in crate::ray) fn shapes<S: Simd>(
        &self,
        s: S,
        leaf: ChildRef,
        (ray, sheared): (&TreeRay, &Sheared),
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) -> bool {
        let (at, n) = (leaf.at(), leaf.len());
        observer.leaf();
        observer.primitive_tests(n);
        let Some(spheres) = SphereLeaf::of(&self.arena.ints()[at..], n) else {
            return self.listed(s, leaf, (ray, sheared), collect);
        };
        let mut candidates = match spheres.keys {
            1 => {
                let rows = Rows::new(&self.arena.floats()[at + spheres.rows(n, 0)..], n, SPHERE_ROWS);
                spheres_met::<S, _, false>(
                    s,
                    &rows,
                    (spheres.sizes, Between::NEVER, first_lanes(n)),
                    (ray, sheared),
                    collect,
                )
            }
            keys => {
                let time = KeyTime::new(ray.time(), keys);
                let rows = Rows::new(&self.arena.floats()[at + spheres.rows(n, time.segment)..], n, 2 * SPHERE_ROWS);
                spheres_met::<S, _, true>(
                    s,
                    &rows,
                    (spheres.sizes, Between::new(time), first_lanes(n)),
                    (ray, sheared),
                    collect,
                )
            }
        };
        if candidates.lanes == 0 {
            return false;
        }
        if self.is_certainly_hit(&mut candidates, at, ray, collect) {
            return true;
        }
        while let Some(i) = candidates.next(collect) {
            if self.decide_sphere(at, (spheres, i, n), (ray, sheared), collect) {
                return true;
            }
        }
        false
    }

    /// Tests listed shapes by their own functions: those whose boxes the ray meets, if the list has boxes. True ends the query.
    #[inline(always)]
    fn listed<S: Simd, C: Collect>(&self, s: S, leaf: ChildRef, of: (&TreeRay, &Sheared), collect: &mut C) -> bool {
        let (at, n) = (leaf.at(), leaf.len());
        let mut candidates = Candidates { lanes: first_lanes(n), certain: 0, near: [f32::NEG_INFINITY; LANES] };
        if let Some(boxes) = ListBoxes::of(&self.arena.ints()[at..], n) {
            let slabs = &of.0.slabs;
            let words = &self.arena.floats()[at..];
            let (met, near) = match boxes.moving {
                true => slabs.enter::<S, NODE_ROWS>(s, &boxes.rows::<NODE_ROWS>(words, n), collect.reach()),
                false => {
                    slabs.enter::<S, STATIC_NODE_ROWS>(s, &boxes.rows::<STATIC_NODE_ROWS>(words, n), collect.reach())
                }
            };
            candidates.lanes &= met;
            // The distances of a ray that begins behind its origin are offset.
            if C::ORDERED && several(candidates.lanes) && slabs.behind() == 0.0 {
                s.store(near, &mut candidates.near);
            }
        }
        while let Some(i) = candidates.next(collect) {
            if self.decide(at + i, of, collect) {
                return true;
            }
        }
        false
    }

    /// Decides whether a sphere of a block of `n` is hit, which begins at word `at`. True ends the query.
    #[inline(always)]
    fn decide_sphere(
        &self,
        at: usize,
        (spheres, lane, n): (SphereLeaf, usize, usize),
        (ray, sheared): (&TreeRay, &Sheared),
        collect: &mut impl Collect,
    ) -> bool {
        let words = &self.arena.ints()[at..];
        let Some(now) = spheres.at(words, n, lane, ray.time()) else {
            return self.decide(at + lane, (ray, sheared), collect);
        };
        if !self.sees(words[lane], ray) {
            return false;
        }
        let Some(hit) = MovingSphere::intersection(now, ray.original) else { return false };
        let Some(hit) = ray.hit(hit.t, hit.u, hit.v) else { return false };
        hit.t <= collect.limit() && collect.offer(Found { hit, id: words[lane] }, ray, self.scene, self.filter)
    }

    /// Decides by the primitive's own function whether it is hit; its id is at word `id`. True ends the query.
    #[inline(always)]
    pub(super) fn decide(&self, id: usize, (ray, sheared): (&TreeRay, &Sheared), collect: &mut impl Collect) -> bool {
        let id = self.arena.ints()[id];
        if !self.sees(id, ray) {
            return false;
        }
        let Some(hit) = self.scene.intersect(id, ray, sheared) else { return false };
        hit.t <= collect.limit() && collect.offer(Found { hit, id }, ray, self.scene, self.filter)
    }
}

/// The spheres in rows that a ray may hit, of the lanes that are `present`.
#[inline(always)]
fn spheres_met<S: Simd, C: Collect, const MOVING: bool>(
    s: S,
    rows: &Rows,
    (sizes, between, present): (u32, Between, Mask),
    (ray, of): (&TreeRay, &Sheared),
    collect: &C,
) -> Candidates {
    let (size, error) = block_sizes(sizes);
    // The black box keeps the compiler from computing derived values ahead, for blocks that may never be visited.
    let of = core::hint::black_box(of);
    let [kx, ky, kz] = of.axes();
    let (sx, sy) = (s.splat(of.sx), s.splat(of.sy));
    let z = sphere_row::<S, MOVING>(s, rows, between, kz, ray.origin[kz]);
    let x = s.negated_mul_add(sx, z, sphere_row::<S, MOVING>(s, rows, between, kx, ray.origin[kx]));
    let y = s.negated_mul_add(sy, z, sphere_row::<S, MOVING>(s, rows, between, ky, ray.origin[ky]));
    let radius = sphere_row::<S, MOVING>(s, rows, between, SPHERE_ROWS - 1, 0.0);
    let w = s.negated_mul_add(sx, y, sy * x);
    let aside = s.mul_add(w, w, s.mul_add(y, y, x * x));
    let length = 1.0 + of.sx * of.sx + of.sy * of.sy;
    let off = 2.0 * deviation(size, ray.slack) + LEAST_SQUARED;
    let reach = radius + s.splat(off + error);
    let inside = reach * reach * s.splat(length * (1.0 + 16.0 * ULP)) - aside;
    // Comparisons with NaN are false, so such a sphere is kept.
    let mut out = s.lt(inside, s.splat(0.0));
    let mut candidates = Candidates { lanes: !out & present, certain: 0, near: [f32::NEG_INFINITY; LANES] };
    if candidates.lanes == 0 {
        return candidates;
    }
    // From depths to distances in tree space.
    let scale = s.splat(of.inverse);
    let half_scale = s.splat(of.inverse.abs() / length);
    let foot = s.mul_add(s.mul_add(sy, y, sx * x), s.splat(1.0 / length), z) * scale;
    let beyond = s.splat(2.0 * off + error);
    let half = s.sqrt(inside) * half_scale;
    let (near, far) = (foot - half - beyond, foot + half + beyond);
    let begin = s.splat(ray.begin);
    out |= s.lt(far, begin);
    if C::ORDERED {
        out |= s.lt(s.splat(collect.reach()), near);
    }
    candidates.lanes = !out & present;
    let around = if C::ORDERED { s.lt(near, begin) & candidates.lanes } else { 0 };
    if C::ORDERED && around == 0 && several(candidates.lanes) {
        s.store(near, &mut candidates.near);
    }
    if !C::ANYWHERE && around == 0 {
        return candidates;
    }
    // The same bounds from inside: of a smaller sphere that the ray certainly meets.
    let zero = s.splat(0.0);
    let least = radius - s.splat(off + error);
    let inside = least * least * s.splat(length * (1.0 - 16.0 * ULP)) - aside;
    let met = s.lt(zero, least) & s.lt(zero, inside);
    let half = s.sqrt(inside) * half_scale;
    let (entered, left) = (foot - half + beyond, foot + half - beyond);
    if C::ANYWHERE {
        let end = s.splat(collect.certain(ray));
        let enters = s.le(begin, near) & s.le(entered, end);
        let leaves = s.le(begin, left) & s.le(far, end);
        candidates.certain = met & (enters | leaves) & candidates.lanes;
    }
    if C::ORDERED {
        // Where the ray begins inside of a sphere, it is hit from there.
        let from_inside = met & s.lt(entered, begin);
        let near = s.select(from_inside, left, near);
        candidates.lanes &= !s.lt(s.splat(collect.reach()), near);
        s.store(near, &mut candidates.near);
    }
    candidates
}

#[cfg(test)]
mod tests {
    use super::super::collect::{Any, Closest};
    use super::*;
    use crate::geometry::{Frame, Ray};
    use crate::primitive::Primitive;
    use crate::random::Random;
    use crate::simd::Portable;
    use glam::Vec3;

    /// Sixteen spheres with two keys, and the rows of their block.
    struct Block {
        spheres: Vec<MovingSphere>,
        rows: Vec<f32>,
        size: f32,
    }

    impl Block {
        /// Spheres of a size around a place that move that far, or not.
        fn random(random: &mut Random, place: Vec3, size: f32, far: f32) -> Block {
            let mut block = Block { spheres: Vec::new(), rows: vec![0.0; 2 * SPHERE_ROWS * LANES], size: 0.0 };
            for lane in 0..LANES {
                let (center, motion) = (place + random.vec() * size, random.vec() * far);
                let keys = [center, center + motion].map(|center| (center, size * random.unit()));
                for (key, (center, radius)) in keys.into_iter().enumerate() {
                    for (row, x) in [center.x, center.y, center.z, radius].into_iter().enumerate() {
                        block.rows[(SPHERE_ROWS * key + row) * LANES + lane] = x;
                        block.size = block.size.max(x.abs());
                    }
                }
                let keys = keys.map(|(center, radius)| (center.as_dvec3(), f64::from(radius)));
                block.spheres.push(MovingSphere::new(keys.to_vec()));
            }
            block
        }

        fn hit(&self, ray: &Ray) -> Mask {
            (0..LANES).filter(|&i| self.spheres[i].intersect(ray).is_some()).fold(0, |mask, i| mask | 1 << i)
        }

        /// The lanes that may be hit (closest and any hit), and those that are certain.
        fn tests(&self, ray: &TreeRay, size: f32) -> [Mask; 3] {
            let sizes = ((size.to_bits() >> 23) + 1) << 24;
            let (rows, between) = (Rows::new(&self.rows, LANES, 2 * SPHERE_ROWS), Between::of_two(ray.time()));
            let (of, at) = (Sheared::new(ray), (sizes, between, Mask::MAX));
            let closest = spheres_met::<_, _, true>(Portable, &rows, at, (ray, &of), &Closest::new(ray));
            let any = spheres_met::<_, _, true>(Portable, &rows, at, (ray, &of), &Any::new(ray, true));
            assert_eq!(closest.certain, 0);
            [closest.lanes, any.lanes, any.certain]
        }
    }

    /// Spheres of many sizes, at rest and in motion, rays from near, from far and from inside along tangents and through the
    /// middle, and ranges that end at hits or one float beside them.
    #[test]
    fn no_hit_is_ruled_out_and_no_miss_is_certain_and_both_would_be_without_margins() {
        let mut random = Random(19);
        let (mut hits, mut certain, mut lost, mut wrong) = (0, 0, 0, 0);
        let (mut kept, mut large) = (0, 0);
        for i in 0..40_000 {
            let size = 10f32.powi(-(i % 7));
            let place = random.vec();
            let block = Block::random(&mut random, place, size, if i % 4 < 2 { 0.0 } else { 1.0 });
            let time = random.unit();
            let (center, radius) = block.spheres[i as usize % LANES].at(time);
            let (center, radius) = (center.as_vec3(), radius as f32);
            let origin = match i % 3 {
                0 => random.vec() * 3.0,
                1 => center + random.vec() * 3.0 * size,
                _ => center + random.vec() * radius,
            };
            let aside = (center - origin).cross(random.vec()).normalize_or_zero() * radius;
            let target = center + if i % 2 == 0 { aside } else { random.vec() * radius };
            let whole = Ray::new(origin, target - origin).at_time(time);
            let mut rays = vec![whole];
            if let Some(hit) = block.spheres[i as usize % LANES].intersect(&whole) {
                let [t, before] = [hit.t, hit.t.next_down()];
                rays.extend([whole.between(0.0, t), whole.between(0.0, before.max(0.0)), whole.between(t, f32::MAX)]);
                rays.push(whole.between(t.next_up(), f32::MAX));
            }
            for ray in rays {
                let Some(tree_ray) = TreeRay::new(&ray, &Frame::WORLD) else { continue };
                let exact = block.hit(&ray);
                let [closest, any, sure] = block.tests(&tree_ray, block.size);
                assert_eq!(exact & !closest, 0, "{i}: a hit is ruled out");
                assert_eq!(exact & !any, 0, "{i}: a hit is ruled out");
                assert_eq!(sure & !exact, 0, "{i}: a miss is certain");
                (hits, certain) = (hits + exact.count_ones(), certain + sure.count_ones());
                if size > 1e-3 {
                    (kept, large) = (kept + closest.count_ones(), large + exact.count_ones());
                }
                let mut bare = tree_ray;
                bare.slack = 0.0;
                let [closest, _, sure] = block.tests(&bare, 0.0);
                lost += (exact & !closest).count_ones();
                wrong += (sure & !exact).count_ones();
            }
        }
        assert!(10 * kept < 13 * large, "{kept} may be hit, {large} are");
        assert!(2 * certain > hits, "{certain} of {hits} hits are certain");
        assert!(lost > 100 && wrong > 100, "margins that nothing needs: {lost} lost, {wrong} wrong");
    }

    #[test]
    fn spheres_around_the_origin_of_a_ray_are_ordered_by_where_it_leaves_them() {
        let mut random = Random(20);
        let mut ordered = 0;
        for _ in 0..1000 {
            let block = Block::random(&mut random, Vec3::ZERO, 0.5, 0.0);
            let ray = Ray::new(random.vec() * 0.2, random.vec());
            let Some(tree_ray) = TreeRay::new(&ray, &Frame::WORLD) else { continue };
            let rows = Rows::new(&block.rows, LANES, 2 * SPHERE_ROWS);
            let sizes = ((block.size.to_bits() >> 23) + 1) << 24;
            let at = (sizes, Between::of_two(0.0), Mask::MAX);
            let of = Sheared::new(&tree_ray);
            let closest = spheres_met::<_, _, true>(Portable, &rows, at, (&tree_ray, &of), &Closest::new(&tree_ray));
            let nearest = (0..LANES).filter_map(|i| Some((block.spheres[i].intersect(&ray)?.t, i)));
            let Some((_, nearest)) = nearest.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            let inside = |i: usize| {
                let (center, radius) = block.spheres[i].at(0.0);
                (center - ray.origin).length() < radius
            };
            if inside(nearest) && several(closest.lanes) {
                let first = (0..LANES).filter(|i| closest.lanes >> i & 1 != 0);
                let first = first.min_by(|&a, &b| closest.near[a].total_cmp(&closest.near[b]));
                assert_eq!(first, Some(nearest));
                ordered += 1;
            }
        }
        assert!(ordered > 50, "{ordered}");
    }
}
