//! Sets of points with different motions, queries among them, and exact answers: the test data for comparing neighbour
//! searches.
//!
//! All numbers come from random integers and arithmetic that IEEE 754 specifies exactly, so sets have the same bits on
//! every machine.

use mbkd::glam::{DVec3, Vec3};
use mbkd::{MovingPoint, TimeInterval, morton_code};
use mbkd_scenes::Random;

/// The motion of the points of a set. The mean spacing is the side of a cube that holds one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// No motion.
    Still,
    /// Coherent motion: a rotating, stretching field that moves points by up to a tenth of the set.
    Coherent,
    /// Each point in its own direction, by up to this many spacings along each axis.
    Random(f32),
    /// One in twenty by up to twenty spacings along each axis, the others by up to a tenth of one.
    Mixed,
    /// Static points, each with an active interval of 2 to 10 % of the shutter.
    ShortLived,
}

/// The motions in reports and golden counts, by name.
pub const MOTIONS: [(&str, Motion); 5] = [
    ("still", Motion::Still),
    ("coherent", Motion::Coherent),
    ("random", Motion::Random(5.0)),
    ("mixed", Motion::Mixed),
    ("short-lived", Motion::ShortLived),
];

/// A position and a time.
pub type Query = (Vec3, f32);

/// The mean spacing of `n` points in the unit cube.
pub fn spacing(n: usize) -> f32 {
    1.0 / (n.max(1) as f32).cbrt()
}

/// A place on the surfaces of forty spheres of very different size.
pub fn on_surfaces(random: &mut Random) -> Vec3 {
    let mut of = Random(random.below(40) as u64);
    of.in_cube() + random.direction() * (0.01 + 0.2 * of.unit().powi(3))
}

/// `n` points that are in the unit cube when the shutter opens.
pub fn moving_points(motion: Motion, n: usize, seed: u64) -> Vec<MovingPoint> {
    let mut random = Random(seed);
    let spacing = spacing(n);
    let point = |_| {
        let at = random.in_cube();
        let aside = (random.in_cube() * 2.0 - 1.0) * spacing;
        let chance = random.unit();
        let displacement = match motion {
            Motion::Still | Motion::ShortLived => Vec3::ZERO,
            Motion::Coherent => Vec3::new(at.y - 0.5, 0.5 - at.x, 0.3 * at.z) * 0.14,
            Motion::Random(spacings) => aside * spacings,
            Motion::Mixed if chance < 0.05 => aside * 20.0,
            Motion::Mixed => aside * 0.1,
        };
        let point = MovingPoint::new(at, at + displacement);
        if motion != Motion::ShortLived {
            return point;
        }
        let begin = chance * 0.98;
        let end = (begin + 0.02 + 0.08 * random.unit()).min(1.0);
        point.with_active(TimeInterval::new(begin, end).unwrap_or(TimeInterval::FULL))
    };
    (0..n).map(point).collect()
}

/// The position of a point, in f32 and interpolated from the nearer end, as in trees of f32 points.
pub fn place(point: &MovingPoint, time: f32) -> Vec3 {
    let displacement = point.close - point.open;
    if time < 0.5 { point.open + displacement * time } else { point.close + displacement * (time - 1.0) }
}

/// The position of a point, rounded in f64 only.
pub fn exact_place(point: &MovingPoint, time: f32) -> DVec3 {
    let (open, close) = (point.open.as_dvec3(), point.close.as_dvec3());
    open + (close - open) * f64::from(time)
}

/// `count` queries near points of the set, each at its own time, in the order of a Morton curve, as a renderer or a
/// simulation would ask them.
pub fn queries(points: &[MovingPoint], count: usize, seed: u64) -> Vec<Query> {
    let mut random = Random(seed);
    let spacing = spacing(points.len());
    let mut queries: Vec<Query> = (0..count)
        .map(|_| {
            let time = random.unit();
            let near = place(&points[random.below(points.len())], time);
            (near + (random.in_cube() * 2.0 - 1.0) * (0.3 * spacing), time)
        })
        .collect();
    queries.sort_by_cached_key(|(at, _)| morton(*at));
    queries
}

/// The index along a Morton curve through the cube [-1, 2)³.
pub fn morton(at: Vec3) -> u64 {
    morton_code(((at + 1.0) * 341.0).clamp(Vec3::ZERO, Vec3::splat(1023.0)).as_uvec3().to_array())
}

/// The distances of the `k` nearest points that are active at a query's time, by testing every point in f64; nearest
/// first, fewer if there are fewer.
pub fn true_distances(points: &[MovingPoint], (at, time): Query, k: usize) -> Vec<f64> {
    let active = points.iter().filter(|point| point.active.contains(time));
    let mut squares: Vec<f64> = active.map(|point| exact_place(point, time).distance_squared(at.as_dvec3())).collect();
    if squares.len() > k && k > 0 {
        squares.select_nth_unstable_by(k - 1, f64::total_cmp);
    }
    squares.truncate(k);
    squares.sort_by(f64::total_cmp);
    squares.into_iter().map(f64::sqrt).collect()
}

/// The error of an answer relative to the true one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AnswerError {
    /// Entries of the answer that are no neighbours: missing, a point that is not active at the time, or one that is
    /// farther than the last true neighbour by more than the rounding of its position to f32 explains.
    pub wrong: usize,
    /// Mean over the entries of the excess distance relative to the true neighbour of the same rank; 1 for a missing
    /// entry.
    pub farther: f64,
}

/// Rounding of f32 positions in and around the unit cube, for both ends of a distance.
const ROUNDING: f64 = 4.0 / 16_777_216.0;

/// Compares the ids that a search returned with the distances from [`true_distances`].
pub fn judge(points: &[MovingPoint], (at, time): Query, found: &[u32], truth: &[f64]) -> AnswerError {
    let active = found.iter().map(|&id| &points[id as usize]).filter(|point| point.active.contains(time));
    let mut distances: Vec<f64> = active.map(|point| exact_place(point, time).distance(at.as_dvec3())).collect();
    distances.sort_by(f64::total_cmp);
    let Some(&last) = truth.last() else { return AnswerError { wrong: found.len(), farther: 0.0 } };
    let right = distances.iter().take(truth.len()).filter(|&&d| d <= last + ROUNDING).count();
    let farther = |(place, &exact): (usize, &f64)| match distances.get(place) {
        Some(&d) if d <= exact + ROUNDING => 0.0,
        Some(&d) => d / exact - 1.0,
        None => 1.0,
    };
    AnswerError {
        wrong: truth.len() - right,
        farther: truth.iter().enumerate().map(farther).sum::<f64>() / truth.len() as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mbkd::{PointParams, PointTree};

    #[test]
    fn exact_answers_are_right_and_others_are_not() {
        for (name, motion) in MOTIONS {
            let points = moving_points(motion, 2000, 1);
            let tree = PointTree::build(&points, &PointParams::default()).unwrap();
            for (at, time) in queries(&points, 50, 2) {
                let truth = true_distances(&points, (at, time), 8);
                let mut found: Vec<u32> = tree.nearest_n(at, time, 8).iter().map(|n| n.id).collect();
                assert_eq!(judge(&points, (at, time), &found, &truth), AnswerError::default(), "{name}");
                found.remove(0);
                let error = judge(&points, (at, time), &found, &truth);
                assert!(error.wrong == 1 && error.farther > 0.0, "{name}: {error:?}");
            }
        }
    }
}
