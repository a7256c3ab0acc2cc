//! Two points passing each other.

use crate::point::over_interval::Flight;

/// A time at which two points are as close as they come, and when they are within the radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encounter {
    /// The other point.
    pub id: u32,
    /// The first time within the radius.
    pub enter: f32,
    /// The last time within the radius. Between keys the two stay within the radius from the first to the last; over
    /// several keys, or if one of them does not exist for a while, they may part in between.
    pub leave: f32,
    /// When they are nearest; the first such time.
    pub closest: f32,
    /// The squared distance then.
    pub distance_squared: f32,
}

impl Encounter {
    /// Both encounters of the same points as one.
    pub(super) fn and(self, other: Encounter) -> Encounter {
        let key = |e: &Encounter| (e.distance_squared.to_bits(), e.closest.to_bits());
        let nearest = if key(&other) < key(&self) { other } else { self };
        Encounter { enter: self.enter.min(other.enter), leave: self.leave.max(other.leave), ..nearest }
    }
}

/// The time that is looked at: a part of a segment between keys.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    /// Number of keys, at least 2, and the earlier key of the segment.
    pub(super) keys: usize,
    pub(super) segment: usize,
    /// First and last time.
    pub(super) times: [f64; 2],
}

impl Window {
    /// The part of `[begin, end]` in a segment.
    pub(super) fn of_segment(keys: usize, segment: usize, [begin, end]: [f64; 2]) -> Window {
        let segments = (keys.max(2) - 1) as f64;
        let ends = [segment as f64 / segments, (segment + 1) as f64 / segments];
        Window { keys, segment, times: [begin.max(ends[0]), end.min(ends[1])] }
    }

    /// Where in the segment a time lies, in [0, 1].
    pub(super) fn phase(&self, time: f64) -> f64 {
        (time * (self.keys.max(2) - 1) as f64 - self.segment as f64).clamp(0.0, 1.0)
    }

    /// The encounter of two points within the window, if they come as near as `square`, the squared radius.
    ///
    /// Seen from `a`, `b` is on a straight way `first + w·passing`, w in [0, 1]: its squared distance is a parabola.
    /// Every step is symmetric, so both points see the same. Times are where the parabola is at its lowest and where it
    /// crosses the squared radius.
    pub(super) fn encounter(&self, a: &Flight, b: &Flight, square: f64) -> Option<Encounter> {
        let lives = [a.life, b.life];
        let begin = lives.iter().fold(self.times[0], |time, life| time.max(life.begin().into()));
        let end = lives.iter().fold(self.times[1], |time, life| time.min(life.end().into()));
        if begin > end {
            return None;
        }
        let [first, last] = [begin, end].map(|time| {
            let phase = self.phase(time);
            core::array::from_fn(|axis| at(b, axis, phase) - at(a, axis, phase))
        });
        let passing: [f64; 3] = core::array::from_fn(|axis| last[axis] - first[axis]);
        let (speed, approach) = (dot(passing, passing), -dot(first, passing));
        let nearest_at = if speed > 0.0 { (approach / speed).clamp(0.0, 1.0) } else { 0.0 };
        let nearest: [f64; 3] = core::array::from_fn(|axis| first[axis] + passing[axis] * nearest_at);
        let distance = dot(nearest, nearest);
        if distance > square {
            return None;
        }
        let outside = dot(first, first) - square;
        let root = (approach * approach - speed * outside).max(0.0).sqrt();
        // The smaller root without cancellation; `approach` is above zero where the way begins outside.
        let enter = if outside <= 0.0 { 0.0 } else { (outside / (approach + root)).clamp(0.0, nearest_at) };
        let leave = if dot(last, last) <= square { 1.0 } else { ((approach + root) / speed).clamp(nearest_at, 1.0) };
        let time = |w: f64| (begin + (end - begin) * w) as f32;
        Some(Encounter {
            id: b.id,
            enter: time(enter),
            leave: time(leave),
            closest: time(nearest_at),
            distance_squared: distance as f32,
        })
    }
}

/// A coordinate at a phase of the segment.
pub(super) fn at(flight: &Flight, axis: usize, phase: f64) -> f64 {
    let (open, close) = (flight.open[axis], flight.close[axis]);
    open + (close - open) * phase
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}
