//! The best-first walk from the root to the bottom nodes.
//!
//! Per level one vector of keys: the bits of a child box's squared distance (order-preserving for
//! floats that are not negative), the low four replaced by the lane. The least key of a level is the
//! nearest child not yet visited. Replacing bits can raise a key by up to fifteen ulps above the
//! distance, so the comparison with the bound masks them away first; what is left never exceeds the
//! distance.

use crate::limits::MAX_LEVELS;
use crate::point::snapshot::{Leaves, Target, View};
use crate::simd::{LANES, Mask, Simd};
use core::ops::Range;

/// What is done with the bottom nodes that a walk comes to.
pub(in crate::point) trait Collect<S: Simd> {
    /// The squared distance above which boxes need not be visited (strictly).
    fn cull(&self) -> f32;
    /// A node's sixteen boxes are about to be tested.
    fn node(&mut self);
    /// Whether nothing was looked at yet: the way down to the first bottom node.
    fn fresh(&self) -> bool;
    /// Looks at the leaves of a bottom node, whose squared distances are `boxes`.
    fn bottom<V: View>(&mut self, s: S, view: &V, target: &Target<S>, node: usize, boxes: S::F);
    /// Looks at a leaf of a tree without boxes.
    fn leaf<V: Leaves>(&mut self, s: S, view: &V, target: &Target<S>, blocks: Range<usize>);
    /// The walk is over.
    #[inline(always)]
    fn end<V: Leaves>(&mut self, _s: S, _view: &V, _target: &Target<S>) {}
}

/// The bits of a key that say the lane.
pub(super) const LANE_BITS: u32 = LANES as u32 - 1;

/// A key is a lane that was visited or is absent.
const DONE: u32 = u32::MAX;

/// The lane indices.
pub(in crate::point) const LANE: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Distances as keys.
#[inline(always)]
pub(in crate::point) fn keys<S: Simd>(s: S, distances: S::F) -> S::U {
    (s.to_bits(distances) & s.splat_u(!LANE_BITS)) | s.load_u(&LANE)
}

/// Lane of a key, and a lower bound of its distance.
#[inline(always)]
pub(in crate::point) fn unpack(key: u32) -> (usize, f32) {
    ((key & LANE_BITS) as usize, f32::from_bits(key & !LANE_BITS))
}

/// The smallest of several boxes. What surrounds the point most tightly tells most about its neighbours; a box that is
/// large because it also holds a point far away tells nothing.
#[inline(always)]
pub(super) fn smallest<S: Simd, V: View>(s: S, view: &V, target: &Target<S>, node: usize, boxes: Mask) -> u32 {
    let sizes = s.select(boxes, view.box_sizes(s, target, node), s.splat(f32::INFINITY));
    let lane = s.reduce_min_u(keys(s, sizes)) & LANE_BITS;
    // Where sizes are too large for numbers, they may name any lane.
    if boxes >> lane & 1 != 0 { lane } else { boxes.trailing_zeros() }
}

/// Visits bottom nodes, nearest children first, until nothing within the bound is left.
#[inline(always)]
pub(in crate::point) fn walk<S: Simd, V: View, C: Collect<S>>(s: S, view: &V, target: &Target<S>, collect: &mut C) {
    let (top, root) = view.root();
    let mut open = [[DONE; LANES]; MAX_LEVELS];
    let mut next = [DONE; MAX_LEVELS];
    let mut first = [0; MAX_LEVELS];
    let (mut level, mut node) = (top, root);
    loop {
        collect.node();
        let (mut left, mut key);
        if level == 0 {
            let boxes = view.box_distances(s, target, node);
            collect.bottom(s, view, target, node, boxes);
            if top == 0 {
                return collect.end(s, view, target);
            }
            level = 1;
            left = s.load_u(&open[1]);
            key = next[1];
        } else {
            // The keys of a new node stay in a register: a detour through memory would hold up the next load.
            let (boxes, holding) = view.boxes(s, target, node);
            left = keys(s, boxes);
            // A box that holds the point is at distance 0, and the first of them has the least key.
            key = if holding == 0 {
                s.reduce_min_u(left)
            } else if holding & (holding - 1) != 0 && collect.fresh() {
                smallest(s, view, target, node, holding)
            } else {
                holding.trailing_zeros()
            };
            first[level] = view.first_child(level, node);
        }
        loop {
            let (lane, distance) = unpack(key);
            // The key of a finished lane unpacks to NaN, which is not within any bound.
            if distance <= collect.cull() {
                left = s.select_u(1 << lane, s.splat_u(DONE), left);
                s.store_u(left, &mut open[level]);
                next[level] = s.reduce_min_u(left);
                node = first[level] + lane;
                let (second, distance) = unpack(next[level]);
                if distance <= collect.cull() {
                    view.expect_node(first[level] + second);
                }
                level -= 1;
                break;
            }
            level += 1;
            if level > top {
                return collect.end(s, view, target);
            }
            left = s.load_u(&open[level]);
            key = next[level];
        }
    }
}
