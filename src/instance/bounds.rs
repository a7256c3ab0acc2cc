//! Linear bounds of a tree placed by a moving transform.
//!
//! The placed tree lies in boxes that move linearly in its own space. At a time, each corner `x` of the box of that
//! time is mapped to a corner `T + M x` in the outer space, and the image of the tree lies in the box around all of
//! them. Between two successive breakpoints ([`Motions::breakpoints`]) every corner stays within a known distance of its chord
//! ([`Bend::bulge`]), and the chord stays inside the linear interpolation of the boxes at both breakpoints. So the linear
//! interpolation between the boxes at the ends of an interval, moved outward until it holds the boxes at all breakpoints,
//! and then by the greatest of the distances, holds the image.
//!
//! [`Bend::bulge`]: super::motion::Bend::bulge

use super::distortion::abs;
use super::motion::{Motion, Motions};
use crate::geometry::{Aabb, LinearBounds, TimeInterval};
use glam::{DAffine3, DVec3};

impl Motions {
    /// Linear bounds over an interval of a placed tree whose subtrees have the bounds `of` over the shutter in its own space.
    /// `bulge` scales the distances from chords: 1, or less in tests. `rounding` is what the image of a point is off, relative to
    /// the numbers that make it.
    pub fn bounds(
        &self,
        motion: &Motion,
        of: &[LinearBounds],
        over: TimeInterval,
        (bulge, rounding): (f64, f64),
    ) -> LinearBounds {
        let (begin, end) = (f64::from(over.begin()), f64::from(over.end()));
        let moves = of.iter().any(|of| of.begin != of.end);
        let boxes = |time: f64| of.iter().map(move |of| if moves { of.at(time) } else { of.begin });
        let at = |time: f64| {
            let matrix = self.matrix(motion, time);
            boxes(time).map(|of| image(matrix, of)).fold(Aabb::EMPTY, Aabb::union)
        };
        let mut bounds = LinearBounds::fixed(at(begin));
        if begin == end || of.is_empty() {
            return bounds;
        }
        let (mut beyond, mut times) = (DVec3::ZERO, vec![begin]);
        if moves || !matches!(motion, Motion::Static { .. }) {
            bounds.end = at(end);
            times = self.breakpoints(motion, begin, end);
            for &time in &times[1..times.len() - 1] {
                bounds.include((time - begin) / (end - begin), at(time));
            }
            beyond = self.beyond_chords(motion, of, &times) * bulge;
        }
        // Many times the rounding error of f64 here, and of the origins of rays that are mapped into the own space. Where the
        // translation cancels what the matrix makes of a distant tree, both are larger than the bounds; and a rotation mixes the
        // axes.
        let size = |&time: &f64| {
            let DAffine3 { matrix3, translation } = self.matrix(motion, time);
            (translation.abs() + abs(matrix3) * farthest(of, time)).max_element()
        };
        let beyond = beyond + DVec3::splat(times.iter().map(size).fold(0.0, f64::max) * rounding);
        LinearBounds { begin: grow(bounds.begin, beyond), end: grow(bounds.end, beyond) }
    }

    /// The greatest distance per axis between any point of the subtrees and the chords of its path between successive
    /// times.
    fn beyond_chords(&self, motion: &Motion, of: &[LinearBounds], times: &[f64]) -> DVec3 {
        let moves = of.iter().any(|of| of.begin != of.end);
        let (mut from, mut beyond) = (farthest(of, times[0]), DVec3::ZERO);
        for pair in times.windows(2) {
            let (mut to, mut moved) = (from, DVec3::ZERO);
            if moves {
                to = farthest(of, pair[1]);
                moved = of.iter().map(|of| farthest_move(of, pair[1] - pair[0])).fold(DVec3::ZERO, DVec3::max);
            }
            beyond = beyond.max(self.bend(motion, [pair[0], pair[1]]).bulge(from.max(to), moved));
            from = to;
        }
        beyond
    }
}

/// The greatest coordinates of the boxes at a time.
fn farthest(of: &[LinearBounds], time: f64) -> DVec3 {
    of.iter().map(|of| of.at(time)).map(|b| b.min.abs().max(b.max.abs())).fold(DVec3::ZERO, DVec3::max)
}

/// The greatest distance per axis that a corner of a box moves in this fraction of the shutter.
fn farthest_move(of: &LinearBounds, during: f64) -> DVec3 {
    (of.end.min - of.begin.min).abs().max((of.end.max - of.begin.max).abs()) * during
}

