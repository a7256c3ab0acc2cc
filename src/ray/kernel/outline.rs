//! The box of a whole tree at the ray's time, tested before anything else is computed for the ray.
//!
//! Most rays at a small mesh in the distance miss it, and so do most rays that are mapped into the space of an instance. Whether a
//! line misses a box follows from origin and direction alone, without a division: they are disjoint exactly if they are separated
//! along the cross product of the direction and one of the axes (Gottschalk, Lin and Manocha, "OBBTree: A Hierarchical Structure
//! for Rapid Interference Detection", 1996).
//!
//! **Proof that no ray is ruled out that hits.** Hits lie in the box, up to [`INNER_ULPS`], by which it is padded. If `o + t d`
//! lies in a box around zero with half extents `h`, then
//! `|o.y d.z - o.z d.y| = |(o + t d).y d.z - (o + t d).z d.y| <= h.y |d.z| + h.z |d.y|`, and so on for the other axes. In f64 both
//! sides are off by less than 2^-50 of the length of `o` times that of `d`. Trees report no hits of origins farther away than 2^32
//! sizes, so this is less than 2^-18 of the size, for which the padding has room.

use crate::geometry::{Aabb, Frame, LinearBounds, Ray, ULP};
use crate::simd::{Simd, THREE, cross, magnitude, vector_lanes};
use glam::{DVec3, Vec3A};

/// By how many ULP of the size of a tree its hits may lie outside of its box: the rounding of its kernel
/// ([`KERNEL_ULPS`](crate::geometry::KERNEL_ULPS) of the triangle and of an origin within 64 sizes, 1300 in all), and that of its
/// vertices, with a margin.
pub(crate) const INNER_ULPS: f64 = 1400.0;

/// A box that moves linearly over the shutter: its centre, its half extent, and the change of both.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outline {
    /// The origin of tree space in the world. Centres are relative to it, so that they are not rounded.
    origin: [f64; 4],
    middle: [f64; 4],
    moved: [f64; 4],
    half: [f64; 4],
    grown: [f64; 4],
    /// The box over the whole shutter, in tree space. Rays that begin in it are not tested.
    min: Vec3A,
    max: Vec3A,
}

/// Half the size of a box that no ray misses. Its product with zero is zero.
const EVERYTHING: f64 = 1e300;

impl Outline {
    /// The box that no ray misses.
    pub const EVERYTHING: Outline = Outline {
        origin: [0.0; 4],
        middle: [0.0; 4],
        moved: [0.0; 4],
        half: [EVERYTHING; 4],
        grown: [0.0; 4],
        min: Vec3A::NEG_INFINITY,
        max: Vec3A::INFINITY,
    };

    /// The outline of a tree of primitives with these bounds in tree space.
    pub fn new(bounds: &LinearBounds, frame: &Frame) -> Outline {
        Outline::padded(bounds, frame, 1.0)
    }

    /// [`Outline::new`] with this share of the padding for rounding: 1, or less in tests.
    fn padded(bounds: &LinearBounds, frame: &Frame, padding: f64) -> Outline {
        let pad = padding * INNER_ULPS * f64::from(ULP) * f64::from(frame.reach);
        let middle = |b: Aabb| b.min * 0.5 + b.max * 0.5;
        let half = |b: Aabb| b.max * 0.5 - b.min * 0.5;
        let LinearBounds { begin, end } = *bounds;
        let finite = |b: Aabb| b.min.is_finite() && b.max.is_finite() && b.min.cmple(b.max).all();
        if !(finite(begin) && finite(end)) {
            return Outline::EVERYTHING;
        }
        // The scale is a power of two, so nothing is rounded here.
        let lanes = |v: DVec3| (v / frame.scale).extend(0.0).to_array();
        Outline {
            origin: frame.origin.extend(0.0).to_array(),
            middle: lanes(middle(begin)),
            moved: lanes(middle(end) - middle(begin)),
            half: lanes(half(begin) + pad),
            grown: lanes(half(end) - half(begin)),
            min: begin.min.min(end.min).as_vec3a(),
            max: begin.max.max(end.max).as_vec3a(),
        }
    }

    /// Whether a ray misses everything in the tree. True for a ray with numbers that are not finite.
    #[inline(always)]
    pub fn is_missed<S: Simd>(&self, s: S, ray: &Ray, frame: &Frame) -> bool {
        let from = Vec3A::from(frame.point(ray.origin));
        let inside = (from.cmpge(self.min) & from.cmple(self.max)).all();
        !inside && self.is_missed_from(s, vector_lanes(s, ray.origin), s.widen(ray.dir.to_array()), ray)
    }

    /// The same for a ray with another origin and direction, wherever it begins.
    #[inline(always)]
    pub fn is_missed_from<S: Simd>(&self, s: S, origin: S::D, dir: S::D, ray: &Ray) -> bool {
        let time = s.splat_d(f64::from(ray.time));
        let half = s.load_d(&self.half) + s.load_d(&self.grown) * time;
        let middle = s.load_d(&self.middle) + s.load_d(&self.moved) * time;
        let from = (origin - s.load_d(&self.origin)) - middle;
        let along = magnitude(s, dir);
        let distance = magnitude(s, cross(s, dir, from));
        let reach = s.rotate_left(half) * s.rotate_right(along) + s.rotate_right(half) * s.rotate_left(along);
        s.le_d(distance, reach) & THREE != THREE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::BuildParams;
    use crate::primitive::TriangleMesh;
    use crate::random::Random;
    use crate::ray::RayTree;
    use crate::simd::{Kernel, SimdLevel, dispatch};
    use glam::Vec3;

    struct Of<'a>(&'a Outline, &'a Ray, &'a Frame);

