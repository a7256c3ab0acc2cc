//! The box of a placed tree in its own space, tested against rays before they enter the tree.
//!
//! The box around an instance is aligned to the axes of the world, so around a rotated tree it is wide, and most rays
//! that meet it miss the tree. In the instance's own space the box is tight, and whether the ray's line misses it
//! follows from origin and direction alone: a line and a box are disjoint exactly if they are separated along the cross
//! product of the line's direction and one of the axes (Gottschalk, Lin and Manocha, "OBBTree: A Hierarchical Structure
//! for Rapid Interference Detection", 1996).

use super::columns::{THREE, cross, magnitude};
use super::extent::{Extent, INNER_ULPS};
use super::motion::Inward;
use crate::geometry::ULP;
use crate::simd::Simd;
use glam::DVec3;

/// A box that moves linearly over the shutter: its centre, its half extent, and the change of both.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outline {
    middle: [f64; 4],
    moved: [f64; 4],
    half: [f64; 4],
    grown: [f64; 4],
}

impl Outline {
    /// The box of a tree, with this share of the padding for rounding: 1, or less in tests.
    ///
    /// Hits of trees of primitives lie within [`INNER_ULPS`] of their box. Those of trees of instances deviate more
    /// from far away, so their box holds everything.
    pub fn new(of: &Extent, padding: f64) -> Outline {
        let pad = if of.deviation == 0.0 { padding * INNER_ULPS * f64::from(ULP) * of.reach } else { EVERYTHING };
        let [begin, end] = [of.bounds.begin, of.bounds.end];
        let [from, to] = [begin, end].map(|b| (b.min * 0.5 + b.max * 0.5, b.max * 0.5 - b.min * 0.5));
        let lanes = |v: DVec3| v.extend(0.0).to_array();
        Outline {
            middle: lanes(from.0),
            moved: lanes(to.0 - from.0),
            half: lanes(from.1 + pad),
            grown: lanes(to.1 - from.1),
        }
    }

    /// Whether the whole line of a ray in this space misses the box as it is at a time.
    ///
    /// Origins are within 2^32 sizes (trees report no hits from farther away), so the error of this test is less than
    /// 2^-18 of the size, which the padding has room for.
    #[inline(always)]
    pub fn is_missed<S: Simd>(&self, s: S, ray: &Inward<S>, time: f32) -> bool {
        let time = s.splat_d(f64::from(time));
        let half = s.load_d(&self.half) + s.load_d(&self.grown) * time;
        let from = ray.origin - (s.load_d(&self.middle) + s.load_d(&self.moved) * time);
        let dir = s.widen_four(&ray.dir);
        let along = magnitude(s, dir);
        let distance = magnitude(s, cross(s, dir, from));
        let reach = s.rotate_left(half) * s.rotate_right(along) + s.rotate_right(half) * s.rotate_left(along);
        s.le_d(distance, reach) & THREE != THREE
    }
}

/// Half the size of a box that no ray misses. Its product with zero is zero.
const EVERYTHING: f64 = 1e300;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Aabb, LinearBounds, Ray};
    use crate::instance::columns::lanes;
    use crate::random::Random;
    use crate::simd::Portable;
    use glam::Vec3;

    fn is_missed(outline: &Outline, ray: &Ray) -> bool {
        let Vec3 { x, y, z } = ray.dir;
        let inward = Inward { origin: lanes(Portable, ray.origin), dir: [x, y, z, 0.0] };
        outline.is_missed(Portable, &inward, ray.time)
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
            let outline = Outline::new(&Extent { bounds, subtrees: vec![bounds], reach: 1.0, deviation: 0.0 }, 1.0);
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
            assert!(!is_missed(&outline, &ray), "{ray:?} {outline:?}");
            // Past the ball around the box.
            let radius = (now.max - now.min).length();
            let aside = along.as_dvec3().any_orthonormal_vector() * 1.1 * radius;
            let beside = Ray { origin: (now.min + now.max) * 0.5 - along.as_dvec3() * away + aside, ..ray };
            missed += usize::from(is_missed(&outline, &beside));
        }
        assert!(missed > 95_000, "{missed}");
    }
}
