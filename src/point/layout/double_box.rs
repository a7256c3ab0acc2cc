//! Boxes around moving f64 points, and nodes that hold such boxes in f32 relative to a centre.
//!
//! **Padding.** A point that moves from a to b is computed with three roundings of at most 2^-52 max(|a|, |b|): its
//! box is wider by 2^-49 of that, and not at all if it is static ([`DoubleBox::of_point`]). A face is stored relative to
//! the centre of its node, and computed in f32 as `at + slope·w`, where w is rounded too: by at most (|at| + 3 |slope|)u.
//! The query is rounded relative to the centre as well: by u of its distance from there, which is at most the distance of
//! the face from there, |at| + |slope|, plus that of the query from the face. The latter changes gaps by a fraction of
//! themselves only, which `super::double_tree` accounts for. For the rest, (2 |at| + 4 |slope|)u, the face is moved outward by
//! (3 |at| + 6 |slope|)u; the difference covers the f64 rounding of the build. The centre moves along a line; computed in
//! f64 it is off by less than 2^-49 of its largest coordinates, by which faces are moved outward too.

use crate::geometry::TimeInterval;
use crate::point::layout::boxes::Boxes;
use crate::point::layout::lane_intervals::LaneIntervals;
use crate::point::layout::linear_face::{UNIT, rounded_down};
use crate::simd::LANES;
use glam::DVec3;

/// A box at the begin and at the end of a time slice, linear between, and its active interval.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct DoubleBox {
    lo: [DVec3; 2],
    hi: [DVec3; 2],
    times: [f32; 2],
}

/// Sixteen boxes relative to a centre that moves along a line.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(in crate::point) struct DoubleNode {
    /// The centre at the begin of the slice.
    pub(in crate::point) middle: [f64; 3],
    /// The displacement of the centre until the end of the slice.
    pub(in crate::point) displacement: [f64; 3],
    /// The boxes at the begin of the slice.
    pub(in crate::point) boxes: Boxes,
}

/// A node with all that a tree may hold of it.
pub(in crate::point) struct DoubleNodeRows {
    pub(in crate::point) node: DoubleNode,
    /// The displacements of its faces during the slice.
    pub(in crate::point) slopes: Boxes,
    /// The active intervals of its children.
    pub(in crate::point) times: LaneIntervals,
    /// The box around it.
    pub(in crate::point) hull: DoubleBox,
}

/// Faces are moved outward by at least this, so that squares in f32 may underflow (`super::double_tree`).
const TINY: f64 = 1e-22;

/// Multiple of the paddings that is applied: 1, except in a test that shows that less loses points.
pub(in crate::point) const FULL: f64 = 1.0;

impl DoubleBox {
    pub(in crate::point) const NONE: DoubleBox =
        DoubleBox { lo: [DVec3::INFINITY; 2], hi: [DVec3::NEG_INFINITY; 2], times: [f32::INFINITY, f32::NEG_INFINITY] };

    /// The box around a point at the begin and at the end of a slice, given its positions at both keys.
    pub(in crate::point) fn of_point(ends: [DVec3; 2], keys: [DVec3; 2], times: [f32; 2]) -> DoubleBox {
        let [a, b] = keys;
        let moves = if a == b { 0.0 } else { 1.0 };
        let error = a.abs().max(b.abs()) * (moves * 2f64.powi(-49));
        // (Without `map` of arrays here and below, which is a call in some places.)
        let [begin, end] = ends;
        DoubleBox { lo: [begin - error, end - error], hi: [begin + error, end + error], times }
    }

    /// A box that does not move and always exists.
    pub(in crate::point) fn at_rest(lo: DVec3, hi: DVec3) -> DoubleBox {
        DoubleBox { lo: [lo; 2], hi: [hi; 2], times: [TimeInterval::FULL.begin(), TimeInterval::FULL.end_bound()] }
    }

    /// The box around both.
    pub(in crate::point) fn union(self, other: &DoubleBox) -> DoubleBox {
        let both = |i: usize| (self.lo[i].min(other.lo[i]), self.hi[i].max(other.hi[i]));
        let ((lo, hi), (end_lo, end_hi)) = (both(0), both(1));
        let times = [self.times[0].min(other.times[0]), self.times[1].max(other.times[1])];
        DoubleBox { lo: [lo, end_lo], hi: [hi, end_hi], times }
    }
}

/// The centre of a node at the begin or the end of the slice: along each axis the middle one of three children. Not the middle of
/// all: faces are as coarse as they are far from the centre, and one child may be much farther away than the others are apart. In
/// the order of the tree it is the first or the last along some axis.
fn place_among(children: &[DoubleBox], end: usize) -> DVec3 {
    let middle = |child: &DoubleBox| child.lo[end] * 0.5 + child.hi[end] * 0.5;
    let (first, last) = (middle(&children[0]), middle(&children[children.len() - 1]));
    let between = middle(&children[children.len() / 2]);
    first.min(last).max(first.max(last).min(between))
}

