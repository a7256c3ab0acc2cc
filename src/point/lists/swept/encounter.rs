//! Two points passing each other.

use crate::geometry::TimeInterval;
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
#[derive(Clone, Copy, Debug, PartialEq)]
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
    #[inline(always)]
    pub(super) fn phase(&self, time: f64) -> f64 {
        lesser(greater(time * (self.keys.max(2) - 1) as f64 - self.segment as f64, 0.0), 1.0)
    }

    /// When two points that live from begin to end can meet in the window: begin, and end, which may lie before it.
    #[inline(always)]
    fn common(&self, a: [f32; 2], b: [f32; 2]) -> [f64; 2] {
        let begin = greater(greater(self.times[0], a[0].into()), b[0].into());
        // Lives that reach the end of the shutter have an end beyond it.
        [begin, lesser(lesser(lesser(self.times[1], 1.0), a[1].into()), b[1].into())]
    }

    /// The encounters of a point with those that come as near as `square`, the squared radius, in the window.
    ///
    /// Seen from the point, another is on a straight way `first + w·passing`, w in [0, 1]: its squared distance is a
    /// parabola. Every step is symmetric, so both points see the same. Times are where the parabola is at its lowest and
    /// where it crosses the squared radius. (Plain loops over lanes, which the compiler makes vectors of, with the same
    /// bits on every instruction set.)
    #[inline(always)]
    pub(super) fn encounters(
        &self,
        own: &Flight,
        others: &Others,
        square: f64,
        mut found: impl FnMut(usize, Encounter),
    ) {
        let life = [own.life.begin(), own.life.end_bound()];
        for base in (0..others.len).step_by(WIDE) {
            let at = |rows: &Vec<f32>, lane: usize| f64::from(rows[base + lane]);
            let (mut begin, mut end) = ([0.0; WIDE], [0.0; WIDE]);
            let (mut first, mut last) = ([[0.0; WIDE]; 3], [[0.0; WIDE]; 3]);
            for lane in 0..WIDE {
                let other = [others.begin[base + lane], others.end[base + lane]];
                [begin[lane], end[lane]] = self.common(life, other);
            }
            let (mut early, mut late) = ([0.0; WIDE], [0.0; WIDE]);
            for lane in 0..WIDE {
                (early[lane], late[lane]) = (self.phase(begin[lane]), self.phase(end[lane]));
            }
            for axis in 0..3 {
                let (open, close) = (own.open[axis], own.close[axis]);
                for lane in 0..WIDE {
                    let (other, way) = (at(&others.open[axis], lane), at(&others.close[axis], lane));
                    let way = way - other;
                    first[axis][lane] = (other + way * early[lane]) - (open + (close - open) * early[lane]);
                    last[axis][lane] = (other + way * late[lane]) - (open + (close - open) * late[lane]);
                }
            }
            let (mut enter, mut leave, mut nearest_at) = ([0.0; WIDE], [0.0; WIDE], [0.0; WIDE]);
            let mut distance = [0.0; WIDE];
            for lane in 0..WIDE {
                let [first, last] = [&first, &last].map(|rows| [rows[0][lane], rows[1][lane], rows[2][lane]]);
                let passing = [last[0] - first[0], last[1] - first[1], last[2] - first[2]];
                let (speed, approach) = (dot(passing, passing), -dot(first, passing));
                let w = if speed > 0.0 { lesser(greater(approach / speed, 0.0), 1.0) } else { 0.0 };
                let nearest = [first[0] + passing[0] * w, first[1] + passing[1] * w, first[2] + passing[2] * w];
                let outside = dot(first, first) - square;
                let root = greater(approach * approach - speed * outside, 0.0).sqrt();
                // The smaller root without cancellation; `approach` is above zero where the way begins outside.
                let entering = lesser(greater(outside / (approach + root), 0.0), w);
                let leaving = lesser(greater((approach + root) / speed, w), 1.0);
                enter[lane] = if outside <= 0.0 { 0.0 } else { entering };
                leave[lane] = if dot(last, last) <= square { 1.0 } else { leaving };
                (nearest_at[lane], distance[lane]) = (w, dot(nearest, nearest));
            }
            let time = |w: f64, lane: usize| (begin[lane] + (end[lane] - begin[lane]) * w) as f32;
            for lane in 0..WIDE.min(others.len - base) {
                if begin[lane] <= end[lane] && distance[lane] <= square {
                    let encounter = Encounter {
                        id: others.id[base + lane],
                        enter: time(enter[lane], lane),
                        leave: time(leave[lane], lane),
                        closest: time(nearest_at[lane], lane),
                        distance_squared: distance[lane] as f32,
                    };
                    found(base + lane, encounter);
                }
            }
        }
    }
}

/// Points that are looked at side by side.
pub(super) const WIDE: usize = 8;

/// Points that may meet another, in rows of which the first `len` places are in use.
#[derive(Clone, Debug, Default)]
pub(super) struct Others {
    pub(super) open: [Vec<f32>; 3],
    pub(super) close: [Vec<f32>; 3],
    /// The whole life, up to where it is not over yet.
    pub(super) begin: Vec<f32>,
    pub(super) end: Vec<f32>,
    pub(super) id: Vec<u32>,
    pub(super) len: usize,
}

impl Others {
    /// Makes all rows at least this long.
    pub(super) fn make_room(&mut self, length: usize) {
        if self.id.len() < length {
            let length = 2 * length;
            let rows = self.open.iter_mut().chain(&mut self.close).chain([&mut self.begin, &mut self.end]);
            rows.for_each(|row| row.resize(length, 0.0));
            self.id.resize(length, u32::MAX);
        }
    }

    /// A point of them.
    pub(super) fn flight(&self, i: usize) -> Flight {
        let life = TimeInterval::half_open(self.begin[i], self.end[i]);
        Flight {
            id: self.id[i],
            open: [0, 1, 2].map(|axis| self.open[axis][i].into()),
            close: [0, 1, 2].map(|axis| self.close[axis][i].into()),
            life: life.unwrap_or(TimeInterval::FULL),
        }
    }
}

/// The greater; one instruction, which takes no care of NaN.
#[inline(always)]
pub(super) fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The lesser, likewise.
#[inline(always)]
pub(super) fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// A coordinate at a phase of the segment.
pub(super) fn at(flight: &Flight, axis: usize, phase: f64) -> f64 {
    let (open, close) = (flight.open[axis], flight.close[axis]);
    open + (close - open) * phase
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}
