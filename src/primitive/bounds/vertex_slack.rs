//! Bounds of the rounding of a triangle's vertices, interpolated between keys.

use crate::geometry::{TimeInterval, ULP};
use crate::primitive::triangles::triangle_set::Triangles;
use glam::Vec3;

impl Triangles {
    /// The largest distance of a kernel's vertex from the exactly interpolated one, if no coordinate of the vertex is larger
    /// than `magnitude` at the keys around its time.
    ///
    /// Counted in ULP of the magnitude: `b - a` is rounded at a size of at most 2 (error 2), then scaled
    /// by at most 1/2 (1 ULP) and rounded (1 ULP), then the sum is rounded (1 ULP): 3. With `n - 1 > 1`
    /// segments, `t * (n - 1)` is rounded too: at most (n - 1) ULP of a segment in time, and the vertex moves
    /// by at most 2 per segment. One ULP more covers the rounding of this bound and of a box that it is added to. (If
    /// numbers are denormal, sums are exact and a product errs by half the least number: queries keep more than that
    /// whatever the magnitude is.)
    pub(crate) fn slack(keys: usize, magnitude: f32) -> f32 {
        let ulps = match keys {
            1 => 0,
            2 => 4,
            n => 4 + 2 * (n - 1),
        };
        ulps as f32 * ULP * magnitude
    }

    /// The largest magnitude of a coordinate of a triangle's corners at the keys around all times of an interval, and
    /// around the times that these may be rounded to.
    pub(in crate::primitive) fn magnitude(&self, id: u32, over: TimeInterval) -> f32 {
        let keys = self.keys(id);
        let segments = (keys - 1) as f32;
        let first = ((over.begin() - ROUNDED_TIME).max(0.0) * segments) as usize;
        let last = (((over.end() + ROUNDED_TIME) * segments).ceil() as usize).min(keys - 1);
        let (stride, [a, b, c]) = (self.stride(id), self.vertices(id));
        let mut greatest = Vec3::ZERO;
        for offset in (first * stride..=last * stride).step_by(stride.max(1)) {
            // Each by itself: mapped arrays become calls.
            greatest = greatest.max(self.position(a, offset).abs());
            greatest = greatest.max(self.position(b, offset).abs());
            greatest = greatest.max(self.position(c, offset).abs());
        }
        greatest.max_element()
    }
}

/// An upper bound of the difference of times whose products with a number of segments are rounded to the same.
const ROUNDED_TIME: f32 = 4.0 * ULP;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::KeyTime;
    use crate::primitive::{PrimitiveSet, TriangleMesh};
    use crate::random::Random;

    /// The largest error of a kernel's vertex, in ULP of the largest coordinate around its time.
    /// Products and differences of f32 are exact in f64, or nearly.
    fn largest_error(keys: usize) -> f64 {
        let (mut random, mut worst) = (Random(5), 0.0f64);
        for _ in 0..200_000 {
            let t = random.unit();
            let (a, b) = (random.unit() * 2.0 - 1.0, random.unit() * 2.0 - 1.0);
            let at = KeyTime::new(t, keys);
            let kernel = f64::from(at.position(Vec3::splat(a), Vec3::splat(b)).x);
            let s = f64::from(t) * (keys - 1) as f64 - at.segment as f64;
            let exact = f64::from(a) + (f64::from(b) - f64::from(a)) * s;
            worst = worst.max((kernel - exact).abs() / f64::from(a.abs().max(b.abs())));
        }
        worst / f64::from(ULP)
    }

    #[test]
    fn the_slack_of_vertices_is_enough_and_has_to_grow_with_the_number_of_keys() {
        for keys in [2, 3, 4, 12, 100, 200, 1000] {
            let (error, slack) = (largest_error(keys), f64::from(Triangles::slack(keys, 1.0) / ULP));
            assert!(error <= slack, "{keys} keys: {error} of {slack} ULP");
            let without_growth = f64::from(Triangles::slack(2, 1.0) / ULP);
            assert!(error > 0.5 && (error > without_growth || keys < 12), "{keys} keys: {error} ULP");
        }
    }

    #[test]
    fn bounds_hold_the_kernels_corners_exactly_and_would_not_without_slack() {
        let (keys, mut random) = (2, Random(23));
        let mut lost = [0, 0];
        for _ in 0..300 {
            let mut point = || Vec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
            let positions: Vec<Vec<Vec3>> = (0..keys).map(|_| vec![point(); 3]).collect();
            let set = Triangles::new(&[TriangleMesh::new(vec![[0, 1, 2]], positions)]).unwrap();
            // Within one segment, where bounds are no chord around other keys.
            let segment = (random.unit() * (keys - 1) as f32) as usize;
            let key = |i: f32| (segment as f32 + i) / (keys - 1) as f32;
            let over = TimeInterval::half_open(key(0.1), key(0.9)).unwrap();
            let bounds = set.bounds(0, over);
            let slack = Triangles::slack(keys, set.magnitude(0, over));
            for _ in 0..50 {
                let t = over.begin() + over.duration() * random.unit();
                let w = f64::from(t - over.begin()) / f64::from(over.duration());
                let corner = set.corners(0, t)[0].as_dvec3();
                for (lost, pad) in lost.iter_mut().zip([0.0, slack]) {
                    let face = |a: Vec3, b: Vec3| a.as_dvec3().lerp(b.as_dvec3(), w);
                    let low = face(bounds.begin.min, bounds.end.min) + f64::from(pad);
                    let high = face(bounds.begin.max, bounds.end.max) - f64::from(pad);
                    *lost += usize::from(corner.cmplt(low).any() || corner.cmpgt(high).any());
                }
            }
        }
        assert!(lost[0] == 0 && lost[1] > 100, "{keys} keys: {lost:?}");
    }
}
