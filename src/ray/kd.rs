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

use super::filter::Filter;
use super::observer::Observer;
use super::query_ray::TreeRay;
use super::triangle::hit_slack;
use super::{Hit, SetHit};
use crate::build::DEPTH_LIMIT;
use crate::motion::{PrimitiveSet, ULP};
use crate::tree::{KdTree, KdView};
use core::ops::ControlFlow;

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

impl KdTree {
    /// Calls `test` for the references that the ray meets, front to back, until it breaks. `test` returns the
    /// distance beyond which nothing matters any more.
    #[inline(always)]
    fn traverse(&self, ray: &TreeRay, observer: &mut impl Observer, mut test: impl FnMut(u32) -> ControlFlow<(), f32>) {
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
        let mut limit = ray.t_max;
        let mut stack = [Entry { node: 0, begin: 0.0, end: 0.0 }; DEPTH_LIMIT];
        let mut height = 0;
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
                        if in_far && height < DEPTH_LIMIT {
                            stack[height] = Entry { node: far, begin: begin.max(at - pad), end };
                            height += 1;
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
                        match test(reference.id) {
                            ControlFlow::Continue(nearer) => limit = nearer,
                            ControlFlow::Break(()) => return,
                        }
                    }
                }
            }
            loop {
                if height == 0 {
                    return;
                }
                height -= 1;
                let entry = stack[height];
                if entry.begin <= limit {
                    (node, begin, end) = (entry.node, entry.begin, entry.end.min(limit));
                    break;
                }
            }
        }
    }
}

/// The nearest accepted hit; ties go to the lowest id.
#[inline(always)]
pub(crate) fn closest<S: PrimitiveSet>(
    tree: &KdTree,
    set: &S,
    ray: &TreeRay,
    filter: &impl Filter,
    observer: &mut impl Observer,
) -> Option<Hit> {
    let mut best: Option<(SetHit, u32)> = None;
    let mut limit = ray.t_max;
    tree.traverse(ray, observer, |id| {
        if filter.sees(set.mask(id))
            && let Some(hit) = set.intersect(id, ray)
            && best.is_none_or(|(b, of)| hit.t < b.t || (hit.t == b.t && id < of))
            && filter.accepts(|| ray.answer(hit, set.name(id)))
        {
            best = Some((hit, id));
            limit = hit.t;
        }
        ControlFlow::Continue(limit)
    });
    best.map(|(hit, id)| ray.answer(hit, set.name(id)))
}

/// Whether there is any accepted hit.
#[inline(always)]
pub(crate) fn any<S: PrimitiveSet>(
    tree: &KdTree,
    set: &S,
    ray: &TreeRay,
    filter: &impl Filter,
    observer: &mut impl Observer,
) -> bool {
    let mut found = false;
    tree.traverse(ray, observer, |id| {
        found = filter.sees(set.mask(id))
            && set.intersect(id, ray).is_some_and(|hit| filter.accepts(|| ray.answer(hit, set.name(id))));
        if found { ControlFlow::Break(()) } else { ControlFlow::Continue(ray.t_max) }
    });
    found
}

/// Every accepted hit once, in no particular order, until the visitor breaks.
///
/// A primitive may be met in several leaves. The ids of those that were reported are remembered, so the
/// memory is that of the answer.
#[inline(always)]
pub(crate) fn all<S: PrimitiveSet>(
    tree: &KdTree,
    set: &S,
    ray: &TreeRay,
    filter: &impl Filter,
    observer: &mut impl Observer,
    mut visitor: impl FnMut(Hit) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let mut reported = Reported::default();
    let mut flow = ControlFlow::Continue(());
    tree.traverse(ray, observer, |id| {
        if filter.sees(set.mask(id))
            && let Some(hit) = set.intersect(id, ray)
            && !reported.contains(id)
        {
            let hit = ray.answer(hit, set.name(id));
            if filter.accepts(|| hit) {
                reported.insert(id);
                flow = visitor(hit);
                if flow.is_break() {
                    return ControlFlow::Break(());
                }
            }
        }
        ControlFlow::Continue(ray.t_max)
    });
    flow
}

/// The ids that were reported: a short list, and a hash set once it is no longer short.
#[derive(Default)]
struct Reported {
    few: Vec<u32>,
    many: std::collections::HashSet<u32>,
}

impl Reported {
    const FEW: usize = 24;

    fn contains(&self, id: u32) -> bool {
        self.few.contains(&id) || (!self.many.is_empty() && self.many.contains(&id))
    }

    fn insert(&mut self, id: u32) {
        if self.few.len() < Reported::FEW {
            self.few.push(id);
        } else {
            self.many.insert(id);
        }
    }
}
