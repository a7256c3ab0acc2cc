//! The slab test: one ray against the sixteen boxes of a node (Kay and Kajiya, "Ray Tracing Complex Scenes", 1986).
//!
//! The faces of the boxes at the ray's time follow from the node's rows by one multiply-add per face. The ray meets a face `f` at
//! `(f - o) / d`. With `r = 1 / d`, computed once per ray, this is `f * r + (-o r -+ slack |r|)`: the constant term also grows the
//! box by the slack, at no cost per box.
//!
//! **Proof that no box is culled whose leaf would accept a hit.**
//!
//! - Along each axis the computed distance is `(f - o) r -+ slack |r|` up to four roundings relative to `(|f| + |o| + slack) |r|`:
//!   two products and the sum of the constant term, and the sum with the face's term, which is fused or has one product more. This
//!   is below 5 ULP of `(|f| + |o|) |r|`. The rounding of `r` itself (1 ULP) is the same in both terms.
//! - This error and the deviation of the triangle test ([`KERNEL_ULPS`](crate::geometry::KERNEL_ULPS)) grow with the coordinates of
//!   the primitive and with those of the origin. Boxes are padded for the first part when they are written; rays have slack for the
//!   second part. So a single distant vertex does not enlarge other boxes.
//! - The comparison is `<=`, so distances that tie with the limit are kept.
//! - A ray that begins behind its origin measures distances from its begin. Then no distance that matters is negative, and the bits
//!   of floats order like integers. This costs three more roundings, of sums with that begin; the slack of such a ray is larger for
//!   them.
//! - Everything stays finite: coordinates are below 2^102 and reciprocals at most 2^24.

use crate::simd::{LANES, Mask, Simd};
use crate::traverse::Faces;
use glam::{Vec3, Vec3A};

/// The data of a ray for the slab test, per axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slabs {
    /// Words from the first of an axis' two rows to the row of the near faces: zero, or one row if the direction is negative.
    pub(in crate::ray) near: [usize; 3],
    /// The reciprocal of each component of the direction; components that are too small are replaced by larger ones.
    pub inverse: Vec3A,
    pub(in crate::ray) near_offset: Vec3A,
    pub(in crate::ray) far_offset: Vec3A,
    /// An offset of all distances here, so that none that matters is negative; 0 for nearly all rays.
    shift: f32,
    /// The begin of the ray, with the offset.
    pub(in crate::ray) begin: f32,
    /// The time of the ray.
    time: f32,
}

impl Slabs {
    /// For a ray that begins at the distance `begin`, at most `behind` behind its origin. Boxes count as larger by `slack`.
    /// `inverse` is the reciprocal of the direction, except for components that are too small.
    #[inline(always)]
    pub fn new(
        (origin, dir, inverse): (Vec3A, Vec3, Vec3A),
        slack: f32,
        (begin, behind): (f32, f32),
        time: f32,
    ) -> Slabs {
        let at_origin = behind - origin * inverse;
        let pad = inverse.abs() * slack;
        Slabs {
            near: [backward(dir.x), backward(dir.y), backward(dir.z)],
            inverse,
            near_offset: at_origin - pad,
            far_offset: at_origin + pad,
            shift: behind,
            begin: begin + behind,
            time,
        }
    }

    /// The time of the ray.
    #[inline(always)]
    pub fn time(&self) -> f32 {
        self.time
    }

    /// How far behind its origin the ray begins; 0 if it begins at or in front of it.
    pub fn behind(&self) -> f32 {
        self.shift
    }

    /// A limit of distances, with the offset.
    #[inline(always)]
    fn limit(&self, limit: f32) -> f32 {
        limit + self.shift
    }

    /// The limit as a key for comparison with the keys of boxes, in which negative distances are stored as zero.
    #[inline(always)]
    pub fn key(&self, limit: f32) -> f32 {
        self.limit(limit).max(0.0)
    }

