//! The closest approach of one moving point and one moving query.
//!
//! Between two keys both move linearly, so relative to the query the point moves along a segment; nearest is the foot of
//! the perpendicular or an end. All but two quotients are sums and products of the caller's numbers. They are
//! computed twice.
//!
//! In f64, to exclude points. Positions are off by less than 16·2^-53 of the largest coordinate of the point and
//! the query, M, per axis; the foot may slip along the segment by so little that the distance grows by less than that. So
//! the distance is too great by less than 2^-46 M.
//!
//! In 106 bits, for the answer: the same error is 2^-95 M. Times are multiplied by the number of segments and
//! positions by the length of the query's interval, so that equal times and parallel paths are recognized without rounding.
//! The distance is rounded to f32 once at the end: it is within half an ulp, and 2^-95 M, of the exact one.

use crate::geometry::DoubleDouble;
use crate::point::layout::over_interval::PointPath;
use crate::point::leaf_order::segment_slice::segments;
use glam::DVec3;

/// The path of a query: positions at the begin and the end of the interval.
pub(in crate::point) struct QueryPath {
    pub(in crate::point) from: DVec3,
    pub(in crate::point) to: DVec3,
    pub(in crate::point) times: [f64; 2],
    /// Number of keys of the points.
    pub(in crate::point) keys: usize,
}

/// Three coordinates.
type Vector = [DoubleDouble; 3];

fn dot(a: &Vector, b: &Vector) -> DoubleDouble {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A time range in which a point and the query both move linearly, in units of segments between keys.
pub(in crate::point) struct Overlap {
    begin: f64,
    end: f64,
    segment: f64,
    segments: f64,
}

impl Overlap {
    /// The overlap of the query's interval, the point's interval, and a segment; `None` if they do not overlap.
    pub(in crate::point) fn new(path: &QueryPath, point: &PointPath, segment: usize) -> Option<Overlap> {
        let (segment, segments) = (segment as f64, segments(path.keys) as f64);
        // Exact: times have 24 bits and there are at most 2^16 keys.
        let begin = (path.times[0].max(point.active.begin().into()) * segments).max(segment);
        let end = (path.times[1].min(point.active.end().into()) * segments).min(segment + 1.0);
        (begin <= end).then_some(Overlap { begin, end, segment, segments })
    }

    /// The number of the segment between keys.
    pub(in crate::point) fn segment(&self) -> f64 {
        self.segment
    }

    /// The least distance as computed in f64, and a bound of its excess.
    pub(in crate::point) fn estimate(&self, path: &QueryPath, point: &PointPath) -> (f64, f64) {
        let [open, close] = [point.open, point.close].map(DVec3::from_array);
        let length = (path.times[1] - path.times[0]) * self.segments;
        let rate = if length > 0.0 { 1.0 / length } else { 0.0 };
        let offset = |at: f64| {
            let query = path.from + (path.to - path.from) * ((at - path.times[0] * self.segments) * rate);
            open + (close - open) * (at - self.segment) - query
        };
        let (first, last) = (offset(self.begin), offset(self.end));
        let displacement = last - first;
        let square = displacement.length_squared();
        let w = if square > 0.0 { (-first.dot(displacement) / square).clamp(0.0, 1.0) } else { 0.0 };
        let sizes = open.abs().max(close.abs()).max(path.from.abs()).max(path.to.abs());
        ((first + displacement * w).length(), sizes.max_element() * 1.5e-14)
    }

    /// Time and distance of the closest approach.
    pub(in crate::point) fn closest(&self, path: &QueryPath, point: &PointPath) -> (f32, f32) {
        let number = |x: f64| DoubleDouble::from(x);
        let start = number(path.times[0] * self.segments);
        let duration = number(path.times[1] * self.segments) - start;
        // For a query at one moment only, either position is right.
        let length = if duration.to_f64() > 0.0 { duration } else { number(1.0) };
        let offset = |at: f64| -> Vector {
            core::array::from_fn(|axis| {
                let (open, close) = (number(point.open[axis]), number(point.close[axis]));
                let (from, to) = (number(path.from[axis]), number(path.to[axis]));
                let point = open + (close - open) * (number(at) - number(self.segment));
                (point - from) * length - (to - from) * (number(at) - start)
            })
        };
        let (first, last) = (offset(self.begin), offset(self.end));
        let displacement: Vector = core::array::from_fn(|axis| first[axis] - last[axis]);
        let (along, square) = (dot(&first, &displacement), dot(&displacement, &displacement));
        let (at, nearest) = if along.to_f64() <= 0.0 || square.to_f64() <= 0.0 {
            (self.begin, first)
        } else if (square - along).to_f64() <= 0.0 {
            (self.end, last)
        } else {
            let w = along.over(square);
            let foot = core::array::from_fn(|axis| first[axis] - displacement[axis] * w);
            (self.begin + (self.end - self.begin) * w.to_f64(), foot)
        };
        let distance = dot(&nearest, &nearest).to_f64().sqrt() / length.to_f64();
        ((at / self.segments) as f32, distance as f32)
    }
}
