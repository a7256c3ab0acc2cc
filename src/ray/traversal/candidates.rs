//! Candidates: the triangles of a leaf block that a ray may hit, as far as f32 can tell.
//!
//! Deciding one triangle in f64 (`ray/kernel/triangle.rs`) takes as long as testing a whole block in f32. So f32 makes two tests. The first
//! test uses one margin for all triangles of the block and rules out most blocks. If any triangles are left, the second test uses a
//! margin for each triangle, and also compares its distance with the ray's range. The distance matters: rays that begin on a surface
//! meet more triangles just behind their origin than ahead of it.
//!
//! **Margins of edge functions** ([`crate::ray::kernel::shear`] derives them). First test: slopes are at most 1, so the sheared corners of a triangle
//! that is hit are at most twice its extent away per axis. The sheared coordinates of two corners add up to at most eight times the
//! extent plus four times the [`deviation`]. Second test: the coordinates of all three corners are summed, and the sum serves for all
//! three edges.
//!
//! **Margin of the distance.** The distance of a hit is the mean of its corners' distances, weighted by the edge functions. So it lies
//! between them.
//!
//! - If the weights are off by the margin, the mean moves by the margin times the differences between the corners' distances and the
//!   mean, divided by the sum of the weights. These differences add up to at most twice the sum of two: second corner to first, and
//!   third corner to first.
//! - Each corner's distance is at most `m` and is off by 6um: 4um of its depth, and the rounding of the reciprocal and of the product.
//!   So each of the two differences is off by 14um, together 28um, which is 2 `deviation`. The code adds twice as much.
//! - The mean is off by 6um as well, and by 3um for the rounding of its sums. The sum of the weights, its product with an end of the
//!   ray's range and that end are off by 5 ULP of it, which matters only where the end is below 2m. Together this is less than 28um.
//!   The code adds twice as much again.
//!
//! If the range itself is rounded by more, no hit is certain ([`TreeRay::certain_end`]).

use super::collect::Collect;
use crate::layout::block_sizes;
use crate::ray::kernel::shear::deviation;
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
}

/// Computes [`deviation`] with fewer instructions.
#[inline(always)]
fn deviation_of<S: Simd>(s: S, size: f32, slack: f32) -> f32 {
    s.mul_add_one(deviation(1.0, 0.0), size, deviation(0.0, slack))
}

/// The triangles of a block that may be hit.
pub(in crate::ray) struct Candidates {
    lanes: Mask,
    /// The candidates that are certainly hit. Known only for queries that accept a hit anywhere ([`Collect::ANYWHERE`]).
    certain: Mask,
    /// A lower bound of the distance of each hit in tree space. Known only if several candidates must be ordered.
    near: Lanes<f32>,
}

