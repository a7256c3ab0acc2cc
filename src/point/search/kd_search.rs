//! Traversal of the k-d layout: down to the leaf at the query first, then the far sides of planes, in the reverse order
//! of the descent.
//!
//! **Why no search loses a neighbour.** For each subtree the traversal keeps, per axis, how far the query is from the
//! planes that it has passed: `g = |s − q|` for a plane that is at s at the query's time, less the rounding of the plane.
//! A point below is computed at p with `p ≥ s − slack` (or `≤`, mirrored), so `|p − q| ≥ g − slack`, with the slack of any
//! subtree that the point is in: deeper subtrees have less slack if one distant point makes it large. The difference is
//! taken in f64 from a `g` lowered by 2^-50 of itself, more than f64 rounds in these steps, so it is below the exact
//! `|p − q|`; rounded to f32 it is at most the `|d|` that the point's distance is computed from, since rounding to
//! nearest is monotone. Squares and sums are taken in the order of [`squared`](crate::point::layout::view::squared), which is
//! monotone too: the subtree's distance is never above that of a point in it, and culling what is *strictly* farther
//! than the bound keeps ties.

use super::k_nearest::KNearest;
use super::radius::{Sink, search_blocks};
use super::{Keep, Observe};
use crate::kd::KdView;
use crate::limits::DEPTH_LIMIT;
use crate::point::layout::kd_points::{KdPointsView, plane_error};
use crate::point::layout::view::LeafView;
use crate::simd::Simd;
use core::ops::{ControlFlow, Range};
use glam::Vec3;

/// A subtree on the stack.
#[derive(Clone, Copy)]
struct Entry {
    node: u32,
    /// Lower bound of the squared distances in it.
    distance: f32,
    /// Lower bounds of the distances from the query to the subtree, per axis, without rounding of its points.
    gaps: [f64; 3],
}

/// Lower bound of the squared distances in a subtree with this slack.
#[inline(always)]
fn distance(gaps: &[f64; 3], slack: f64) -> f32 {
    let mut beyond = [0.0f32; 3];
    for (beyond, &gap) in beyond.iter_mut().zip(gaps) {
        *beyond = if gap > slack { (gap - slack) as f32 } else { 0.0 };
    }
    let [x, y, z] = beyond;
    (x * x + y * y) + z * z
}

/// The state of a traversal. For each plane on the path at most one side is on the stack.
pub(in crate::point) struct KdFront {
    waiting: [Entry; DEPTH_LIMIT + 1],
    count: usize,
}

impl KdFront {
    /// A traversal that begins at the root.
    #[inline(always)]
    pub(in crate::point) fn begin() -> KdFront {
        let root = Entry { node: 0, distance: 0.0, gaps: [0.0; 3] };
        KdFront { waiting: [root; DEPTH_LIMIT + 1], count: 1 }
    }

    /// The blocks of the next leaf that may hold points within the bound; `None` at the end.
    #[inline(always)]
    pub(in crate::point) fn next(
        &mut self,
        view: &KdPointsView<'_>,
        point: Vec3,
        bound: f32,
        mut node_visited: impl FnMut(),
    ) -> Option<Range<usize>> {
        loop {
            self.count = self.count.checked_sub(1)?;
            let Entry { mut node, distance: least, gaps } = self.waiting[self.count];
            if least > bound {
                continue;
            }
            loop {
                match view.tree.node(node) {
                    KdView::Leaf { first, count } => {
                        let first = first as usize;
                        return Some(first..first + count as usize);
                    }
                    KdView::Inner { plane, right } => {
                        node_visited();
                        let gap = plane.at(view.time) - f64::from(point[plane.axis]);
                        let (near, far) = if gap > 0.0 { (node + 1, right) } else { (right, node + 1) };
                        let beyond = gap.abs() * BELOW_ONE - plane_error(&plane);
                        let mut far_gaps = gaps;
                        let axis = &mut far_gaps[plane.axis];
                        *axis = if beyond > *axis { beyond } else { *axis };
                        let far_distance = distance(&far_gaps, view.tree.slack(far));
                        if far_distance <= bound {
                            self.waiting[self.count] = Entry { node: far, distance: far_distance, gaps: far_gaps };
                            self.count += 1;
                        }
                        // If the near side has much less slack, the planes above may cull it.
                        let slack = view.tree.slack(near);
                        if 2.0 * slack < view.tree.slack(node) && distance(&gaps, slack) > bound {
                            break;
                        }
                        node = near;
                    }
                }
            }
        }
    }
}

/// 1 − 2^-50.
const BELOW_ONE: f64 = 1.0 - 4.0 * f64::EPSILON;

/// Visits leaves, near sides of planes first, until no subtree within the bound is left.
#[inline(always)]
pub(in crate::point) fn walk<S: Simd, K: Keep, O: Observe>(
    s: S,
    view: &KdPointsView<'_>,
    point: Vec3,
    search: &mut KNearest<'_, K, O>,
) {
    let target = view.target(s, point);
    let mut front = KdFront::begin();
    while let Some(blocks) = front.next(view, point, search.cull(), || search.count_node()) {
        search.leaf(s, view, &target, blocks);
    }
}

/// Hands every point within the bound to the sink.
#[inline(always)]
pub(in crate::point) fn within<S: Simd, T: Sink<S>>(
    s: S,
    view: &KdPointsView<'_>,
    point: Vec3,
    bound: f32,
    sink: &mut T,
) -> ControlFlow<()> {
    let (target, wide_bound) = (view.target(s, point), s.splat(bound));
    let mut front = KdFront::begin();
    while let Some(blocks) = front.next(view, point, bound, || ()) {
        search_blocks(s, view, &target, wide_bound, blocks, sink)?;
    }
    ControlFlow::Continue(())
}
