//! Kinds of sets, and queries among their points.

use mbkd::glam::Vec3;
use mbkd::{MovingPoint, TimeInterval};
use mbkd_evidence::lcg::Lcg;

/// A kind of set.
pub struct Kind {
    pub name: &'static str,
    /// A point of it, given the mean spacing of points in the unit cube.
    pub point: fn(&mut Lcg, f32) -> MovingPoint,
}

/// Several times that are tried for a query before another point is taken: points exist for a hundredth of the shutter at least.
const TRIES: usize = 200;

impl Kind {
    pub fn points(&self, count: usize, seed: u64) -> Vec<MovingPoint> {
        let mut random = Lcg(seed);
        let spacing = (count as f32).cbrt().recip();
        (0..count).map(|_| (self.point)(&mut random, spacing)).collect()
    }
}

/// Places of points at times at which they exist: all times and points are equally likely.
pub fn queries(points: &[MovingPoint], count: usize, seed: u64) -> Vec<(Vec3, f32)> {
    let mut random = Lcg(seed ^ 0x5eed);
    let mut query = || {
        for _ in 0..TRIES {
            let point = &points[((random.unit() * points.len() as f32) as usize).min(points.len() - 1)];
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

/// The random numbers of one of several groups of points, the same for all of its points.
pub fn group(random: &mut Lcg, groups: u32) -> (u32, Lcg) {
    let number = ((random.unit() * groups as f32) as u32).min(groups - 1);
    let mut own = Lcg((u64::from(number) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    own.unit();
    (number, own)
}

/// A random vector with about the distribution of thermal velocities.
pub fn thermal(random: &mut Lcg) -> Vec3 {
    (random.signed() + random.signed() + random.signed() + random.signed()) * 0.87
}
