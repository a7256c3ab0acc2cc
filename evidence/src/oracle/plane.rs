//! The side of a moving vertex relative to a moving plane, and the time when it crosses.

use super::{Dyadic, Moving, Ratio, Vector};
use mbkd::glam::DVec3;

/// The side of a moving vertex relative to the plane through three moving vertices at the same time: 1 if `a`, `b`, `c`
/// run counter-clockwise as seen from it, -1 on the other side, 0 in the plane.
pub fn side(vertex: &Moving, [a, b, c]: [&Moving; 3]) -> i32 {
    let [u, v, w] = [b, c, vertex].map(|p| &p.position - &a.position);
    w.dot(&u.cross(&v)).sign()
}

/// The side of a moving vertex relative to the moving plane `x[axis] = at(time)`, where the plane moves linearly from
/// `plane[0]` at the segment's beginning to `plane[1]` at its end and `s` is the exact fraction of the segment.
pub fn side_of_axis_plane(vertex: &Moving, axis: usize, plane: [f64; 2], s: &Dyadic) -> i32 {
    let [begin, end] = plane.map(Dyadic::new);
    let at = &begin + &(&(&end - &begin) * s);
    (&vertex.position.0[axis] - &at).sign()
}

/// When a vertex that moves linearly from `a` to `b` while the plane `x[axis] = p` moves linearly from `plane[0]` to
/// `plane[1]` crosses it, as an exact fraction of that time. `None` if it never does or stays in it.
pub fn crossing_times(a: DVec3, b: DVec3, axis: usize, plane: [f64; 2]) -> Option<Ratio> {
    let gap = |p: DVec3, plane: f64| &Vector::new(p).0[axis] - &Dyadic::new(plane);
    let (begin, end) = (gap(a, plane[0]), gap(b, plane[1]));
    if begin.sign() * end.sign() > 0 {
        return None;
    }
    Ratio::new(begin.clone(), &begin - &end)
}
