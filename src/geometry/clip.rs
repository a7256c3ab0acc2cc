//! Clipping a triangle at planes, one after the other (Sutherland and Hodgman, "Reentrant Polygon Clipping", 1974), and to a box:
//! the "perfect splits" of k-d construction.

use super::box3::{Box3, ULP};
use glam::Vec3;

/// The greatest number of corners of a triangle that was clipped at six planes: each adds one.
const MOST_CORNERS: usize = 9;

/// What is left of a triangle that is clipped at up to six planes: a convex polygon.
#[derive(Clone, Copy)]
pub(crate) struct Polygon<C> {
    corners: [C; MOST_CORNERS],
    count: usize,
}

impl<C: Copy> Polygon<C> {
    /// The whole triangle.
    #[inline(always)]
    pub fn new([a, b, c]: [C; 3]) -> Polygon<C> {
        Polygon { corners: [a, b, c, a, a, a, a, a, a], count: 3 }
    }

    #[inline(always)]
    pub fn corners(&self) -> &[C] {
        &self.corners[..self.count]
    }

    /// Keeps what is not below a plane, given how far corners are above it. `cut` makes the corner where an edge crosses the plane,
    /// of the ends of the edge and how far they are above.
    #[inline(always)]
    pub fn keep<D: Copy + Default + PartialOrd>(
        &mut self,
        above: impl Fn(&C) -> D,
        cut: impl Fn([&C; 2], [D; 2]) -> C,
    ) {
        let (mut kept, mut count) = (self.corners, 0);
        let mut push = |corner: C| {
            if count < MOST_CORNERS {
                kept[count] = corner;
                count += 1;
            }
        };
        for i in 0..self.count {
            let ends = [&self.corners[i], &self.corners[(i + 1) % self.count]];
            let [from, to] = ends.map(&above);
            if from >= D::default() {
                push(*ends[0]);
            }
            if (from >= D::default()) != (to >= D::default()) {
                push(cut(ends, [from, to]));
            }
        }
        *self = Polygon { corners: kept, count };
    }
}

/// Bounds of the part of a triangle inside `cell`; empty if they are disjoint.
///
/// Clipping against the six faces in turn. New corners are exactly on their face; their other coordinates carry the rounding of one
/// interpolation (three operations at sizes of at most twice the triangle's largest coordinate), so the result is padded by 8 ULP
/// of that inside the cell.
pub(crate) fn clip_triangle(corners: [Vec3; 3], cell: Box3) -> Box3 {
    let whole = corners.into_iter().fold(Box3::EMPTY, Box3::include);
    let bounds = whole.intersection(cell);
    if bounds.is_empty() || (bounds.min == whole.min && bounds.max == whole.max) {
        return bounds;
    }
    let mut polygon = Polygon::new(corners);
    for axis in 0..3 {
        for (sign, face) in [(1.0, cell.min[axis]), (-1.0, cell.max[axis])] {
            if sign * whole_end(whole, axis, sign) >= sign * face {
                continue;
            }
            let above = |p: &Vec3| sign * (p[axis] - face);
            polygon.keep(above, |[&p, &q], [dp, dq]: [f32; 2]| {
                let mut cut = p + (q - p) * (dp / (dp - dq));
                cut[axis] = face;
                cut
            });
        }
    }
    let part = polygon.corners().iter().fold(Box3::EMPTY, |b, &p| b.include(p));
    part.pad(8.0 * ULP * whole.magnitude()).intersection(bounds)
}

/// The extreme of the box on the side that a face of this sign cuts off.
fn whole_end(whole: Box3, axis: usize, sign: f32) -> f32 {
    if sign > 0.0 { whole.min[axis] } else { whole.max[axis] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn a_diagonal_triangle_leaves_a_corner_of_the_cell() {
        let cell = Box3 { min: Vec3::ZERO, max: Vec3::ONE };
        let corners = [Vec3::new(0.8, 0.0, 0.5), Vec3::new(0.0, 0.8, 0.5), Vec3::new(-3.0, -3.0, 0.5)];
        let part = clip_triangle(corners, Box3 { min: Vec3::new(0.5, 0.0, 0.0), ..cell });
        assert!((part.max.y - 0.3).abs() < 1e-5 && part.max.x == 0.8, "{part:?}");
        let past = [Vec3::new(2.0, 0.5, 0.5), Vec3::new(0.5, 2.0, 0.5), Vec3::new(2.0, 2.0, 0.5)];
        assert!(clip_triangle(past, cell).is_empty(), "the boxes overlap, the triangle does not");
        assert_eq!(clip_triangle([Vec3::splat(0.5); 3], cell).min, Vec3::splat(0.5));
    }

    #[test]
    fn every_sampled_point_inside_the_cell_is_kept() {
        let mut random = Random(3);
        let mut inside = 0;
        for _ in 0..2000 {
            let (corners, a, b) = ([random.vec(), random.vec(), random.vec()], random.vec(), random.vec());
            let cell = Box3 { min: a.min(b), max: a.max(b) };
            let part = clip_triangle(corners, cell);
            for i in 0..=16 {
                for j in 0..=16 - i {
                    let (u, v) = (i as f32 / 16.0, j as f32 / 16.0);
                    let p = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
                    if p.cmpge(cell.min).all() && p.cmple(cell.max).all() {
                        inside += 1;
                        let grown = part.pad(2.0 * ULP);
                        assert!(p.cmpge(grown.min).all() && p.cmple(grown.max).all(), "{p} {part:?} {cell:?}");
                    }
                }
            }
        }
        assert!(inside > 1000);
    }
}