    /// The boxes that the ray meets no farther away than `reach`, and the distances at which it enters them.
    #[inline(always)]
    pub fn enter<S: Simd, const ROWS: usize>(&self, s: S, boxes: &impl Faces, reach: f32) -> (Mask, S::F) {
        let time = s.splat(self.time);
        // No closures: they would be compiled without the instruction set.
        let near = [
            face_distance::<S, ROWS, 0>(s, boxes, self.near[0], time, self.inverse.x, self.near_offset.x),
            face_distance::<S, ROWS, 1>(s, boxes, self.near[1], time, self.inverse.y, self.near_offset.y),
            face_distance::<S, ROWS, 2>(s, boxes, self.near[2], time, self.inverse.z, self.near_offset.z),
        ];
        let far = [
            face_distance::<S, ROWS, 0>(s, boxes, self.near[0] ^ LANES, time, self.inverse.x, self.far_offset.x),
            face_distance::<S, ROWS, 1>(s, boxes, self.near[1] ^ LANES, time, self.inverse.y, self.far_offset.y),
            face_distance::<S, ROWS, 2>(s, boxes, self.near[2] ^ LANES, time, self.inverse.z, self.far_offset.z),
        ];
        // All distances that matter are positive, where the bits of floats order like integers.
        let enter = s.max_signed(s.max_signed(near[0], near[1]), s.max_signed(near[2], s.splat(self.begin)));
        let limit = s.splat(self.limit(reach));
        let leave = s.min_signed(s.min_signed(far[0], far[1]), s.min_signed(far[2], limit));
        (s.le_signed(enter, leave), enter)
    }
}

/// The words of one row if the component is negative, else zero.
#[inline(always)]
fn backward(component: f32) -> usize {
    (component.to_bits() >> 31) as usize * LANES
}

/// The distances along the ray to one face of every box. In a node, the row of the face is `side` words after the first of the two
/// rows of the axis.
#[inline(always)]
fn face_distance<S: Simd, const ROWS: usize, const AXIS: usize>(
    s: S,
    boxes: &impl Faces,
    side: usize,
    time: S::F,
    inverse: f32,
    offset: f32,
) -> S::F {
    // The mask makes bounds checks unnecessary.
    let face = boxes.face::<S, ROWS>(s, 2 * AXIS * LANES + (side & LANES), time);
    s.mul_add(face, s.splat(inverse), s.splat(offset))
}

#[cfg(test)]
mod tests {
    use super::super::shear::Sheared;
    use super::super::tree_ray::{LEAST_COMPONENT, TreeRay};
    use crate::geometry::{Box3, Frame, KERNEL_ULPS, ULP};
    use crate::random::Random;
    use crate::ray::Ray;
    use crate::ray::traversal::intersect::intersect_triangle;
    use glam::Vec3;

    #[test]
    fn a_grown_slab_holds_the_exact_one() {
        for (o, d) in [(0.3f32, 0.9f32), (-7.0, -1e-3), (1e4, 1e-20), (0.0, -0.0), (0.1, -1.0)] {
            let ray = Ray::new(Vec3::new(0.0, o, 0.0), Vec3::new(1.0, d, 0.0));
            let frame = Frame { reach: 1e5, ..Frame::WORLD };
            let ray = TreeRay::new(&ray, &frame).unwrap();
            let slabs = &ray.slabs;
            let (low, high) = (-0.25f32, 0.5f32);
            let (near, far) = if slabs.near[1] == 0 { (low, high) } else { (high, low) };
            let enter = near.mul_add(slabs.inverse[1], slabs.near_offset[1]);
            let leave = far.mul_add(slabs.inverse[1], slabs.far_offset[1]);
            if d.abs() > LEAST_COMPONENT {
                let exact = |f: f32| (f64::from(f) - f64::from(o)) / f64::from(d);
                assert!(f64::from(enter) < exact(near) && f64::from(leave) > exact(far), "{o} {d}");
            } else {
                let inside = low <= o && o <= high;
                assert_eq!(enter < 1e5 && leave > -1e5 && enter < leave, inside, "{o} {d}");
            }
        }
    }

    /// Whether a ray hits a triangle, and if so, whether it misses the triangle's box when that is padded by `pad` times its size.
    fn hit_and_lost(ray: &TreeRay, corners: [Vec3; 3], pad: f32) -> (bool, bool) {
        let fine = || corners.map(Vec3::as_dvec3);
        let Some(hit) = intersect_triangle(ray, &Sheared::new(ray), corners, 0.0, fine) else { return (false, false) };
        let hull = corners.into_iter().fold(Box3::EMPTY, Box3::include);
        let hull = hull.pad(pad * hull.magnitude());
        let slabs = &ray.slabs;
        let (mut enter, mut leave) = (slabs.begin, slabs.limit(hit.reach));
        for axis in 0..3 {
            let (low, high) = (hull.min[axis], hull.max[axis]);
            let (near, far) = if slabs.near[axis] == 0 { (low, high) } else { (high, low) };
            enter = enter.max(near.mul_add(slabs.inverse[axis], slabs.near_offset[axis]));
            leave = leave.min(far.mul_add(slabs.inverse[axis], slabs.far_offset[axis]));
        }
        (true, enter > leave)
    }

