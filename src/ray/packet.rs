//! Up to sixteen rays with the same octant of directions against the boxes of a node.
//!
//! There are two tests. The first tests all rays at once against sixteen boxes, with bounds of the rays' origins, directions and times
//! (interval arithmetic; Boulos, Wald and Shirley, "Geometric and Arithmetic Culling Methods for Entire Ray Packets", 2006). The second
//! tests each ray against one box, with the arithmetic of a single ray ([`super::slabs`]).
//!
//! **Proof that the bounds cull no box that a ray of the packet would enter and in which it would hit.**
//!
//! - Let `s` be the sign of the directions along an axis, which all rays share. A ray with origin `o`, slack `k` and reciprocal `r` enters
//!   at `(s f - s o - k) |r|`. For any fixed `|r|` this is least for the least `s f` and the greatest `s o` and `k`. It is linear in `|r|`,
//!   so its minimum is at one end of the range of `|r|`.
//! - The face `f` is linear in time and its rounding is monotone. So its extremes are at the ends of the range of times.
//! - The computation has three roundings besides that of the face: the constant term, the difference and the product. Each is relative to
//!   at most `(|f| + |o| + k) |r|`. A single ray has no fewer, and the padding of boxes and the slack of rays cover them.
//! - The proof for the distance at which a ray leaves a box is the same, with least and greatest exchanged.

use super::tree_ray::TreeRay;
use crate::layout::NODE_ROWS;
use crate::simd::{LANES, Lanes, Mask, Simd, lanes_at};
use crate::traverse::NodeBlock;
use glam::Vec3A;

/// Rays whose directions have the same signs, one ray per lane.
pub(super) struct Packet {
    /// The number of lanes that hold a ray.
    count: usize,
    /// See [`Slabs`](super::slabs::Slabs), per axis.
    near: [usize; 3],
    inverse: [Lanes<f32>; 3],
    near_offset: [Lanes<f32>; 3],
    far_offset: [Lanes<f32>; 3],
    begin: Lanes<f32>,
    time: Lanes<f32>,
    /// The distance up to which a hit still matters to each ray: negative if the ray has its answer, and in empty lanes.
    reach: Lanes<f32>,
    /// The greatest of `reach`.
    limit: f32,
    /// The signs of the directions.
    sign: Vec3A,
    /// The greatest origin along the direction of the rays plus slack, and the least origin minus slack.
    ahead: Vec3A,
    behind: Vec3A,
    /// The least and the greatest magnitude of a reciprocal.
    flat: Vec3A,
    steep: Vec3A,
    /// The least begin.
    soonest: f32,
    /// The earliest and the latest time.
    times: [f32; 2],
}

impl Packet {
    /// A packet without rays.
    #[inline(always)]
    pub fn empty() -> Packet {
        Packet {
            count: 0,
            near: [0; 3],
            inverse: [[0.0; LANES]; 3],
            near_offset: [[0.0; LANES]; 3],
            far_offset: [[0.0; LANES]; 3],
            begin: [0.0; LANES],
            time: [0.0; LANES],
            reach: [-1.0; LANES],
            limit: -1.0,
            sign: Vec3A::ONE,
            ahead: Vec3A::NEG_INFINITY,
            behind: Vec3A::INFINITY,
            flat: Vec3A::INFINITY,
            steep: Vec3A::ZERO,
            soonest: f32::INFINITY,
            times: [f32::INFINITY, f32::NEG_INFINITY],
        }
    }

    /// Whether the packet has a free lane and the ray is in its octant. A ray that begins behind its origin is never taken, since its
    /// distances have an offset.
    #[inline(always)]
    pub fn takes(&self, ray: &TreeRay) -> bool {
        ray.slabs.behind() == 0.0 && (self.count == 0 || (self.count < LANES && ray.slabs.near == self.near))
    }

