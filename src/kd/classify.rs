//! Classification of references against split planes: on which side an object is, and when.
//!
//! This is the core of the paper (section 3.1): an object that crosses the plane during the shutter is referenced on
//! each side for the time interval it spends there. The code is the same for triangles, spheres, custom
//! primitives and points: all of them have a linear [`AxisExtent`] along the plane's axis, and differ
//! in the rounding of the crossing times ([`Rounding`]).
//! Repeated at every plane of the descent, with the interval that results from the plane above, it is
//! the paper's duplication (section 3.1.1) and propagation (section 3.1.2) alike.

use crate::geometry::{AxisExtent, Line, Plane, TimeInterval};

/// The intervals during which an object is on each side of a plane; at least one is not `None`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sides {
    pub left: Option<TimeInterval>,
    pub right: Option<TimeInterval>,
}

/// The rounding of the times at which an object crosses a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rounding {
    /// Both intervals outward: for objects with an extent, which are on both sides for a while anyway.
    Outward,
    /// To the nearest float, which both intervals share: for points, which are on exactly one side at every time.
    ExactlyOnce,
}

/// Computes when an extent is below the plane and when above it.
#[inline]
pub(crate) fn classify(extent: AxisExtent, plane: Plane, rounding: Rounding) -> Sides {
    match rounding {
        Rounding::Outward => outward(extent, plane),
        Rounding::ExactlyOnce => exactly_once(extent.lower, extent.interval, plane),
    }
}

/// Signed distance to the plane at both ends of the interval.
fn distance(line: Line, interval: TimeInterval, plane: Plane) -> (f64, f64) {
    (line.begin - plane.at(interval.begin()), line.end - plane.at(interval.end()))
}

/// The time at which a linear distance is zero, given two different signs.
fn crossing(interval: TimeInterval, (d0, d1): (f64, f64)) -> f64 {
    f64::from(interval.begin()) + f64::from(interval.duration()) * (d0 / (d0 - d1))
}

/// The part of the interval in which a linear distance is negative, rounded outward.
///
/// The length of the interval is rounded to f32, by at most 2^-24 of itself, and so the computed crossing is less than one step of
/// f32 away from the true one (what f64 rounds is far less). Rounded to nearest it is at most one float above the first time behind
/// the true crossing and at least one below the last before it: a begin goes one step down, and an end, which is not held itself,
/// two up.
fn negative(interval: TimeInterval, d: (f64, f64)) -> Option<TimeInterval> {
    negative_by(interval, d, |t| t.next_down(), |t| t.next_up().next_up())
}

/// The same with given rounding functions for the begin and the end.
#[inline(always)]
fn negative_by(
    interval: TimeInterval,
    d: (f64, f64),
    down: impl Fn(f32) -> f32,
    up: impl Fn(f32) -> f32,
) -> Option<TimeInterval> {
    match (d.0 < 0.0, d.1 < 0.0) {
        (true, true) => Some(interval),
        (false, false) => None,
        (true, false) => {
            let end = up(crossing(interval, d) as f32);
            TimeInterval::half_open(interval.begin(), end.min(interval.end_bound()))
        }
        (false, true) => {
            let begin = down(crossing(interval, d) as f32);
            TimeInterval::half_open(begin.max(interval.begin()), interval.end_bound())
        }
    }
}

/// When an extent reaches below the plane and when above it, both rounded outward.
///
/// The left interval is {lower < plane}, the right one {upper > plane}; each is one interval because
/// the bounds are linear. An object that only touches the plane belongs to the other side alone, and one that lies in the
/// plane throughout to the left: a ray that crosses the plane visits both sides with slack.
fn outward(extent: AxisExtent, plane: Plane) -> Sides {
    let interval = extent.interval;
    let low = distance(extent.lower, interval, plane);
    let (high0, high1) = distance(extent.upper, interval, plane);
    let left = negative(interval, low);
    let right = negative(interval, (-high0, -high1));
    if left.is_none() && right.is_none() {
        return Sides { left: Some(interval), right: None };
    }
    // Between touching the plane from one side and from the other there may be instants that are on
    // neither side strictly: flat objects that cross, or bounds that shrink onto the plane. The intervals
    // then meet at a time that both include by outward rounding, except if one side is missing altogether.
    match (left, right) {
        (Some(l), None) if l != interval => Sides { left: Some(interval), right: None },
        (None, Some(r)) if r != interval => Sides { left: None, right: Some(interval) },
        (Some(l), Some(r)) => {
            // Close a gap in the middle, if any, by extending the left interval.
            let gap_between = l.end_bound() < r.begin();
            let gap_behind = r.end_bound() < l.begin();
            let left = if gap_between {
                TimeInterval::half_open(l.begin(), r.begin())
            } else if gap_behind {
                TimeInterval::half_open(r.end_bound(), l.end_bound())
            } else {
                left
            };
            Sides { left, right }
        }
        sides => Sides { left: sides.0, right: sides.1 },
    }
}

