//! Spatial splits: a plane that splits the references that cross it (Stich, Friedrich and Dietrich, "Spatial Splits in
//! Bounding Volume Hierarchies", HPG 2009), at mid-shutter.

use super::boxes::Box3;
use super::bvh::{Reference, split_cost};
use super::object_split::BINS;
use super::parts::part_in;
use mbkd::baseline::TriangleTests;
use mbkd::glam::Vec3;
use std::ops::RangeInclusive;

/// A plane and its children, estimated by bins.
pub struct SpatialSplit {
    pub cost: f32,
    axis: usize,
    at: f32,
    left: (Box3, usize),
    right: (Box3, usize),
}

impl SpatialSplit {
    /// The cheapest plane through a node with this box that makes no more references than the budget allows.
    pub fn best(references: &[Reference], node: Box3, budget: usize, tests: &TriangleTests) -> Option<SpatialSplit> {
        let mut best: Option<SpatialSplit> = None;
        for axis in 0..3 {
            let (low, high) = (node.min[axis], node.max[axis]);
            let width = (high - low) / BINS as f32;
            let scale = BINS as f32 / (high - low);
            if !(low < high && scale.is_finite() && width > 0.0) {
                continue;
            }
            let edge = |k: usize| if k == BINS { high } else { low + width * k as f32 };
            let bin = |x: f32| (((x - low) * scale) as usize).min(BINS - 1);
            let mut bins = [Box3::EMPTY; BINS];
            let (mut enter, mut leave) = ([0usize; BINS], [0usize; BINS]);
            let mut parts = [Box3::EMPTY; BINS];
            for r in references {
                let (first, last) = (bin(r.middle.min[axis]), bin(r.middle.max[axis]));
                enter[first] += 1;
                leave[last] += 1;
                if first == last {
                    bins[first] = bins[first].union(r.middle);
                    continue;
                }
                chop(tests.corners(r.index, 0.5), axis, bin, edge, &mut parts, first..=last);
                for (bounds, part) in bins[first..=last].iter_mut().zip(&mut parts[first..=last]) {
                    let part = std::mem::replace(part, Box3::EMPTY).intersection(r.middle);
                    if !part.is_empty() {
                        *bounds = bounds.union(part);
                    }
                }
            }
            let mut right = [(Box3::EMPTY, 0usize); BINS + 1];
            for k in (0..BINS).rev() {
                right[k] = (right[k + 1].0.union(bins[k]), right[k + 1].1 + leave[k]);
            }
            let mut left = (Box3::EMPTY, 0usize);
            for k in 1..BINS {
                left = (left.0.union(bins[k - 1]), left.1 + enter[k - 1]);
                if left.1 == 0 || right[k].1 == 0 || left.1 + right[k].1 > budget {
                    continue;
                }
                let cost = split_cost(node, left, right[k]);
                if best.as_ref().is_none_or(|b| cost < b.cost) {
                    best = Some(SpatialSplit { cost, axis, at: edge(k), left, right: right[k] });
                }
            }
        }
        best
    }

    /// The references of both children. References that cross the plane are split, unless one child would be cheaper
    /// with the whole reference than both with a part ("reference unsplitting").
    pub fn apply(&self, references: Vec<Reference>, tests: &TriangleTests) -> [Vec<Reference>; 2] {
        let mut children = [Vec::with_capacity(self.left.1), Vec::with_capacity(self.right.1)];
        let (ln, rn) = (self.left.1 as f32, self.right.1 as f32);
        let (la, ra) = (self.left.0.half_area(), self.right.0.half_area());
        for r in references {
            if r.middle.max[self.axis] <= self.at {
                children[0].push(r);
                continue;
            }
            if r.middle.min[self.axis] >= self.at {
                children[1].push(r);
                continue;
            }
            let both = la * ln + ra * rn;
            let only_left = self.left.0.union(r.middle).half_area() * ln + ra * (rn - 1.0);
            let only_right = la * (ln - 1.0) + self.right.0.union(r.middle).half_area() * rn;
            if only_left.min(only_right) < both {
                children[usize::from(only_right < only_left)].push(r);
                continue;
            }
            let cells = [false, true].map(|above| r.cell.side(self.axis, self.at, above));
            let parts = cells.map(|cell| part_in(tests, r.index, cell));
            if parts.iter().all(Option::is_none) {
                children[0].push(r);
                continue;
            }
            for ((child, cell), part) in children.iter_mut().zip(cells).zip(parts) {
                if let Some(part) = part {
                    child.push(Reference { index: r.index, bounds: part.bounds, middle: part.middle, cell });
                }
            }
        }
        children
    }
}

/// The boxes of a triangle's parts in some bins of an axis: its corners, each in its bin, and the points where its
/// edges cross from one bin to the next, in both.
fn chop(
    corners: [Vec3; 3],
    axis: usize,
    bin: impl Fn(f32) -> usize,
    edge: impl Fn(usize) -> f32,
    parts: &mut [Box3; BINS],
    wanted: RangeInclusive<usize>,
) {
    let (least, most) = (*wanted.start(), *wanted.end());
    let mut include = |k: usize, place: Vec3| {
        if wanted.contains(&k) {
            parts[k] = parts[k].union(Box3 { min: place, max: place });
        }
    };
    for (i, p) in corners.into_iter().enumerate() {
        let q = corners[(i + 1) % 3];
        let (p, q) = if p[axis] <= q[axis] { (p, q) } else { (q, p) };
        let (first, last) = (bin(p[axis]), bin(q[axis]));
        include(first, p);
        include(last, q);
        for k in (first + 1).max(least)..=last.min(most + 1) {
            let s = ((edge(k) - p[axis]) / (q[axis] - p[axis])).clamp(0.0, 1.0);
            let mut place = p + (q - p) * s;
            place[axis] = edge(k);
            include(k - 1, place);
            include(k, place);
        }
    }
}