    /// Adds a ray that the packet [takes](Packet::takes).
    #[inline(always)]
    pub fn add(&mut self, ray: &TreeRay) {
        let (i, slabs) = (self.count % LANES, &ray.slabs);
        self.count += 1;
        self.near = slabs.near;
        for axis in 0..3 {
            self.inverse[axis][i] = slabs.inverse[axis];
            self.near_offset[axis][i] = slabs.near_offset[axis];
            self.far_offset[axis][i] = slabs.far_offset[axis];
        }
        self.begin[i] = slabs.begin;
        self.time[i] = slabs.time();
        self.reach[i] = ray.end;
        self.limit = self.limit.max(ray.end);
        self.sign = Vec3A::ONE.copysign(slabs.inverse);
        let [x, y, z, _] = ray.origin;
        let along = self.sign * Vec3A::new(x, y, z);
        self.ahead = self.ahead.max(along + ray.slack);
        self.behind = self.behind.min(along - ray.slack);
        self.flat = self.flat.min(slabs.inverse.abs());
        self.steep = self.steep.max(slabs.inverse.abs());
        self.soonest = self.soonest.min(slabs.begin);
        self.times = [self.times[0].min(slabs.time()), self.times[1].max(slabs.time())];
    }

    /// Shortens the reach of a ray; the caller calls [`Packet::update_limit`] afterwards.
    #[inline(always)]
    pub fn set_reach(&mut self, lane: usize, reach: f32) {
        self.reach[lane % LANES] = reach;
    }

    /// Recomputes the greatest reach of all rays.
    #[inline(always)]
    pub fn update_limit<S: Simd>(&mut self, s: S) {
        let reach = s.load(&self.reach);
        let reach = s.max(reach, s.swap_lanes::<8>(reach));
        let reach = s.max(reach, s.swap_lanes::<4>(reach));
        let reach = s.max(reach, s.swap_lanes::<2>(reach));
        self.limit = s.lane(s.max(reach, s.swap_lanes::<1>(reach)), 0);
    }

    /// The greatest distance up to which a hit still matters to any ray.
    #[inline(always)]
    pub fn limit(&self) -> f32 {
        self.limit
    }

    /// The boxes of a node that any of the rays may meet, and lower bounds of the distances at which rays enter them.
    #[inline(always)]
    pub fn enter<S: Simd, const ROWS: usize>(&self, s: S, block: &NodeBlock) -> (Mask, S::F) {
        let times = [s.splat(self.times[0]), s.splat(self.times[1])];
        // No closures: they would be compiled without the instruction set.
        let x = self.slab::<S, ROWS, 0>(s, block, times);
        let y = self.slab::<S, ROWS, 1>(s, block, times);
        let z = self.slab::<S, ROWS, 2>(s, block, times);
        let enter = s.max(s.max(x.0, y.0), s.max(z.0, s.splat(self.soonest)));
        let leave = s.min(s.min(x.1, y.1), s.min(z.1, s.splat(self.limit)));
        (s.le(enter, leave), enter)
    }

    /// Along an axis, the least distance at which any ray enters each box, and the greatest at which any ray leaves it.
    #[inline(always)]
    fn slab<S: Simd, const ROWS: usize, const AXIS: usize>(
        &self,
        s: S,
        block: &NodeBlock,
        times: [S::F; 2],
    ) -> (S::F, S::F) {
        let (near, far) =
            (2 * AXIS * LANES + (self.near[AXIS] & LANES), 2 * AXIS * LANES + (self.near[AXIS] & LANES ^ LANES));
        let (sign, flat, steep) = (s.splat(self.sign[AXIS]), s.splat(self.flat[AXIS]), s.splat(self.steep[AXIS]));
        let enters =
            [sign * face::<S, ROWS>(s, block, near, times[0]), sign * face::<S, ROWS>(s, block, near, times[1])];
        let leaves = [sign * face::<S, ROWS>(s, block, far, times[0]), sign * face::<S, ROWS>(s, block, far, times[1])];
        let enter = s.min(enters[0], enters[1]) - s.splat(self.ahead[AXIS]);
        let leave = s.max(leaves[0], leaves[1]) - s.splat(self.behind[AXIS]);
        (s.min(enter * flat, enter * steep), s.max(leave * flat, leave * steep))
    }

