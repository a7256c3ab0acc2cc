//! The closest approach of a moving point to a moving query, exactly.
//!
//! Between two keys both move linearly, so the squared distance is a parabola in time with exact coefficients; its
//! least value on a segment is a quotient.

use super::{Dyadic, Given, Moving, Ratio, Vector, ulp32};
use core::cmp::Ordering;
use mbkd::TimeInterval;
use mbkd::glam::DVec3;

/// The time and the distance of a closest approach.
#[derive(Clone, Debug)]
pub struct ExactApproach {
    /// The first time of the least distance.
    pub time: Ratio,
    /// The least squared distance.
    pub squared: Ratio,
    /// How far the squared distance moves when all input has an error of half an ulp.
    pub doubt: f64,
    /// How far the time moves then.
    pub time_doubt: f64,
}

impl ExactApproach {
    /// The unit of errors for a computed square: the doubt, and half an ulp of f32 for rounding.
    pub fn unit(&self) -> f64 {
        self.doubt + ulp32(self.squared.to_f64()) / 2.0
    }
}

/// The closest approach during `times` of a query that moves linearly from `from` to `to`, and a point with position
/// `key(i)` at the `i`-th of `keys` keys that exists during `active`. `None` if these have no time in common.
pub fn approach(
    (from, to): (DVec3, DVec3),
    times: TimeInterval,
    given: Given,
    keys: usize,
    active: TimeInterval,
    key: impl Fn(usize) -> DVec3 + Copy,
) -> Option<ExactApproach> {
    let first = Dyadic::new(times.begin().max(active.begin()));
    let last = Dyadic::new(times.end().min(active.end()));
    if first > last {
        return None;
    }
    let segments = keys.max(2) - 1;
    // Times are counted in segments from here on: `key number = time * segments`.
    let scale = Dyadic::new(segments as f64);
    let (first, last) = (&first * &scale, &last * &scale);
    let (start, length) = {
        let (b, e) = (&Dyadic::new(times.begin()) * &scale, &Dyadic::new(times.end()) * &scale);
        (b.clone(), &e - &b)
    };
    let (begin, displacement) = (Vector::new(from), &Vector::new(to) - &Vector::new(from));
    // Point minus query at a time in segments, times `length` (so that no division is needed).
    let apart = |segment: usize, at: &Dyadic| {
        let a = key(segment.min(keys - 1));
        let b = key((segment + 1).min(keys - 1));
        let inside = at - &Dyadic::new(segment as f64);
        let point = &Vector::new(a) + &(&Vector::new(b) - &Vector::new(a)).times(&inside);
        let query = &begin.times(&length) + &displacement.times(&(at - &start));
        &point.times(&length) - &query
    };
    let mut best: Option<(Ratio, Ratio, usize)> = None;
    for segment in 0..segments {
        let b = first.clone().max(Dyadic::new(segment as f64));
        let e = last.clone().min(Dyadic::new((segment + 1) as f64));
        if b > e {
            continue;
        }
        let (p, q) = (apart(segment, &b), apart(segment, &e));
        let passing = &q - &p;
        let (square, along) = (passing.length_squared(), -&p.dot(&passing));
        let all = length.squared();
        // The fraction of the segment, and the square there.
        let (time, squared) = if square.sign() == 0 || along.sign() <= 0 {
            (Ratio::of(b), Ratio::new(p.length_squared(), all))
        } else if along >= square {
            (Ratio::of(e), Ratio::new(q.length_squared(), all))
        } else {
            let upper = &(&b * &square) + &(&(&e - &b) * &along);
            let least = &(&p.length_squared() * &square) - &along.squared();
            (Ratio::new(upper, square.clone())?, Ratio::new(least, &all * &square))
        };
        let squared = squared.unwrap_or_else(|| Ratio::of(p.length_squared()));
        if best.as_ref().is_none_or(|(_, s, _)| squared.cmp(s) == Ordering::Less) {
            best = Some((time, squared, segment));
        }
    }
    let (at, squared, segment) = best?;
    let time = at.divided_by(segments);
    let about = time.to_f64();
    let point = Moving::new(about as f32, keys, given, key);
    let (t0, t1) = (f64::from(times.begin()), f64::from(times.end()));
    let w = if t1 > t0 { ((about - t0) / (t1 - t0)).clamp(0.0, 1.0) } else { 0.0 };
    let query_doubt = given.doubt(from) * (1.0 - w) + given.doubt(to) * w;
    // The time is an answer here, not input: its error does not move the least distance.
    let (a, b) = (key(segment.min(keys - 1)), key((segment + 1).min(keys - 1)));
    let s = (about * segments as f64 - segment as f64).clamp(0.0, 1.0);
    let keys_doubt = given.doubt(a) * (1.0 - s) + given.doubt(b) * s;
    let between = point.near - (from + (to - from) * w);
    let length = squared.to_f64().max(0.0).sqrt();
    let between = if between.length() > 0.0 { between.abs() / between.length() * length } else { between };
    let doubt = 2.0 * between.dot(query_doubt + keys_doubt);
    let speed = (b - a) * segments as f64 - if t1 > t0 { (to - from) / (t1 - t0) } else { DVec3::ZERO };
    let time_doubt = speed.abs().dot(query_doubt + keys_doubt) / speed.length_squared().max(f64::MIN_POSITIVE);
    Some(ExactApproach { time, squared, doubt, time_doubt })
}
