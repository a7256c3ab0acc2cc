//! Ray queries over the k-d layout: front to back, ordinary k-d traversal (section 3.2 of the paper).
//!
//! Why no hit is missed. Let the kernel accept primitive `p` at time `T`, where the ray is at point `X`. A triangle is
//! tested in f64, so `X` is within [`KERNEL_ROUNDING`] of the scene's and the origin's largest coordinates, per axis,
//! of a point `Q` of the true triangle; for any other primitive `X` itself is `Q`, as its bounds promise
//! ([`Primitive`](crate::Primitive)). The build keeps this invariant: in every node whose closed cell holds `Q` on the
//! way down, `p` has a reference with `T` in its interval; if `Q` lies strictly on one side of a plane, that side has
//! it (classification rounds outward), and if `Q` lies in the plane, at least one side has it. So some leaf has the
//! reference and holds `Q`.
//!
//! The traversal keeps for every visited node a range of `t` that contains all `t` in the ray's range at which the ray
//! may be at such a point of the node's cell. At the root this is the clipped ray. At a plane `s` with `d > 0` the left
//! cell is reached for `o + t d <= s + e`, so for `t <= (s - o) / d + e / |d|`, and the right one for
//! `t >= (s - o) / d - e / |d|`. Computing `(s - o) * (1 / d)` and the ends of ranges has an error of less than 6 ULP
//! of `(|s| + |o|) / |d|`, and `s` itself, where the plane moves, of less than 2 ULP of its position and velocity: `e`
//! is 8 ULP of these, the kernel's rounding, and the ray's own slack. Only the kernel's rounding, in f64, grows with
//! the scene: cells of a small object beside a large one are distinguished as if the small one were alone. Therefore
//! that leaf is visited with a range that contains `t`, unless an answer strictly nearer than the beginning of the
//! range has been found.
//!
//! A component of the direction below [`LEAST_COMPONENT`] is replaced, as everywhere ([`TreeRay::slabs`]), so every
//! product stays finite, and there is no special case and no NaN. The ray then deviates along that axis by at most an
//! ULP of the distance it covers, which up to any hit is at most the largest coordinates of scene and origin together:
//! along that axis `e` is larger by twice as much.

use super::collect::{Collect, Found};
use super::ray_layout::RayLayout;
use crate::geometry::ULP;
use crate::kd::{KdTree, KdView};
use crate::limits::DEPTH_LIMIT;
use crate::primitive::{PrimitiveSet, Scene};
use crate::ray::filter::Filter;
use crate::ray::kernel::shear::Sheared;
use crate::ray::kernel::tree_ray::{LEAST_COMPONENT, TreeRay};
use crate::ray::observer::Observer;
use crate::simd::StackMemory;

/// A subtree on the stack, with the range of `t` in which the ray is near its cell.
#[derive(Clone, Copy)]
struct Entry {
    node: u32,
    begin: f32,
    end: f32,
}

/// The greatest distance between a triangle and a ray that hits it in the kernel, relative to the largest coordinate:
/// 32 roundings of f64, three times the error of the test.
pub(in crate::ray) const KERNEL_ROUNDING: f32 = 1.0 / (1u64 << 48) as f32;

/// Bound on the rounding error of the point where a ray crosses a plane, in ULP of the plane's position and of the
/// origin.
const CROSSING_ULPS: f32 = 8.0;

/// The constants of a ray per axis; the fourth entry makes any two-bit index valid.
struct Axes {
    origin: [f32; 4],
    inverse: [f32; 4],
    /// The slack `e` of a plane at zero, in units of `t`.
    pad: [f32; 4],
    /// The growth of the slack per unit of the plane's distance from zero.
    growth: [f32; 4],
}

impl Axes {
    /// The constants for a scene whose largest coordinate is `magnitude`.
    #[inline]
    fn new(ray: &TreeRay, magnitude: f32) -> Axes {
        let way = magnitude + ray.origin.into_iter().map(f32::abs).fold(0.0, f32::max);
        let mut axes = Axes { origin: [0.0; 4], inverse: [1.0; 4], pad: [0.0; 4], growth: [0.0; 4] };
        for axis in 0..3 {
            let (origin, inverse) = (ray.origin[axis], ray.slabs.inverse[axis]);
            let per_unit = inverse.abs();
            let deviation = if per_unit < 1.0 / LEAST_COMPONENT { 0.0 } else { 2.0 * ULP * way };
            let slack = ray.slack + KERNEL_ROUNDING * way + deviation + CROSSING_ULPS * ULP * origin.abs();
            axes.origin[axis] = origin;
            axes.inverse[axis] = inverse;
            axes.pad[axis] = slack * per_unit;
            axes.growth[axis] = CROSSING_ULPS * ULP * per_unit;
        }
        axes
    }