    /// The rays that meet one box of a node, with the result that each would have if it were traversed alone.
    #[inline(always)]
    pub fn meet<S: Simd, const ROWS: usize>(&self, s: S, block: &NodeBlock, lane: usize) -> Mask {
        let time = s.load(&self.time);
        let near = [
            self.distances::<S, ROWS, 0>(s, block, self.near[0], lane, time, &self.near_offset[0]),
            self.distances::<S, ROWS, 1>(s, block, self.near[1], lane, time, &self.near_offset[1]),
            self.distances::<S, ROWS, 2>(s, block, self.near[2], lane, time, &self.near_offset[2]),
        ];
        let far = [
            self.distances::<S, ROWS, 0>(s, block, self.near[0] ^ LANES, lane, time, &self.far_offset[0]),
            self.distances::<S, ROWS, 1>(s, block, self.near[1] ^ LANES, lane, time, &self.far_offset[1]),
            self.distances::<S, ROWS, 2>(s, block, self.near[2] ^ LANES, lane, time, &self.far_offset[2]),
        ];
        let enter = s.max(s.max(near[0], near[1]), s.max(near[2], s.load(&self.begin)));
        let leave = s.min(s.min(far[0], far[1]), s.min(far[2], s.load(&self.reach)));
        s.le(enter, leave)
    }

    /// The distance at which each ray meets one face of one box.
    #[inline(always)]
    fn distances<S: Simd, const ROWS: usize, const AXIS: usize>(
        &self,
        s: S,
        block: &NodeBlock,
        side: usize,
        lane: usize,
        time: S::F,
        offset: &Lanes<f32>,
    ) -> S::F {
        let at = 2 * AXIS * LANES + (side & LANES) + lane % LANES;
        let begin = s.splat(block[at]);
        let face = if ROWS == NODE_ROWS { s.mul_add(s.splat(block[at + 6 * LANES]), time, begin) } else { begin };
        s.mul_add(face, s.load(&self.inverse[AXIS]), s.load(offset))
    }
}

