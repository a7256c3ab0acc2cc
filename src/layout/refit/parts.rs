//! Parts of triangles that were split before the build (`bvh/presplit.rs`), in refits: what of a triangle a leaf block holds.
//!
//! A tree does not store how triangles were split, but before its first refit the boxes around leaf blocks tell enough: of each
//! triangle a block holds at most what lies in the block's box. The corners of that polygon are recorded as means of the triangle's
//! corners, and so it stays the same part of the triangle wherever that moves.
//!
//! **Proof that refitted boxes hold what those of the build held.** A box of the build holds its part of the triangle at all times
//! of its interval, so at one of them the part is in the polygon between the box and the triangle. The triangle's corners at that
//! time are read from the block in f64, where they are off by a few ULP of the largest coordinate, for which the box is wider by 8
//! ULP of it. The weights of a point never change, and bounds that hold the corners of a polygon hold all of it. A corner of the
//! polygon is a mean of the triangle's corners, so the same mean of their linear bounds holds it, but for
//! - the rounding of the sum, at most twice that of a mean of two corners ([`CornerBounds::pad_of_means`]), and
//! - the rounding of weights, first in f64 and then to f32, by less than 2^-23 in all: it moves the point by less than 2^-22 of the
//!   extent of the triangle and of its corners' bounds.

use crate::geometry::{Aabb, CornerBounds, LinearBox3, Polygon, TimeInterval, ULP};
use crate::layout::leaf::source::WideSource;
use crate::layout::node_boxes::read_box;
use crate::layout::wide_node::ChildRef;
use crate::layout::wide_tree::WideTree;
use core::ops::Range;
use glam::DVec3;
use std::collections::HashMap;

/// What the rounding of weights moves a point by, relative to the extent of the triangle.
const OF_WEIGHTS: f32 = 1.0 / (1 << 22) as f32;

/// More than the interval of the boxes in a time slice is wider on either side than the times of its queries.
const BESIDE_SLICE: f32 = 1e-6;

/// The parts of split triangles in all leaf blocks of a tree.
#[derive(Clone, Default)]
pub(in crate::layout) struct Parts {
    parts: Vec<Part>,
    /// Of each corner of a polygon, the weights of the triangle's second and third corner.
    weights: Vec<[f32; 2]>,
    /// The parts in each leaf block that holds any, by its reference.
    of_leaves: HashMap<u32, Range<usize>>,
}

/// The part of a triangle that a leaf block holds: a convex polygon.
#[derive(Clone)]
struct Part {
    /// The triangle's place in the block.
    lane: usize,
    /// Its corners in [`Parts::weights`].
    corners: Range<usize>,
}

impl Parts {
    /// Records the parts in a leaf block whose box is in one lane of a node, if it was not met before.
    pub fn add<S: WideSource>(
        &mut self,
        tree: &WideTree,
        set: &S,
        (node, lane): (ChildRef, usize),
        leaf: ChildRef,
        over: TimeInterval,
    ) {
        let (Some(triangles), false) = (set.triangles(), tree.is_list(leaf)) else { return };
        if self.of_leaves.contains_key(&leaf.0) {
            return;
        }
        let bounds = read_box(&tree.arena.ints()[node.at()..], node.kind(), lane, over);
        let first = self.parts.len();
        for (lane, &id) in tree.ids(leaf).unwrap_or(&[]).iter().enumerate() {
            // The box may not hold the triangle when it does not exist, nor if it exists at no time that queries look for in a
            // slice.
            let active = set.active(id);
            let time = over.middle().clamp(active.begin(), active.last());
            if over.begin() + BESIDE_SLICE <= time && time <= over.end() - BESIDE_SLICE {
                let corners = tree.corners_in(leaf, lane, time, || triangles.segments_of_life(id));
                let at = (f64::from(time) - f64::from(over.begin())) / over.fine_duration();
                if let Some(polygon) = part_in(box_at(&bounds, at), corners) {
                    let begin = self.weights.len();
                    self.weights.extend(polygon.corners().iter().map(|of| of.weights.map(|weight| weight as f32)));
                    self.parts.push(Part { lane, corners: begin..self.weights.len() });
                }
            }
        }
        if self.parts.len() > first {
            self.of_leaves.insert(leaf.0, first..self.parts.len());
        }
    }