    /// A triangle with one side on a face (or an edge) of its box, and a point on that side at which rays are aimed.
    fn aim(mut next: impl FnMut() -> f32, at_edge: bool) -> ([Vec3; 3], Vec3) {
        let mut point = || Vec3::new(next(), next(), next());
        let (a, mut b, c) = (point(), point(), point());
        b.x = a.x;
        if at_edge {
            b.y = a.y;
        }
        ([a, b, c], a + (b - a) * (0.5 + 0.5 * next()))
    }

    /// The number of hits of 200 000 rays that are lost if boxes are padded by `pad` times their size. `ray` makes a ray and a
    /// triangle; `slack` gives the slack that the slab test uses.
    fn lost(
        mut ray: impl FnMut(&mut dyn FnMut() -> f32) -> (Ray, [Vec3; 3]),
        slack: impl Fn(&TreeRay) -> f32,
        pad: f32,
    ) -> usize {
        let mut random = Random(31);
        let mut next = || random.signed();
        let (mut hits, mut lost) = (0, 0);
        for _ in 0..200_000 {
            let (original, corners) = ray(&mut next);
            let Some(mut ray) = TreeRay::new(&original, &Frame::WORLD) else { continue };
            ray.slabs = ray.slabs_with(slack(&ray), ray.slabs.behind());
            let (hit, missed) = hit_and_lost(&ray, corners, pad);
            hits += usize::from(hit);
            lost += usize::from(missed);
        }
        assert!(hits > 50_000, "{hits}");
        lost
    }

    /// The part of a ray's slack that is due to its origin.
    fn origin_slack(ray: &TreeRay) -> f32 {
        KERNEL_ULPS * ULP * ray.origin.into_iter().map(f32::abs).fold(0.0, f32::max)
    }

    /// The hits that are lost if the padding of boxes and the slack of rays are multiplied by `part`.
    fn hits_lost(part: f32) -> usize {
        let ray = |next: &mut dyn FnMut() -> f32| {
            let (corners, target) = aim(&mut *next, false);
            let origin = Vec3::new(next(), next(), next()) * 3.0;
            (Ray::new(origin, target - origin), corners)
        };
        lost(ray, |ray| ray.slack * part, KERNEL_ULPS * ULP * part)
    }

    /// The same for rays from far away whose slack is `part` times that for moving their origin to the scene, and nothing else.
    fn far_hits_lost(part: f32) -> usize {
        let ray = |next: &mut dyn FnMut() -> f32| {
            let (corners, target) = aim(&mut *next, true);
            let dir = Vec3::new(next(), next(), next());
            let origin = target.as_dvec3() - dir.as_dvec3() * (4e9 / f64::from(dir.abs().max_element()));
            (Ray::new(origin, dir), corners)
        };
        lost(ray, |ray| (ray.slack - origin_slack(ray)) * part, 0.0)
    }

    /// The same for lines through small triangles whose slack is `part` times that for beginning behind their origin, plus the
    /// slack for the origin.
    fn hits_of_lines_lost(part: f32) -> usize {
        let ray = |next: &mut dyn FnMut() -> f32| {
            let (corners, target) = aim(&mut *next, true);
            let origin = Vec3::new(next(), next(), next()) * 3e-4;
            // The factor 0.7 avoids `t = 1`, at which distances would be exact.
            let line = Ray::new(origin, (target * 1e-4 - origin) * 0.7).between(f32::NEG_INFINITY, f32::INFINITY);
            (line, corners.map(|corner| corner * 1e-4))
        };
        lost(ray, |ray| origin_slack(ray) + (ray.slack - origin_slack(ray)) * part, KERNEL_ULPS * ULP)
    }

    #[test]
    fn the_kernels_rounding_is_held_by_boxes_and_rays_together() {
        assert_eq!(hits_lost(1.0), 0);
        assert!(hits_lost(0.0) > 100);
    }

    #[test]
    fn what_is_lost_on_the_way_to_the_scene_is_held_and_would_not_be_without_slack() {
        assert_eq!(far_hits_lost(1.0), 0);
        assert!(far_hits_lost(0.0) > 100);
    }

    #[test]
    fn what_lines_lose_behind_their_origin_is_held_and_would_not_be_without_slack() {
        assert_eq!(hits_of_lines_lost(1.0), 0);
        assert!(hits_of_lines_lost(0.0) > 100);
    }
}
