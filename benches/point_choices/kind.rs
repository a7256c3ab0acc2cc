//! Kinds of sets, and queries among their points.

use mbkd::glam::Vec3;
use mbkd::{MovingPoint, TimeInterval};
use mbkd_scenes::Random;

/// A kind of set.
pub struct Kind {
    pub name: &'static str,
    /// A point of it, given the mean spacing of points in the unit cube.
    pub point: fn(&mut Random, f32) -> MovingPoint,
}

/// Several times that are tried for a query before another point is taken: points exist for a hundredth of the shutter at least.
const TRIES: usize = 200;

impl Kind {
    pub fn points(&self, count: usize, seed: u64) -> Vec<MovingPoint> {
        let mut random = Random(seed);
        let spacing = (count as f32).cbrt().recip();
        (0..count).map(|_| (self.point)(&mut random, spacing)).collect()
    }
}

/// Places of points at times at which they exist: all times and points are equally likely.
pub fn queries(points: &[MovingPoint], count: usize, seed: u64) -> Vec<(Vec3, f32)> {
    let mut random = Random(seed ^ 0x5eed);
    let mut query = || {
        for _ in 0..TRIES {
            let point = &points[random.below(points.len())];
            let time = random.unit();
            if point.active.contains(time) {
                return (point.open.lerp(point.close, time), time);
            }
        }
        (points[0].open, points[0].active.begin())
    };
    (0..count).map(|_| query()).collect()
}

/// The interval of a life, as far as it is within the shutter.
pub fn life(begin: f32, duration: f32) -> TimeInterval {
    let begin = begin.clamp(0.0, 0.999);
    TimeInterval::new(begin, (begin + duration).clamp(begin + 0.0005, 1.0)).unwrap_or(TimeInterval::FULL)
}

/// A random vector with about the distribution of thermal velocities.
pub fn thermal(random: &mut Random) -> Vec3 {
    (random.vec() + random.vec() + random.vec() + random.vec()) * 0.87
}