    /// The bounds of what a leaf block of these triangles holds of them; `None` if it holds all of each.
    pub fn bounds<S: WideSource>(
        &self,
        set: &S,
        leaf: ChildRef,
        ids: &[u32],
        over: TimeInterval,
    ) -> Option<LinearBox3> {
        let mut parts = self.parts[self.of_leaves.get(&leaf.0)?.clone()].iter().peekable();
        Some(ids.iter().enumerate().fold(LinearBox3::EMPTY, |all, (lane, &id)| {
            let part = parts.next_if(|part| part.lane == lane).zip(set.corner_bounds(id, over));
            all.union(match part {
                Some((part, corners)) => bounds_of(&self.weights[part.corners.clone()], &corners),
                None => set.bounds(id, over),
            })
        }))
    }
}

/// A box at the fraction `at` of its interval.
fn box_at(bounds: &LinearBox3, at: f64) -> Aabb {
    Aabb {
        min: bounds.begin.min.as_dvec3().lerp(bounds.end.min.as_dvec3(), at),
        max: bounds.begin.max.as_dvec3().lerp(bounds.end.max.as_dvec3(), at),
    }
}

/// The bounds of a polygon with these weights, given those of the triangle's corners. Each face is the triangle's where that is
/// tighter on average.
fn bounds_of(weights: &[[f32; 2]], corners: &CornerBounds) -> LinearBox3 {
    let all = corners.around(weights);
    let (whole, pad) = (corners.union(), corners.pad_of_means());
    let padded = |of: LinearBox3, pad: f32| LinearBox3 { begin: of.begin.pad(pad), end: of.end.pad(pad) };
    let extent = whole.swept().max - whole.swept().min;
    padded(all, 2.0 * pad + OF_WEIGHTS * extent.max_element()).tighter(padded(whole, pad))
}

/// A corner of a polygon: where it is, and the weights of the triangle's second and third corner.
#[derive(Clone, Copy)]
struct Corner {
    at: DVec3,
    weights: [f64; 2],
}