/// The sides of a moving point: two half-open intervals that share one crossing time, so that at
/// every time the point is on exactly one side.
///
/// A point in the plane is on the right. The crossing is one float, rounded to nearest: near it the point
/// may be an ulp on the wrong side, for which queries that cull by planes keep slack.
fn exactly_once(position: Line, interval: TimeInterval, plane: Plane) -> Sides {
    let d = distance(position, interval, plane);
    if (d.0 < 0.0) == (d.1 < 0.0) {
        return if d.0 < 0.0 {
            Sides { left: Some(interval), right: None }
        } else {
            Sides { left: None, right: Some(interval) }
        };
    }
    let at = crossing(interval, d) as f32;
    let before = TimeInterval::half_open(interval.begin(), at.min(interval.end_bound()));
    let after = TimeInterval::half_open(at.max(interval.begin()), interval.end_bound());
    if d.0 < 0.0 { Sides { left: before, right: after } } else { Sides { left: after, right: before } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const PLANE: Plane = Plane { axis: 0, position: 0.0, velocity: 0.0 };

    /// Times beside crossings, at which the distance is negative in whole numbers and which the interval found does not hold:
    /// those where it ends, and those where it begins.
    fn lost_beside_crossings(negative: impl Fn(TimeInterval, (f64, f64)) -> Option<TimeInterval>) -> [usize; 2] {
        // Times are whole multiples of 2^-40.
        const UNITS: f64 = (1u64 << 40) as f64;
        let mut random = Random(3);
        let mut next = |below: i64| (random.bits() >> 33) as i64 % below;
        let mut lost = [0, 0];
        for round in 0..40_000 {
            // Half of the intervals have a length that no f32 has.
            let (begin, end) = match round % 4 {
                0 | 1 => ((1 << 39) + (next(1 << 20) << 16), ((1 << 24) - next(1 << 20)) << 16),
                _ => ((1 << 23) + next(1 << 23), ((1 << 23) + next(1 << 18)) << 16),
            };
            let time = |units: i64| (units as f64 / UNITS) as f32;
            let interval = TimeInterval::new(time(begin), time(end)).expect("ordered");
            let (a, b) = (1 + next(1 << 20), 1 + next(1 << 20));
            let d = if round % 2 == 0 { (-a, b) } else { (a, -b) };
            let found = negative(interval, (d.0 as f64, d.1 as f64));
            let near = ((begin as f64 + (end - begin) as f64 * (a as f64 / (a + b) as f64)) / UNITS) as f32;
            for step in 0..7 {
                let t = f32::from_bits(near.to_bits() - 3 + step);
                let units = (f64::from(t) * UNITS) as i64;
                if time(units) != t || !(begin..=end).contains(&units) {
                    continue;
                }
                let distance =
                    i128::from(d.0) * i128::from(end - begin) + i128::from(d.1 - d.0) * i128::from(units - begin);
                let held = found.is_some_and(|i| i.contains(t));
                lost[round % 2] += usize::from(distance < 0 && !held);
            }
        }
        lost
    }

    #[test]
    fn intervals_hold_the_times_beside_their_crossing_and_would_not_without_steps() {
        assert_eq!(lost_beside_crossings(negative), [0, 0]);
        let with = |down: fn(f32) -> f32, up: fn(f32) -> f32| {
            lost_beside_crossings(|interval, d| negative_by(interval, d, down, up))
        };
        let less_by_a_step = with(|t| t, |t| t.next_up());
        assert!(less_by_a_step[0] > 50 && less_by_a_step[1] > 50, "{less_by_a_step:?}");
        let lost = with(|t| t, |t| t);
        assert!(lost[0] > 1000, "{lost:?}");
    }

    fn extent(interval: TimeInterval, lower: (f64, f64), upper: (f64, f64)) -> AxisExtent {
        let line = |(begin, end)| Line { begin, end };
        AxisExtent { interval, lower: line(lower), upper: line(upper) }
    }

    #[test]
    fn the_papers_eight_cases_and_the_still_ones() {
        let full = TimeInterval::FULL;
        let sides = |lower, upper| classify(extent(full, lower, upper), PLANE, Rounding::Outward);
        // Still: left, right, straddling throughout.
        assert_eq!(sides((-2.0, -2.0), (-1.0, -1.0)), Sides { left: Some(full), right: None });
        assert_eq!(sides((1.0, 1.0), (2.0, 2.0)), Sides { left: None, right: Some(full) });
        assert_eq!(sides((-1.0, -1.0), (1.0, 1.0)), Sides { left: Some(full), right: Some(full) });
        // From the left: comes to straddle, passes, straddles first, returns from behind mid-shutter; mirrored.
        for (lower, upper, left, right) in [
            ((-3.0, -1.0), (-1.0, 1.0), (0.0, 1.0), (0.5, 1.0)),
            ((-3.0, 1.0), (-2.0, 2.0), (0.0, 0.75), (0.5, 1.0)),
            ((-1.0, -3.0), (1.0, -1.0), (0.0, 1.0), (0.0, 0.5)),
            ((-1.0, 1.0), (0.0, 2.0), (0.0, 0.5), (0.0, 1.0)),
        ] {
            let got = sides(lower, upper);
            let (l, r) = (got.left.unwrap(), got.right.unwrap());
            for (interval, (begin, end)) in [(l, left), (r, right)] {
                assert!(interval.begin() <= begin && interval.begin() > begin - 1e-6, "{interval:?} {begin}");
                assert!(interval.end() >= end && interval.end() < end + 1e-6, "{interval:?} {end}");
            }
            let mirrored = sides((-upper.0, -upper.1), (-lower.0, -lower.1));
            assert_eq!((mirrored.left, mirrored.right), (got.right, got.left), "mirror of {lower:?} {upper:?}");
        }
    }

    #[test]
    fn what_lies_in_or_touches_the_plane_is_somewhere_at_every_time() {
        let full = TimeInterval::FULL;
        let cases = [
            ((0.0, 0.0), (0.0, 0.0)),
            ((0.0, 0.0), (0.0, 1.0)),
            ((-1.0, 0.0), (-1.0, 0.0)),
            ((-1.0, 0.0), (0.0, 0.0)),
            ((-1.0, 1.0), (-1.0, 1.0)),
            ((0.0, 1.0), (0.0, 1.0)),
            ((1.0, -1.0), (1.0, -1.0)),
        ];
        for (lower, upper) in cases {
            let sides = classify(extent(full, lower, upper), PLANE, Rounding::Outward);
            for i in 0..=1000 {
                let t = i as f32 / 1000.0;
                let inside = |side: Option<TimeInterval>| side.is_some_and(|s| s.contains(t));
                assert!(inside(sides.left) || inside(sides.right), "{lower:?} {upper:?} at {t}: {sides:?}");
            }
        }
    }

    #[test]
    fn intervals_cover_every_time_on_each_side() {
        let mut random = Random(9);
        let mut next = || (random.bits() >> 40) as f64 / (1 << 23) as f64 - 1.0;
        for _ in 0..20_000 {
            let (a, b) = (next().abs() as f32, next().abs() as f32);
            let Some(interval) = TimeInterval::half_open(a.min(b), a.max(b)) else { continue };
            let lower = (next(), next());
            let upper = (lower.0 + next().abs(), lower.1 + next().abs());
            let plane = Plane { axis: 1, position: 0.3 * next() as f32, velocity: next() as f32 };
            let e = extent(interval, lower, upper);
            let sides = classify(e, plane, Rounding::Outward);
            for i in 0..50 {
                let w = f64::from(i) / 50.0;
                let t = interval.begin() + interval.duration() * w as f32;
                if !interval.contains(t) {
                    continue;
                }
                let w = (f64::from(t) - f64::from(interval.begin())) / f64::from(interval.duration());
                let at = |l: Line| l.begin + (l.end - l.begin) * w;
                let holds = |side: Option<TimeInterval>| side.is_some_and(|s| s.contains(t));
                assert!(at(e.lower) >= plane.at(t) - 1e-12 || holds(sides.left), "{e:?} {plane:?} {t} {sides:?}");
                assert!(at(e.upper) <= plane.at(t) + 1e-12 || holds(sides.right), "{e:?} {plane:?} {t} {sides:?}");
            }
            let point = classify(AxisExtent { upper: e.lower, ..e }, plane, Rounding::ExactlyOnce);
            for i in 0..=50 {
                let t = interval.begin() + interval.duration() * (i as f32 / 50.0);
                let holds = |side: Option<TimeInterval>| side.is_some_and(|s| s.contains(t));
                let places = usize::from(holds(point.left)) + usize::from(holds(point.right));
                assert_eq!(places, usize::from(interval.contains(t)), "{point:?} at {t}");
            }
        }
    }
}