impl Candidates {
    /// The second test: which of the given lanes may be hit within the ray's range and within the distance that still matters.
    /// `distances` are those of the corners in tree space. If `FEW`, all lanes lie in the lower half.
    #[inline(always)]
    pub fn new<S: Simd, C: Collect, const FEW: bool>(
        s: S,
        edges: &Edges<S>,
        (lanes, distances, sizes): (Mask, [S::F; 3], u32),
        ray: &TreeRay,
        collect: &C,
    ) -> Candidates {
        let (size, extent) = block_sizes(sizes);
        let deviation = deviation_of(s, size, ray.slack);
        // For any e > 0, the sum of six magnitudes is at most half of (6e + the sum of their squares divided by e). Three short sums
        // have a shorter dependency chain than one long sum.
        let ([xa, xb, xc], [ya, yb, yc]) = (edges.x, edges.y);
        let squares = s.mul_add(xb, xb, xa * xa) + s.mul_add(ya, ya, xc * xc) + s.mul_add(yc, yc, yb * yb);
        let half = s.mul_add_one(0.5, extent, f32::MIN_POSITIVE);
        // Twice `edge_margin`, and a quarter more.
        let most = s.mul_add_one(3.125 * deviation, s.mul_add_one(3.0, half, 2.0 * deviation), 2.5 * f32::MIN_POSITIVE);
        let (most, of_squares) = (s.splat(most), s.splat(1.5625 * deviation / half));
        let margin = s.mul_add(squares, of_squares, most);
        let [da, db, dc] = distances;
        let differ = magnitude(s, da - db) + (magnitude(s, da - dc) + s.splat(4.0 * deviation));
        let [u, v, w] = [magnitude(s, edges.edges[0]), magnitude(s, edges.edges[1]), magnitude(s, edges.edges[2])];
        let weights = u + v + w;
        // The distance times the sum of the weights, and a bound of its error.
        let distance = s.mul_add(w, dc, s.mul_add(v, db, u * da));
        let off = s.mul_add(margin, differ, s.mul_add(weights, s.splat(4.0 * deviation), s.splat(f32::MIN_POSITIVE)));
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
            let below = s.negated_mul_add(squares, of_squares, s.splat(0.0) - most);
            let inside = s.lt(margin, edges.least) | s.lt(edges.greatest, below);
            candidates.certain =
                left & inside & s.le(begin, least) & s.le(greatest, weights * s.splat(collect.certain(ray)));
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

    /// Takes the next candidate to decide. If order matters, this is the nearest one; `None` if it lies beyond the distance that still
    /// matters.
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
fn several(lanes: Mask) -> bool {
    lanes & lanes.wrapping_sub(1) != 0
}

/// The absolute values.
#[inline(always)]
fn magnitude<S: Simd>(s: S, x: S::F) -> S::F {
    s.from_bits(s.to_bits(x) & s.splat_u(0x7fff_ffff))
}

#[cfg(test)]
mod tests {
    use super::super::collect::{Any, Closest};
    use super::*;
    use crate::geometry::{Frame, Ray};
    use crate::random::Random;
    use crate::ray::kernel::shear::Sheared;
    use crate::simd::Portable;
    use glam::{DVec3, Vec3};

    const ALL: Mask = Mask::MAX;

    /// The contents of a leaf block: triangles, and the word with their sizes.
    struct Block {
        triangles: Lanes<[Vec3; 3]>,
        sizes: u32,
    }

    impl Block {
        fn new(triangles: Lanes<[Vec3; 3]>) -> Block {
            let largest =
                |of: fn(&[Vec3; 3]) -> Vec3| triangles.iter().map(|t| of(t).max_element()).fold(0.0, f32::max);
            let size = largest(|[a, b, c]| a.abs().max(b.abs()).max(c.abs()));
            let extent = largest(|[a, b, c]| a.max(*b).max(*c) - a.min(*b).min(*c));
            let exponent = |x: f32| (x.to_bits() >> 23) + 1;
            Block { triangles, sizes: exponent(size) << 24 | exponent(extent) << 16 }
        }

        /// The lanes that are hit.
        fn hit(&self, ray: &TreeRay, sheared: &Sheared) -> Mask {
            let hit = |t: &[Vec3; 3]| ray.decide_one(sheared, t.map(Vec3::as_dvec3), ray.t_max()).is_some();
            (0..LANES).filter(|&i| hit(&self.triangles[i])).fold(0, |mask, i| mask | 1 << i)
        }

        /// The lanes that pass the first test, those that pass the second test (closest and any hit), and those that are certain.
        fn tests(&self, ray: &TreeRay, sheared: &Sheared, sizes: u32) -> [Mask; 4] {
            let s = Portable;
            let corners = self.triangles.map(|t| t.map(|p| sheared.corner(p, ray.origin)));
            let row = |corner: usize, axis: usize| s.load(&corners.map(|c| c[corner][axis]));
            let rows = |axis: usize| [row(0, axis), row(1, axis), row(2, axis)];
            let edges = Edges::new(s, rows(0), rows(1));
            let first = edges.may_be_hit(s, sizes, ray.slack);
            let of = (ALL, rows(2).map(|depth| depth * s.splat(sheared.inverse)), sizes);
            let closest = Closest::new(ray);
            let any = Any::new(ray, true);
            let closest = Candidates::new::<_, _, false>(s, &edges, of, ray, &closest);
            let any = Candidates::new::<_, _, false>(s, &edges, of, ray, &any);
            assert_eq!(closest.certain, 0);
            [first, closest.lanes, any.lanes, any.certain]
        }
    }

    /// Triangles of many sizes, rays to their corners and edges, and ranges that end at hits or one float beside them.
    #[test]
    fn no_hit_is_ruled_out_and_no_miss_is_certain_and_both_would_be_without_margins() {
        let mut random = Random(15);
        let (mut hits, mut certain, mut lost, mut lost_by_range, mut wrong) = (0, 0, 0, 0, 0);
        for i in 0..30_000 {
            let size = 10f32.powi(-(i % 7));
            let mut point = |scale: f32| random.vec() * scale;
            let place = point(1.0);
            let block =
                Block::new(core::array::from_fn(|_| [place + point(size), place + point(size), place + point(size)]));
            let origin = if i % 2 == 0 { point(3.0) } else { place + point(3.0 * size) };
            let [a, b, _] = block.triangles[i as usize % LANES];
            let target = if i % 3 == 0 { a } else { a.lerp(b, random.unit()) };
            let whole = Ray::new(origin, target - origin);
            let Some(ray) = TreeRay::new(&whole, &Frame::WORLD) else { continue };
            let sheared = Sheared::new(&ray);
            let Some(hit) =
                block.triangles.iter().find_map(|t| ray.decide_one(&sheared, t.map(Vec3::as_dvec3), f32::INFINITY))
            else {
                continue;
            };
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
                let [first, closest, any, sure] = block.tests(&ray, &sheared, block.sizes);
                assert_eq!(hit & !first, 0, "{part:?}");
                assert_eq!(hit & !closest, 0, "{part:?}");
                assert_eq!(hit & !any, 0, "{part:?}");
                assert_eq!(sure & !hit, 0, "{part:?}");
                hits += hit.count_ones();
                certain += sure.count_ones();
                // The margins for rounding removed.
                ray.slack = 0.0;
                let [first, closest, _, sure] = block.tests(&ray, &sheared, block.sizes & 0xff_ffff);
                lost += (hit & !first).count_ones();
                lost_by_range += (hit & first & !closest).count_ones();
                wrong += (sure & !hit).count_ones();
            }
        }
        assert!(hits > 100_000 && certain > hits / 4, "{certain} of {hits}");
        assert!(lost > 1000 && lost_by_range > 1000 && wrong > 1000, "{lost} {lost_by_range} {wrong}");
    }

    #[test]
    fn the_nearest_comes_first_and_what_is_beyond_it_never() {
        let wall =
            |depth: f32| [Vec3::new(-1.0, -1.0, depth), Vec3::new(3.0, -1.0, depth), Vec3::new(-1.0, 3.0, depth)];
        let block = Block::new(core::array::from_fn(|i| wall((i * 7 % LANES) as f32 / LANES as f32 - 0.25)));
        let part = Ray::new(DVec3::ZERO, Vec3::Z).between(0.01, f32::INFINITY);
        let ray = TreeRay::new(&part, &Frame::WORLD).unwrap();
        let sheared = Sheared::new(&ray);
        let s = Portable;
        let corners = block.triangles.map(|t| t.map(|p| sheared.corner(p, ray.origin)));
        let row = |corner: usize, axis: usize| s.load(&corners.map(|c| c[corner][axis]));
        let rows = |axis: usize| [row(0, axis), row(1, axis), row(2, axis)];
        assert_eq!(sheared.inverse, 1.0);
        let edges = Edges::new(s, rows(0), rows(1));
        let mut collect = Closest::new(&ray);
        let mut candidates = Candidates::new::<_, _, false>(s, &edges, (ALL, rows(2), block.sizes), &ray, &collect);
        let depth = |lane: usize| block.triangles[lane][0].z;
        assert_eq!(candidates.lanes.count_ones(), 11, "triangles behind the begin of the range are no candidates");
        assert_eq!(candidates.next(&collect).map(depth), Some(0.0625));
        assert_eq!(candidates.next(&collect).map(depth), Some(0.125));
        collect.reach = 0.15;
        assert_eq!(candidates.next(&collect), None);
    }
}