impl DoubleNode {
    /// A node without children.
    pub(in crate::point) const NONE: DoubleNode =
        DoubleNode { middle: [0.0; 3], displacement: [0.0; 3], boxes: Boxes::NONE };

    /// The displacements of static boxes.
    pub(in crate::point) const STATIC: Boxes = Boxes { lo: [[0.0; LANES]; 3], hi: [[0.0; LANES]; 3] };

    /// The node over at most sixteen children, whose faces move or not.
    pub(in crate::point) fn over(children: &[DoubleBox], moves: bool, padding: f64) -> DoubleNodeRows {
        let hull = children.iter().fold(DoubleBox::NONE, DoubleBox::union);
        let (mut node, mut slopes, mut times) = (DoubleNode::NONE, DoubleNode::STATIC, LaneIntervals::NEVER);
        if children.is_empty() {
            return DoubleNodeRows { node, slopes, times, hull };
        }
        let begin = place_among(children, 0);
        let displacement = if moves { place_among(children, 1) - begin } else { DVec3::ZERO };
        let end = begin + displacement;
        let largest = begin.abs().max(end.abs()).max_element();
        let slack = padding * if moves { TINY + largest * 2f64.powi(-49) } else { TINY };
        (node.middle, node.displacement) = (begin.to_array(), displacement.to_array());
        let boxes = &mut node.boxes;
        for (lane, child) in children.iter().enumerate() {
            times.set(lane, child.times);
            for axis in 0..3 {
                let relative = |ends: &[DVec3; 2]| [ends[0][axis] - begin[axis], ends[1][axis] - end[axis]];
                let (lo, [hi, hi_at_end]) = (relative(&child.lo), relative(&child.hi));
                let (lo, lo_slope) = below(lo, moves, UNIT * padding, slack);
                let (hi, hi_slope) = below([-hi, -hi_at_end], moves, UNIT * padding, slack);
                (boxes.lo[axis][lane], boxes.hi[axis][lane]) = (lo, -hi);
                (slopes.lo[axis][lane], slopes.hi[axis][lane]) = (lo_slope, -hi_slope);
            }
        }
        DoubleNodeRows { node, slopes, times, hull }
    }

    /// The centre at a fraction of the slice.
    #[inline(always)]
    pub(in crate::point) fn middle_at(&self, within: f64) -> [f64; 3] {
        let ([x, y, z], [by_x, by_y, by_z]) = (self.middle, self.displacement);
        [x + by_x * within, y + by_y * within, z + by_z * within]
    }
}

/// A line in f32 that is computed below the line between two heights, by the slack and a multiple of `unit`.
fn below([begin, end]: [f64; 2], moves: bool, unit: f64, slack: f64) -> (f32, f32) {
    let slope = if moves { (end - begin) as f32 } else { 0.0 };
    let double = f64::from(slope);
    let least = if moves { begin.min(end - double) } else { begin };
    let at = least - (3.0 * least.abs() + 6.0 * double.abs()) * unit - slack;
    (rounded_down(at), slope)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// The number of points that are outside of the faces of their box, both computed as in a query at the point: relative
    /// to the centre of the node, at times of the slice.
    fn lost(padding: f64) -> usize {
        let (mut random, mut lost) = (Random(3), 0);
        for round in 0..400 {
            let offset = [0.0, 1e9, -3e3][round % 3];
            let speed = [0.0, 1e-3, 5.0][round / 3 % 3];
            let moves = speed > 0.0;
            let mut random_vec =
                |by: f64| DVec3::new(random.signed_f64(), random.signed_f64(), random.signed_f64()) * by;
            let points: Vec<[DVec3; 2]> = (0..16)
                .map(|_| {
                    let a = random_vec(1.0) + offset;
                    [a, a + random_vec(speed)]
                })
                .collect();
            let boxes_below: Vec<DoubleBox> =
                points.iter().map(|&ends| DoubleBox::of_point(ends, ends, [0.0, 1.0])).collect();
            let DoubleNodeRows { node, slopes, .. } = DoubleNode::over(&boxes_below, moves, padding);
            for step in 0..=8 {
                let w = f64::from(step) / 8.0;
                for (lane, [a, b]) in points.iter().enumerate() {
                    for axis in 0..3 {
                        let p = (a[axis] + (b[axis] - a[axis]) * w - node.middle_at(w)[axis]) as f32;
                        let face = |at: f32, slope: f32| at + slope * w as f32;
                        let lo = face(node.boxes.lo[axis][lane], slopes.lo[axis][lane]);
                        let hi = face(node.boxes.hi[axis][lane], slopes.hi[axis][lane]);
                        lost += usize::from(p < lo || p > hi);
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