/// One face of each box of a node at a time. The row of the faces begins at word `row` of the block.
#[inline(always)]
fn face<S: Simd, const ROWS: usize>(s: S, block: &NodeBlock, row: usize, time: S::F) -> S::F {
    let at = s.load(lanes_at(block, row));
    if ROWS == NODE_ROWS { s.mul_add(s.load(lanes_at(block, row + 6 * LANES)), time, at) } else { at }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Box3, Frame, KERNEL_ULPS, ULP};
    use crate::layout::STATIC_NODE_ROWS;
    use crate::random::Random;
    use crate::ray::Ray;
    use crate::ray::intersect::intersect_triangle;
    use crate::ray::shear::Sheared;
    use crate::simd::{Kernel, SimdLevel, dispatch};
    use glam::Vec3;

    /// Finds the boxes of a static node that a packet may meet, and the rays that meet the first box.
    struct Met<'a>(&'a mut Packet, &'a NodeBlock);

    impl Kernel for Met<'_> {
        type Output = (Mask, Mask);

        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> (Mask, Mask) {
            let Met(packet, block) = self;
            packet.update_limit(s);
            (packet.enter::<S, STATIC_NODE_ROWS>(s, block).0, packet.meet::<S, STATIC_NODE_ROWS>(s, block, 0))
        }
    }

    /// A static node with one box, in its first lane.
    fn node_of(hull: Box3) -> NodeBlock {
        let mut block = [0.0; LANES * LANES];
        for axis in 0..3 {
            block[2 * axis * LANES..][..LANES].fill(1e30);
            block[(2 * axis + 1) * LANES..][..LANES].fill(-1e30);
            block[2 * axis * LANES] = hull.min[axis];
            block[(2 * axis + 1) * LANES] = hull.max[axis];
        }
        block
    }

    /// The number of packets in which a ray hits a triangle along an edge of its box, and the number of these that miss the box. The
    /// slack of rays and the padding of the box are multiplied by `part`.
    fn lost(part: f32, level: SimdLevel) -> (usize, usize) {
        let mut random = Random(77);
        let (mut met, mut missed) = (0, 0);
        for _ in 0..20_000 {
            let (a, mut b, c) = (random.vec(), random.vec(), random.vec());
            (b.x, b.y) = (a.x, a.y);
            let origin = random.vec() * 3.0;
            // All rays pass near an edge of the box, and most of them outside the box.
            let mut packet = Packet::empty();
            let mut any = false;
            for i in 0..LANES {
                let target = a + (b - a) * (0.5 + 0.5 * random.signed());
                let original = Ray::new(origin, target - origin);
                let mut ray = TreeRay::new(&original, &Frame::WORLD).expect("a ray");
                ray.slack *= part;
                ray.slabs = ray.slabs_with(ray.slack, 0.0);
                if !packet.takes(&ray) {
                    break;
                }
                packet.add(&ray);
                let fine = || [a, b, c].map(Vec3::as_dvec3);
                if let Some(hit) = intersect_triangle(&ray, &Sheared::new(&ray), [a, b, c], fine) {
                    packet.set_reach(i, hit.reach);
                    any = true;
                } else {
                    packet.set_reach(i, -1.0);
                }
            }
            let hull = [a, b, c].into_iter().fold(Box3::EMPTY, Box3::include);
            let hull = hull.pad(part * KERNEL_ULPS * ULP * hull.magnitude());
            if any {
                met += 1;
                missed += usize::from(dispatch(level, Met(&mut packet, &node_of(hull))).0 == 0);
            }
        }
        (met, missed)
    }

    #[test]
    fn bounds_of_a_packet_hold_the_hits_of_its_rays_and_would_not_without_slack() {
        for level in SimdLevel::available() {
            let (met, missed) = lost(1.0, level);
            assert!(met > 10_000, "{met}");
            assert_eq!(missed, 0, "{level}");
            assert!(lost(0.0, level).1 > 20, "{level}");
        }
    }

    #[test]
    fn rays_beside_a_box_are_told_apart_and_a_packet_far_from_it_misses_it() {
        let node = node_of(Box3 { min: Vec3::ZERO, max: Vec3::ONE });
        let rays: Vec<Ray> = (0..12).map(|i| Ray::new(Vec3::new(i as f32 * 0.25 - 0.9, 0.5, -1.0), Vec3::Z)).collect();
        let mut packet = Packet::empty();
        for ray in &rays {
            let ray = TreeRay::new(ray, &Frame::WORLD).expect("a ray");
            assert!(packet.takes(&ray));
            packet.add(&ray);
        }
        // Origins at -.9 + .25 i lie in [0, 1] for i from 4 to 7.
        let aside = node_of(Box3 { min: Vec3::new(0.0, 2.0, 0.0), max: Vec3::new(1.0, 3.0, 1.0) });
        for level in SimdLevel::available() {
            assert_eq!(dispatch(level, Met(&mut packet, &node)), (1, 0b1111_0000), "{level}");
            assert_eq!(dispatch(level, Met(&mut packet, &aside)), (0, 0), "{level}");
        }
        for lane in 4..8 {
            packet.set_reach(lane, 0.5);
        }
        assert_eq!(dispatch(SimdLevel::best(), Met(&mut packet, &node)).1, 0);
        let back = Ray::new(Vec3::ZERO, Vec3::NEG_Z);
        assert!(!packet.takes(&TreeRay::new(&back, &Frame::WORLD).expect("a ray")));
        assert_eq!(dispatch(SimdLevel::best(), Met(&mut Packet::empty(), &node)), (0, 0));
    }
}
