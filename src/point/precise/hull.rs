//! Boxes around f64 points on their ways, and nodes that hold such boxes in f32 relative to a middle.
//!
//! **Padding.** A point on its way from a to b is computed with three roundings of at most 2^-52 max(|a|, |b|): its
//! hull is wider by 2^-49 of that, and by nothing where it stands still ([`Hull::of_point`]). A face is stored relative to
//! the middle of its node, and computed in f32 as `at + slope·w`, where w is rounded too: by at most (|at| + 3 |slope|)u;
//! it is moved outward by (|at| + 4 |slope|)u, the difference of which covers the f64 rounding on the way. The middle
//! moves along a line; where that is computed in f64 it is off by less than 2^-49 of its largest coordinates, which
//! queries keep away in addition ([`Middle::slack`]).

use crate::point::moving_leaf::Times;
use crate::point::snapshot::Boxes;
use glam::DVec3;

/// A box at the begin and at the end of a part of the shutter, linear between, and when what is in it lives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hull {
    lo: [DVec3; 2],
    hi: [DVec3; 2],
    times: [f32; 2],
}

/// Where the boxes of a node are: what they are relative to.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Middle {
    /// At the begin of the part.
    pub(super) at: [f64; 3],
    /// From there to the end of the part.
    pub(super) way: [f64; 3],
    /// How far queries keep away from faces, besides what the distance from the middle costs them.
    pub(super) slack: f64,
}

/// A node: boxes at the begin of the part, how far they move during it, what both are relative to, when they count.
pub(super) struct Node {
    pub(super) boxes: Boxes,
    pub(super) slopes: Boxes,
    pub(super) middle: Middle,
    pub(super) times: Times,
}

/// Relative rounding of one f32 operation, with room for that of f64 on the way.
const UNIT: f64 = (1.0 + 1.0 / 1024.0) / 16_777_216.0;

/// Queries keep away from boxes by at least this, so that squares in f32 may underflow (`super::tree`).
const TINY: f64 = 1e-22;

/// Multiple of the paddings that is applied: 1, except where a test shows that less loses points.
pub(super) const FULL: f64 = 1.0;

impl Hull {
    pub(super) const NONE: Hull =
        Hull { lo: [DVec3::INFINITY; 2], hi: [DVec3::NEG_INFINITY; 2], times: [f32::INFINITY, f32::NEG_INFINITY] };

    /// A point at the begin and at the end of a part, on its way between two keys.
    pub(super) fn of_point(ends: [DVec3; 2], keys: [DVec3; 2], times: [f32; 2]) -> Hull {
        let [a, b] = keys;
        let moves = if a == b { 0.0 } else { 1.0 };
        let error = a.abs().max(b.abs()) * (moves * 2f64.powi(-49));
        Hull { lo: ends.map(|p| p - error), hi: ends.map(|p| p + error), times }
    }

    /// Both.
    pub(super) fn union(self, other: &Hull) -> Hull {
        let both = |i: usize| (self.lo[i].min(other.lo[i]), self.hi[i].max(other.hi[i]));
        let ((lo, hi), (end_lo, end_hi)) = (both(0), both(1));
        let times = [self.times[0].min(other.times[0]), self.times[1].max(other.times[1])];
        Hull { lo: [lo, end_lo], hi: [hi, end_hi], times }
    }
}

impl Node {
    /// The node over at most sixteen children, and its hull.
    pub(super) fn over(children: &[Hull], moves: bool, padding: f64) -> (Node, Hull) {
        let hull = children.iter().fold(Hull::NONE, Hull::union);
        let mut node = Node {
            boxes: Boxes::NONE,
            slopes: Boxes { lo: [[0.0; 16]; 3], hi: [[0.0; 16]; 3] },
            middle: Middle { at: [0.0; 3], way: [0.0; 3], slack: TINY },
            times: Times::NEVER,
        };
        if children.is_empty() {
            return (node, hull);
        }
        let middle = |i: usize| hull.lo[i] * 0.5 + hull.hi[i] * 0.5;
        let way = if moves { middle(1) - middle(0) } else { DVec3::ZERO };
        let (begin, end) = (middle(0), middle(0) + way);
        let largest = begin.abs().max(end.abs()).max_element();
        let slack = if moves { TINY + largest * 2f64.powi(-49) } else { TINY };
        node.middle = Middle { at: begin.to_array(), way: way.to_array(), slack };
        for (lane, child) in children.iter().enumerate() {
            [node.times.begin[lane], node.times.end[lane]] = child.times;
            for axis in 0..3 {
                let relative = |ends: &[DVec3; 2]| [ends[0][axis] - begin[axis], ends[1][axis] - end[axis]];
                let (lo, hi) = (relative(&child.lo), relative(&child.hi));
                let (at, slope) = below(lo, moves, padding);
                (node.boxes.lo[axis][lane], node.slopes.lo[axis][lane]) = (at, slope);
                let (at, slope) = below(hi.map(|x| -x), moves, padding);
                (node.boxes.hi[axis][lane], node.slopes.hi[axis][lane]) = (-at, -slope);
            }
        }
        (node, hull)
    }
}

/// A line in f32 that is computed below the one between two heights.
fn below([begin, end]: [f64; 2], moves: bool, padding: f64) -> (f32, f32) {
    let slope = if moves { (end - begin) as f32 } else { 0.0 };
    let wide = f64::from(slope);
    let least = if moves { begin.min(end - wide) } else { begin };
    let at = least - (least.abs() + 4.0 * wide.abs()) * (UNIT * padding);
    let near = at as f32;
    (if f64::from(near) > at { near.next_down() } else { near }, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn next(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// How many points are, exactly, outside of the faces of their node as queries compute them: relative to its middle,
    /// at times of the part.
    fn lost(padding: f64) -> usize {
        let (mut state, mut lost) = (3, 0);
        for round in 0..400 {
            let offset = [0.0, 1e9, -3e3][round % 3];
            let speed = [0.0, 1e-3, 5.0][round / 3 % 3];
            let moves = speed > 0.0;
            let mut place = |by: f64| DVec3::new(next(&mut state), next(&mut state), next(&mut state)) * by;
            let points: Vec<[DVec3; 2]> = (0..16)
                .map(|_| {
                    let a = place(1.0) + offset;
                    [a, a + place(speed)]
                })
                .collect();
            let hulls: Vec<Hull> = points.iter().map(|&ends| Hull::of_point(ends, ends, [0.0, 1.0])).collect();
            let (node, _) = Node::over(&hulls, moves, padding);
            for step in 0..=8 {
                let w = f64::from(step) / 8.0;
                for (lane, [a, b]) in points.iter().enumerate() {
                    for axis in 0..3 {
                        let Middle { at, way, slack } = node.middle;
                        let p = (a[axis] - at[axis]) + ((b[axis] - a[axis]) - way[axis]) * w;
                        let face = |at: f32, slope: f32| f64::from(at + slope * w as f32);
                        let lo = face(node.boxes.lo[axis][lane], node.slopes.lo[axis][lane]);
                        let hi = face(node.boxes.hi[axis][lane], node.slopes.hi[axis][lane]);
                        lost += usize::from(p < lo - slack || p > hi + slack);
                    }
                }
            }
        }
        lost
    }

    #[test]
    fn faces_hold_their_points_and_would_not_without_padding() {
        assert_eq!(lost(FULL), 0);
        assert!(lost(0.0) > 20, "a padding that no point needs");
    }
}