    /// The `t` at which the ray crosses a plane at `s`, which was computed from numbers of magnitude `of`, and the
    /// slack on either side.
    #[inline(always)]
    fn crossing(&self, axis: usize, s: f32, of: f32) -> (f32, f32) {
        ((s - self.origin[axis]) * self.inverse[axis], self.pad[axis] + self.growth[axis] * of)
    }
}

/// A direct-mapped mailbox: the ids of the primitives that a ray was tested against most recently.
///
/// A primitive in several leaves has the same answer in all of them, so testing it once is enough. If another id has
/// replaced it, the primitive is tested again, which costs time and does not change the answer.
struct Mailbox([u32; Mailbox::SLOTS]);

impl Mailbox {
    const SLOTS: usize = 256;

    /// No primitive has this id.
    const EMPTY: Mailbox = Mailbox([u32::MAX; Mailbox::SLOTS]);

    /// Inserts an id; returns whether it was absent.
    #[inline(always)]
    fn insert(&mut self, id: u32) -> bool {
        core::mem::replace(&mut self.0[id as usize % Mailbox::SLOTS], id) != id
    }
}

impl RayLayout for &KdTree {
    /// How fine its leaves are is not known.
    fn near(&self) -> f32 {
        f32::INFINITY
    }

    /// Front-to-back traversal; a primitive in several leaves may be offered several times.
    #[inline(always)]
    fn traverse(
        self,
        scene: &Scene,
        ray: &mut TreeRay,
        filter: &impl Filter,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) {
        let ray = &*ray;
        let (axes, sheared) = (Axes::new(ray, self.root.magnitude()), Sheared::new(ray));
        let (mut begin, mut end) = (ray.begin, ray.end);
        for axis in 0..3 {
            let (low, high) = (self.root.min[axis], self.root.max[axis]);
            let ((a, a_pad), (b, b_pad)) = (axes.crossing(axis, low, low.abs()), axes.crossing(axis, high, high.abs()));
            let pad = a_pad.max(b_pad);
            begin = begin.max(a.min(b) - pad);
            end = end.min(a.max(b) + pad);
        }
        if begin > end || self.nodes.is_empty() {
            return;
        }
        let mut memory = StackMemory::<Entry, DEPTH_LIMIT>::new();
        let mut stack = memory.stack(DEPTH_LIMIT);
        let mut mailbox = Mailbox::EMPTY;
        let mut node = 0u32;
        loop {
            match self.nodes[node as usize].view() {
                KdView::Inner { plane, right } => {
                    observer.node();
                    let axis = plane.axis & 3;
                    let size = plane.position.abs() + plane.velocity.abs();
                    let (at, pad) = axes.crossing(axis, plane.position + plane.velocity * ray.time(), size);
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
                        if !reference.is_active_at(ray.time()) {
                            observer.time_skip();
                            continue;
                        }
                        observer.primitive_tests(1);
                        if mailbox.insert(reference.id)
                            && filter.sees(|| scene.mask(reference.id))
                            && let Some(hit) = scene.intersect(reference.id, ray, &sheared)
                            && hit.t <= collect.limit()
                            && collect.offer(Found { hit, id: reference.id }, ray, scene, filter)
                        {
                            return;
                        }
                    }
                }
            }
            // Pop the next subtree that begins no farther than the best answer.
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
    use super::super::intersect::intersect_triangle;
    use super::*;
    use crate::geometry::Frame;
    use crate::random::Random;
    use crate::ray::Ray;
    use glam::Vec3;

    /// Counts hits of triangles on one side of a plane that an edge lies in, for which the range of the cell on that
    /// side does not contain `t`, if the padding is scaled by `part`. Planes and origins are at all distances from
    /// zero.
    fn hits_lost(part: f32) -> usize {
        let mut random = Random(77);
        let (mut hits, mut lost) = (0, 0);
        for i in 0..200_000 {
            let (mut a, mut b, mut c, mut origin) = (random.vec(), random.vec(), random.vec(), random.vec() * 3.0);
            let near = 10f32.powi(-(i % 7));
            (a.x, origin.x) = (a.x * near, origin.x * near);
            b.x = a.x;
            // The cell is on the side of lower x.
            c.x = a.x - c.x.abs();
            let target = a + (b - a) * (0.5 + 0.5 * random.signed());
            // With this length, distances in tree space are those of the answer.
            let dir = (target - origin) / (target - origin).abs().max_element() * 1.25;
            let original = Ray::new(origin, dir);
            let Some(ray) = TreeRay::new(&original, &Frame::WORLD) else { continue };
            let fine = || [a, b, c].map(Vec3::as_dvec3);
            let Some(hit) = intersect_triangle(&ray, &Sheared::new(&ray), [a, b, c], 0.0, fine) else { continue };
            let axes = Axes::new(&ray, a.abs().max(b.abs()).max(c.abs()).max_element());
            let (at, pad) = axes.crossing(0, a.x, a.x.abs());
            let within = if axes.inverse[0] > 0.0 { hit.t <= at + pad * part } else { at - pad * part <= hit.t };
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