/// The part of a triangle in a box; `None` if all of it may be in the box, or nothing is.
fn part_in(bounds: Aabb, triangle: [DVec3; 3]) -> Option<Polygon<Corner>> {
    let [a, b, c] = triangle;
    let (min, max) = (a.min(b).min(c), a.max(b).max(c));
    let magnitude = bounds.min.abs().max(bounds.max.abs()).max(min.abs()).max(max.abs()).max_element();
    let Aabb { min: low, max: high } = bounds.pad(f64::from(8.0 * ULP) * magnitude);
    // Also for NaN.
    if !(min.is_finite() && max.is_finite()) || (low.cmple(min) & high.cmpge(max)).all() {
        return None;
    }
    let corner = |at: DVec3, weights: [f64; 2]| Corner { at, weights };
    let mut polygon = Polygon::new([corner(a, [0.0, 0.0]), corner(b, [1.0, 0.0]), corner(c, [0.0, 1.0])]);
    let cut = |[from, to]: [&Corner; 2], [before, after]: [f64; 2]| {
        let w = before / (before - after);
        corner(from.at.lerp(to.at, w), [0, 1].map(|i| from.weights[i] + (to.weights[i] - from.weights[i]) * w))
    };
    for axis in 0..3 {
        polygon.keep(|corner| corner.at[axis] - low[axis], cut);
        polygon.keep(|corner| high[axis] - corner.at[axis], cut);
    }
    (!polygon.corners().is_empty()).then_some(polygon)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Box3;
    use crate::random::Random;
    use glam::Vec3;

    /// A triangle, somewhere, of which some corners have a coordinate in common.
    fn triangle(random: &mut Random) -> [Vec3; 3] {
        let at = random.vec() * 10f32.powf(4.0 * random.signed());
        let mut corners = [at + random.vec(), at + random.vec(), at + random.vec()];
        if random.unit() < 0.3 {
            let axis = (random.unit() * 2.99) as usize;
            corners[1][axis] = corners[0][axis];
        }
        corners
    }

    /// The number of points of triangles in a box that bounds of its part do not hold after a motion; of all such points; and how
    /// often the bounds are less than half of the triangle's.
    fn lost(bounds_of: impl Fn(&[[f32; 2]], &CornerBounds) -> LinearBox3) -> [usize; 3] {
        let mut random = Random(19);
        let [mut lost, mut held, mut small] = [0; 3];
        for _ in 0..20_000 {
            let (before, after) = (triangle(&mut random), [triangle(&mut random), triangle(&mut random)]);
            let mean = |[a, b, c]: [Vec3; 3], [u, v]: [f64; 2]| {
                a.as_dvec3() * (1.0 - u - v) + b.as_dvec3() * u + c.as_dvec3() * v
            };
            // Mostly on edges.
            let points: [[f64; 2]; 16] = core::array::from_fn(|i| {
                let u = f64::from(random.unit());
                [[u, 0.0], [0.0, u], [u, 1.0 - u], [u, (1.0 - u) * f64::from(random.unit())]][i % 4]
            });
            let middle = mean(before, points[(random.unit() * 15.99) as usize]).as_vec3();
            let bounds = Box3 { min: middle, max: middle }.pad(random.unit() * 0.3);
            let bounds = box_at(&LinearBox3 { begin: bounds, end: bounds }, 0.5);
            let Some(polygon) = part_in(bounds, before.map(Vec3::as_dvec3)) else { continue };
            let weights: Vec<[f32; 2]> = polygon.corners().iter().map(|of| of.weights.map(|w| w as f32)).collect();
            let corners = CornerBounds::of_lines(after[0], after[1], 0.0);
            let found = bounds_of(&weights, &corners);
            small += usize::from(2.0 * found.begin.half_area() < corners.union().begin.half_area());
            let inside = |weights: &[f64; 2]| {
                let p = mean(before, *weights);
                (p.cmpge(bounds.min) & p.cmple(bounds.max)).all()
            };
            let of_polygon = polygon.corners().iter().map(|corner| corner.weights);
            for weights in points.into_iter().filter(inside).chain(of_polygon) {
                held += 1;
                let holds = |b: Box3, p: DVec3| (p.cmpge(b.min.as_dvec3()) & p.cmple(b.max.as_dvec3())).all();
                let both = holds(found.begin, mean(after[0], weights)) && holds(found.end, mean(after[1], weights));
                lost += usize::from(!both);
            }
        }
        [lost, held, small]
    }

    #[test]
    fn parts_hold_their_points_wherever_the_triangle_is_and_would_not_without_padding() {
        let [lost_points, held, small] = lost(bounds_of);
        assert!(lost_points == 0 && held > 20_000 && small > 2000, "{lost_points} {held} {small}");
        assert!(lost(|weights, corners| corners.around(weights))[0] > 1000);
        // All of the polygon is needed.
        assert!(lost(|weights, corners| bounds_of(&weights[1..], corners))[0] > 1000);
    }

    #[test]
    fn the_part_in_a_box_is_the_polygon_between_them() {
        let needle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let area = |min: DVec3, max: DVec3| {
            part_in(Aabb { min, max }, needle).map(|polygon| {
                let at: Vec<DVec3> = polygon.corners().iter().map(|corner| corner.at).collect();
                let fan = at.windows(2).map(|pair| 0.5 * (pair[0] - at[0]).cross(pair[1] - at[0]).length());
                (at.len(), fan.sum::<f64>())
            })
        };
        let found = area(DVec3::new(0.25, 0.25, -1.0), DVec3::new(0.4, 0.4, 1.0));
        assert!(found.is_some_and(|(corners, area)| corners == 4 && (area - 0.0225).abs() < 1e-5), "{found:?}");
        let found = area(DVec3::new(-1.0, 0.2, -1.0), DVec3::new(0.5, 0.7, 1.0));
        assert!(found.is_some_and(|(corners, area)| corners == 5 && (area - 0.23).abs() < 1e-5), "{found:?}");
        assert_eq!(area(DVec3::splat(-1.0), DVec3::splat(1.0)), None, "all of it");
        assert_eq!(area(DVec3::splat(0.6), DVec3::splat(0.9)), None, "nothing of it");
        assert!(part_in(Aabb { min: DVec3::ZERO, max: DVec3::ONE }, [DVec3::NAN; 3]).is_none());
    }
}
