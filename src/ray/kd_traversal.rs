//! Ray queries over the k-d layout: front to back, ordinary k-d traversal (section 3.2 of the paper).
//!
//! Why no hit is missed. Let the kernel accept primitive `p` at time `T` and distance `t`. Then the point `X` of
//! the ray at `t` is within `e` (per axis) of a point `Q` of the true primitive: [`KERNEL_ULPS`] of the scene's and the
//! origin's largest coordinates (cells have no boxes of their own, so this is the same for all of them). The build keeps
//! this invariant: in every node whose closed cell holds `Q` on the way down, `p` has a reference with `T` in its
//! interval; if `Q` lies strictly on one side of a plane, that side has it (classification rounds outward), and if
//! `Q` lies in the plane, at least one side has it. So some leaf has the reference and holds `Q`, and `X` is
//! within `e` of its cell.
//!
//! The traversal keeps for every visited node a range of `t` that contains all `t` in the ray's range at which the
//! ray is within `e` of the node's cell. At the root this is the clipped ray. At a plane `s` with `d > 0` the left
//! cell is reached for `o + t d <= s + e`, so for `t <= (s - o) / d + e / |d|`, and the right one for `t >= (s - o)
//! / d - e / |d|`. Computing `(s - o) * (1 / d)` errs by less than 4 ULP of `(m + |o|) / |d|`, with `m` the scene's largest
//! coordinate, `s` itself by less than 4 ULP where the plane moves: both are added to `e`. Therefore that leaf is visited
//! with a range that contains `t`, unless an answer strictly nearer than the begin of the range has been found.
//!
//! Small direction components are replaced as everywhere ([`TreeRay::slabs`]), so every product stays finite, and there is
//! no case of its own and no NaN.

use super::collect::{Collect, Found};
use super::filter::Filter;
use super::intersect::RaySource;
use super::observer::Observer;
use super::shear::Sheared;
use super::tree_ray::TreeRay;
use super::walk::Walk;
use crate::geometry::{KERNEL_ULPS, ULP};
use crate::limits::DEPTH_LIMIT;
use crate::mbkd::{KdTree, KdView};
use crate::simd::StackMemory;

/// A subtree still to be visited, with the range of `t` in which the ray is near its cell.
#[derive(Clone, Copy)]
struct Entry {
    node: u32,
    begin: f32,
    end: f32,
}

/// What the traversal needs of a ray, per axis; the fourth entry makes any two-bit index valid.
struct Axes {
    origin: [f32; 4],
    inverse: [f32; 4],
    /// The slack `e` in units of `t`.
    pad: [f32; 4],
}

impl Axes {
    /// For a scene whose largest coordinate is `magnitude`.
    #[inline]
    fn new(ray: &TreeRay, magnitude: f32) -> Axes {
        let rounding = 8.0 * ULP * (magnitude + ray.origin.into_iter().map(f32::abs).fold(0.0, f32::max));
        let slack = ray.slack + KERNEL_ULPS * ULP * magnitude + rounding;
        let mut axes = Axes { origin: [0.0; 4], inverse: [1.0; 4], pad: [0.0; 4] };
        for axis in 0..3 {
            axes.origin[axis] = ray.origin[axis];
            axes.inverse[axis] = ray.slabs.inverse[axis];
            axes.pad[axis] = slack * axes.inverse[axis].abs();
        }
        axes
    }

    /// Where the ray crosses a plane.
    #[inline(always)]
    fn crossing(&self, axis: usize, s: f32) -> f32 {
        (s - self.origin[axis]) * self.inverse[axis]
    }
}

/// Ids of primitives that a ray was tested against lately, each at a place of its own among a few.
///
/// A primitive in several leaves has the same answer in all of them, so testing it once will do. Where another took its
/// place it is tested again, which costs time and changes nothing.
struct Tested([u32; Tested::PLACES]);

impl Tested {
    const PLACES: usize = 256;

    /// No id is this large.
    const NOTHING: Tested = Tested([u32::MAX; Tested::PLACES]);

    /// Whether the id is not among them; from now on it is.
    #[inline(always)]
    fn lacks(&mut self, id: u32) -> bool {
        core::mem::replace(&mut self.0[id as usize % Tested::PLACES], id) != id
    }
}