/// Bound on the relative rounding error in f64, with a wide margin, unless the determinant is small ([`MAPPED`]).
///
/// [`MAPPED`]: super::distortion::MAPPED
pub(super) const ROUNDING: f64 = 1e-12;

/// The box grown by as much per axis on either side.
pub(super) fn grow(b: Aabb, by: DVec3) -> Aabb {
    Aabb { min: b.min - by, max: b.max + by }
}

/// The greatest coordinate of a box relative to a point.
pub(super) fn greatest_offset(b: Aabb, from: DVec3) -> f64 {
    (b.max - from).max(from - b.min).max_element()
}

/// The least axis-aligned box around the image of a box.
fn image(matrix: DAffine3, of: Aabb) -> Aabb {
    let (mut min, mut max) = (matrix.translation, matrix.translation);
    let columns = [matrix.matrix3.x_axis, matrix.matrix3.y_axis, matrix.matrix3.z_axis];
    for (axis, column) in columns.into_iter().enumerate() {
        let (a, b) = (column * of.min[axis], column * of.max[axis]);
        min += a.min(b);
        max += a.max(b);
    }
    Aabb { min, max }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instance::{Pose, Transform};
    use crate::random::Random;
    use glam::DQuat;

    fn transforms(random: &mut Random, keys: usize) -> [Transform; 2] {
        let poses: Vec<Pose> = (0..keys)
            .map(|_| Pose {
                scale: (random.dvec() * 0.5 + 1.0) * 10f64.powf(3.0 * random.signed_f64()),
                rotation: DQuat::from_axis_angle(random.dvec().normalize(), 3.1 * random.signed_f64()),
                translation: random.dvec() * 5.0,
            })
            .collect();
        let begin = poses[0].matrix();
        let matrices = (0..keys).map(|_| {
            let mut matrix = begin;
            matrix.matrix3.x_axis += random.dvec() * 0.1 * matrix.matrix3.x_axis.length();
            matrix.matrix3.z_axis += random.dvec() * 0.1 * matrix.matrix3.z_axis.length();
            matrix.translation += random.dvec();
            matrix
        });
        [matrices.collect::<Vec<_>>().into(), poses.into()]
    }

    /// Counts points of moving boxes outside of their bounds, with this share of the bulge: for matrices, for poses.
    fn outside(bulge: f64) -> [usize; 2] {
        let (mut outside, mut random) = ([0, 0], Random(1));
        for round in 0..1500 {
            for (kind, transform) in transforms(&mut random, 2 + round % 4).into_iter().enumerate() {
                let mut motions = Motions::default();
                let (motion, _) = motions.add(&transform, 0).unwrap();
                let (low, size, by) = (random.dvec(), random.dvec().abs(), random.dvec() * 0.7);
                let begin_box = Aabb { min: low, max: low + size };
                let first = LinearBounds { begin: begin_box, end: Aabb { min: low + by, max: low + by + size } };
                let beside = random.dvec();
                let second = Aabb { min: beside, max: beside + size * 0.5 };
                let of = [first, LinearBounds::fixed(second)];
                let of = if round % 2 == 0 { &of[..] } else { &of[..1] };
                let (a, b) = (random.signed_f64().abs() as f32, random.signed_f64().abs() as f32);
                let over =
                    if round % 3 == 0 { TimeInterval::FULL } else { TimeInterval::new(a.min(b), a.max(b)).unwrap() };
                let bounds = motions.bounds(&motion, of, over, (bulge, ROUNDING));
                for i in 0..=40 {
                    let w = f64::from(i) / 40.0;
                    let (begin, end) = (f64::from(over.begin()), f64::from(over.end()));
                    let time = begin + w * (end - begin);
                    let (matrix, bounds) = (motions.matrix(&motion, time), bounds.at(w));
                    let corners = of.iter().map(|of| of.at(time)).flat_map(|inner| {
                        (0..8).map(move |corner| {
                            DVec3::from([0, 1, 2].map(|axis| match corner >> axis & 1 {
                                0 => inner.min[axis],
                                _ => inner.max[axis],
                            }))
                        })
                    });
                    outside[kind] +=
                        corners.filter(|&corner| !bounds.contains(matrix.transform_point3(corner))).count();
                }
            }
        }
        outside
    }

    #[test]
    fn bounds_hold_placed_boxes_and_would_not_without_the_bulge() {
        assert_eq!(outside(1.0), [0, 0]);
        let lost = outside(0.0);
        assert!(lost[0] > 100 && lost[1] > 1000, "the bulge is not needed: {lost:?}");
    }
}
