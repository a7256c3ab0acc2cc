//! Ray queries over the k-d layout: front to back, ordinary k-d traversal (section 3.2 of the paper).
//!
//! Why no hit is missed. Let the kernel accept primitive `p` at time `T` and distance `t`. Then the point `X` of
//! the ray at `t` is within `e` (per axis) of a point `Q` of the true primitive: [`hit_slack`]. The build keeps
//! this invariant: in every node whose closed cell holds `Q` on the way down, `p` has a reference with `T` in its
//! interval; if `Q` lies strictly on one side of a plane, that side has it (classification rounds outward), and if
//! `Q` lies in the plane, at least one side has it. So some leaf has the reference and holds `Q`, and `X` is
//! within `e` of its cell.
//!
//! The traversal keeps for every visited node a range of `t` that contains all `t` in the ray's range at which the
//! ray is within `e` of the node's cell. At the root this is the clipped ray. At a plane `s` with `d > 0` the left
//! cell is reached for `o + t d <= s + e`, so for `t <= (s - o) / d + e / |d|`, and the right one for `t >= (s - o)
//! / d - e / |d|`. Computing `(s - o) * (1 / d)` errs by less than 4 ULP of `(1 + |o|) / |d|`, `s` itself by less
//! than 4 ULP where the plane moves: both are added to `e`. Therefore that leaf is visited with a range that
//! contains `t`, unless an answer strictly nearer than the begin of the range has been found.
//!
//! A direction component of zero is replaced by 1e-25: the ray then errs by less than 1e-14 of the scene, far below
//! `e`, and every product stays finite, so there is no case of its own and no NaN.

use super::collect::{Collect, Found};
use super::filter::Filter;
use super::intersect::RaySource;
use super::observer::Observer;
use super::tree_ray::TreeRay;
use super::triangle::hit_slack;
use super::walk::Walk;
use crate::geometry::ULP;
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
    #[inline]
    fn new(ray: &TreeRay) -> Axes {
        const LEAST: f32 = 1e-25;
        let slack = hit_slack(ray.origin) + 8.0 * ULP * (1.0 + ray.origin.abs().max_element());
        let mut axes = Axes { origin: [0.0; 4], inverse: [1.0; 4], pad: [0.0; 4] };
        for axis in 0..3 {
            let d = ray.dir[axis];
            let d = if d.abs() < LEAST { LEAST.copysign(d) } else { d };
            axes.origin[axis] = ray.origin[axis];
            axes.inverse[axis] = 1.0 / d;
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

impl Walk for &KdTree {
    /// Front to back; a primitive in several leaves is offered several times.
    #[inline(always)]
    fn walk<S: RaySource>(
        self,
        set: &S,
        ray: &TreeRay,
        filter: &impl Filter,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    ) {
        let axes = Axes::new(ray);
        let (mut begin, mut end) = (ray.t_min, ray.t_max);
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
        let mut node = 0u32;
        loop {
            match self.nodes[node as usize].view() {
                KdView::Inner { plane, right } => {
                    observer.node();
                    let axis = plane.axis & 3;
                    let at = axes.crossing(axis, plane.position + plane.velocity * ray.time);
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
                        if !reference.lives_at(ray.time) {
                            observer.time_skip();
                            continue;
                        }
                        observer.primitive_tests(1);
                        if filter.sees(|| set.mask(reference.id))
                            && let Some(hit) = set.intersect(reference.id, ray)
                            && hit.t <= collect.limit()
                            && collect.offer(Found { hit, id: reference.id })
                        {
                            return;
                        }
                    }
                }
            }
            // The next subtree that begins no farther than the best answer.
            let limit = collect.limit();
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