impl Walk for &KdTree {
    /// Front to back; a primitive in several leaves may be offered several times.
    #[inline(always)]
    fn walk<S: RaySource>(
        self,
        set: &S,
        ray: &TreeRay,
        filter: &impl Filter,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) {
        let (axes, sheared) = (Axes::new(ray, self.root.magnitude()), Sheared::new(ray));
        let (mut begin, mut end) = (ray.begin, ray.end);
        for axis in 0..3 {
            let (a, b) = (axes.crossing(axis, self.root.min[axis]), axes.crossing(axis, self.root.max[axis]));
            begin = begin.max(a.min(b) - axes.pad[axis]);
            end = end.min(a.max(b) + axes.pad[axis]);
        }
        if begin > end || self.nodes.is_empty() {
            return;
        }
        let mut memory = StackMemory::<Entry, DEPTH_LIMIT>::new();
        let mut stack = memory.stack(DEPTH_LIMIT);
        let mut tested = Tested::NOTHING;
        let mut node = 0u32;
        loop {
            match self.nodes[node as usize].view() {
                KdView::Inner { plane, right } => {
                    observer.node();
                    let axis = plane.axis & 3;
                    let at = axes.crossing(axis, plane.position + plane.velocity * ray.time());
                    let pad = axes.pad[axis];
                    let (near, far) = if axes.inverse[axis] > 0.0 { (node + 1, right) } else { (right, node + 1) };
                    let (in_near, in_far) = (begin <= at + pad, at - pad <= end);
                    if in_near {
                        if in_far {
                            stack.push(Entry { node: far, begin: begin.max(at - pad), end });
                        }
                        end = end.min(at + pad);
                        node = near;
                    } else {
                        begin = begin.max(at - pad);
                        node = far;
                    }
                    continue;
                }
                KdView::Leaf { first, count } => {
                    observer.leaf();
                    for reference in &self.references[first as usize..][..count as usize] {
                        if !reference.lives_at(ray.time()) {
                            observer.time_skip();
                            continue;
                        }
                        observer.primitive_tests(1);
                        if tested.lacks(reference.id)
                            && filter.sees(|| set.mask(reference.id))
                            && let Some(hit) = set.intersect(reference.id, ray, &sheared)
                            && hit.t <= collect.limit()
                            && collect.offer(Found { hit, id: reference.id })
                        {
                            return;
                        }
                    }
                }
            }
            // The next subtree that begins no farther than the best answer.
            let limit = collect.reach();
            loop {
                let Some(entry) = stack.pop() else { return };
                if entry.begin <= limit {
                    (node, begin, end) = (entry.node, entry.begin, entry.end.min(limit));
                    break;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Frame;
    use crate::random::Random;
    use crate::ray::Ray;
    use crate::ray::intersect::intersect_triangle;
    use glam::Vec3;

    /// Hits of triangles on one side of a plane, of which an edge lies in it, outside of the range of the cell on that side,
    /// if planes are padded by this part of what they should be.
    fn hits_lost(part: f32) -> usize {
        let mut random = Random(77);
        let (mut hits, mut lost) = (0, 0);
        for _ in 0..200_000 {
            let (a, mut b, mut c, origin) = (random.vec(), random.vec(), random.vec(), random.vec() * 3.0);
            b.x = a.x;
            // The cell is on the side of lower x.
            c.x = a.x - c.x.abs();
            let target = a + (b - a) * (0.5 + 0.5 * random.signed());
            // So long that distances in tree space are those of the answer.
            let dir = (target - origin) / (target - origin).abs().max_element() * 1.25;
            let asked = Ray::new(origin, dir);
            let Some(ray) = TreeRay::new(&asked, &Frame::WORLD) else { continue };
            let fine = || [a, b, c].map(Vec3::as_dvec3);
            let Some(hit) = intersect_triangle(&ray, &Sheared::new(&ray), [a, b, c], fine) else { continue };
            let axes = Axes::new(&ray, a.abs().max(b.abs()).max(c.abs()).max_element());
            let (at, pad) = (axes.crossing(0, a.x), axes.pad[0] * part);
            let within = if axes.inverse[0] > 0.0 { hit.t <= at + pad } else { at - pad <= hit.t };
            hits += 1;
            lost += usize::from(!within);
        }
        assert!(hits > 50_000, "{hits}");
        lost
    }

    #[test]
    fn ranges_hold_the_hits_in_their_cells_and_would_not_without_padding() {
        assert_eq!(hits_lost(1.0), 0);
        assert!(hits_lost(0.0) > 100);
    }
}