    impl Kernel for Of<'_> {
        type Output = bool;

        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> bool {
            self.0.is_missed(s, self.1, self.2)
        }
    }

    /// The answer of all instruction sets.
    fn is_missed(outline: &Outline, ray: &Ray, frame: &Frame) -> bool {
        let each: Vec<bool> =
            SimdLevel::available().into_iter().map(|level| dispatch(level, Of(outline, ray, frame))).collect();
        assert!(each.iter().all(|&missed| missed == each[0]), "{ray:?} {outline:?}");
        each[0]
    }

    #[test]
    fn rays_at_the_moving_box_do_not_miss_it_and_most_others_do() {
        let (mut random, mut missed) = (Random(3), 0);
        for round in 0..100_000 {
            let mut corners = || {
                let (a, b) = (random.vec().as_dvec3(), random.vec().as_dvec3());
                Aabb { min: a.min(b), max: a.max(b) }
            };
            let bounds = LinearBounds { begin: corners(), end: corners() };
            let outline = Outline::new(&bounds, &Frame::WORLD);
            let time = random.unit();
            let now = bounds.at(f64::from(time));
            // Corners among them, and directions along axes.
            let mut inside = now.min + (now.max - now.min) * (random.vec().as_dvec3() * 0.5 + 0.5);
            if round % 3 == 0 {
                inside = DVec3::new(now.min.x, now.max.y, now.min.z);
            }
            let along = if round % 5 == 0 { Vec3::X } else { random.vec() };
            let away = 10f64.powf(4.0 * f64::from(random.signed()));
            let ray = Ray::new(inside - along.as_dvec3() * away, along).at_time(time);
            assert!(!is_missed(&outline, &ray, &Frame::WORLD), "{ray:?} {outline:?}");
            // Past the ball around the box, from outside of the box over the whole shutter.
            let radius = (now.max - now.min).length();
            let aside = along.as_dvec3().any_orthonormal_vector() * 1.1 * radius;
            let beside = Ray { origin: (now.min + now.max) * 0.5 - along.as_dvec3() * away + aside, ..ray };
            let outside = beside.origin.abs().max_element() > 1.0;
            missed += usize::from(!outside || is_missed(&outline, &beside, &Frame::WORLD));
        }
        assert!(missed > 95_000, "{missed}");
    }

    /// A mesh of triangles with a side each on an edge of the box around all, far from the origin of the world.
    fn on_an_edge(moving: bool) -> TriangleMesh {
        let (mut random, mut corners) = (Random(5), Vec::new());
        for _ in 0..60 {
            let inside = random.vec();
            corners.extend([Vec3::new(-1.0, -1.0, random.signed()), Vec3::new(-1.0, -1.0, random.signed()), inside]);
        }
        let corners: Vec<DVec3> = corners.into_iter().map(|p| p.as_dvec3() + DVec3::splat(1e8)).collect();
        let indices = (0..60).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let later = corners.iter().map(|&p| p + DVec3::X).collect();
        TriangleMesh::new(indices, if moving { vec![corners, later] } else { vec![corners] })
    }

    /// Of rays that hit triangles along an edge of the box, those that hit and those of them that are ruled out, with this share of
    /// the padding of boxes and rays.
    fn hit_and_lost(moving: bool, padding: f64) -> (usize, usize) {
        let mesh = on_an_edge(moving);
        let tree = RayTree::build(core::slice::from_ref(&mesh), &BuildParams::default()).expect("a tree");
        let frame = tree.frame();
        let mut outline = *tree.outline();
        // The least box of the triangles at both ends of the shutter.
        if padding == 0.0 {
            let at = |time: f32| {
                let all = (0..60).flat_map(|i| tree.triangle(0, i, time)).map(|p| frame.fine_point(p));
                all.fold(Aabb::EMPTY, |all, p| Aabb { min: all.min.min(p), max: all.max.max(p) })
            };
            outline = Outline::padded(&LinearBounds { begin: at(0.0), end: at(1.0) }, frame, 0.0);
        }
        let (mut random, mut hits, mut lost) = (Random(9), 0, 0);
        for _ in 0..20_000 {
            let triangle = (random.unit() * 60.0) as u32;
            // A number of few bits, at which corners are exact.
            let time = if moving { (random.unit() * 64.0).round() / 64.0 } else { 0.0 };
            let [a, b, _] = tree.triangle(0, triangle, time);
            let target = a.lerp(b, f64::from(random.unit()));
            let dir = random.vec() * 40.0;
            let ray = Ray::new(target - dir.as_dvec3(), dir).at_time(time);
            let hit = tree.closest_hit(&ray).is_some();
            hits += usize::from(hit);
            lost += usize::from(hit && is_missed(&outline, &ray, frame));
        }
        (hits, lost)
    }

    #[test]
    fn no_ray_that_hits_is_ruled_out_and_some_would_be_without_padding() {
        for moving in [false, true] {
            let (hits, lost) = hit_and_lost(moving, 1.0);
            assert!(hits > 5_000 && lost == 0, "{moving}: {lost} of {hits}");
            let (_, lost) = hit_and_lost(moving, 0.0);
            assert!(lost > 3, "{moving}: {lost}");
        }
    }

    #[test]
    fn nothing_misses_everything() {
        let wide = Aabb { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
        let outlines = [
            Outline::EVERYTHING,
            Outline::new(&LinearBounds::fixed(Aabb::EMPTY), &Frame::WORLD),
            Outline::new(&LinearBounds::fixed(wide), &Frame::WORLD),
        ];
        for outline in outlines {
            for ray in [Ray::new(Vec3::ZERO, Vec3::X), Ray::new(Vec3::splat(1e30), Vec3::new(0.0, -0.0, 1e-40))] {
                assert!(!is_missed(&outline, &ray, &Frame::WORLD));
            }
        }
    }
}
