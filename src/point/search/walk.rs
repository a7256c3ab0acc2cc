//! Best-first traversal from the root to the bottom nodes, collecting the k nearest.
//!
//! Each level has one vector of [`keys`]: the least key of a level is the nearest child not yet visited. Leaves are
//! visited in one place of the code, after a bottom node or at the end: the code that is inlined there is large.

use super::k_nearest::KNearest;
use super::keys::{keys, smallest, unpack};
use super::{Keep, Observe};
use crate::limits::MAX_LEVELS;
use crate::point::layout::view::{Target, View};
use crate::simd::{LANES, Simd};

/// The key of a lane that was visited or is absent.
const DONE: u32 = u32::MAX;

/// Visits bottom nodes, nearest children first, until no child within the bound is left.
#[inline(always)]
pub(in crate::point) fn walk<S: Simd, V: View, K: Keep, O: Observe>(
    s: S,
    view: &V,
    target: &Target<S>,
    search: &mut KNearest<'_, K, O>,
) {
    let (top, root) = view.root();
    let mut open = [[DONE; LANES]; MAX_LEVELS];
    let mut next = [DONE; MAX_LEVELS];
    let mut first = [0; MAX_LEVELS];
    let (mut level, mut node) = (top, root);
    loop {
        search.count_node();
        let (mut left, mut key);
        let (mut over, mut look) = (false, false);
        if level == 0 {
            let (boxes, _) = view.boxes(s, target, node);
            look = search.push_leaves(s, view, target, node, boxes);
            let again = search.has_waiting_leaves();
            over = top == 0 && !again;
            level = usize::from(!again);
            left = s.load_u(&open[1]);
            key = next[1];
        } else {
            // The keys of a new node stay in a register: a round trip through memory would delay the next load.
            let (boxes, holding) = view.boxes(s, target, node);
            left = keys(s, boxes);
            // A box that holds the point is at distance 0, and the first of them has the least key.
            key = if holding == 0 {
                s.reduce_min_u(left)
            } else if holding & (holding - 1) != 0 && search.at_start() {
                smallest(s, view, target, node, holding)
            } else {
                holding.trailing_zeros()
            };
            first[level] = view.first_child(level, node);
        }
        loop {
            if look | over {
                search.visit_leaves(s, view, target);
                look = false;
            }
            if over {
                return;
            }
            if level == 0 {
                // Other leaves of the same node.
                break;
            }
            let (lane, distance) = unpack(key);
            // The key of a finished lane unpacks to NaN, which is not within any bound.
            if distance <= search.cull() {
                left = s.select_u(1 << lane, s.splat_u(DONE), left);
                s.store_u(left, &mut open[level]);
                next[level] = s.reduce_min_u(left);
                node = first[level] + lane;
                let (second, distance) = unpack(next[level]);
                if distance <= search.cull() {
                    view.prefetch_node(first[level] + second);
                }
                level -= 1;
                break;
            }
            level += 1;
            over = level > top;
            if !over {
                left = s.load_u(&open[level]);
                key = next[level];
            }
        }
    }
}
