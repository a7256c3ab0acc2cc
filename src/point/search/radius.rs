//! The radius search: traversal by masks, in no particular order.

use super::leaf_queue::LeafQueue;
use crate::limits::MAX_LEVELS;
use crate::point::layout::view::{LeafView, Target, View};
use crate::simd::{Mask, Simd};
use core::ops::{ControlFlow, Range};

/// Consumes the points of a block that lie within the radius.
pub(in crate::point) trait Sink<S: Simd> {
    /// Takes the lanes of `hits`. (Also if there are none: that costs less than a branch.)
    fn take<V: LeafView>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()>;
}

/// The state of a traversal: the children still to be visited, level by level.
#[derive(Clone, Copy, Debug)]
pub(in crate::point) struct Front {
    first: [usize; MAX_LEVELS],
    rest: [Mask; MAX_LEVELS],
    level: usize,
    node: usize,
    fresh: bool,
}

impl Front {
    /// A traversal that begins at the root.
    #[inline(always)]
    pub(in crate::point) fn begin<V: View>(view: &V) -> Front {
        let (level, node) = view.root();
        Front { first: [0; MAX_LEVELS], rest: [0; MAX_LEVELS], level, node, fresh: true }
    }

    /// The next bottom node with leaves within the radius, and the mask of these; `None` at the end.
    #[inline(always)]
    pub(in crate::point) fn next<S: Simd, V: View>(
        &mut self,
        s: S,
        view: &V,
        target: &Target<S>,
        bound: S::F,
    ) -> Option<(usize, Mask)> {
        let top = view.root().0;
        let mut fresh = core::mem::replace(&mut self.fresh, false);
        loop {
            if fresh {
                if self.level == 0 {
                    let within = s.le(view.boxes(s, target, self.node).0, bound);
                    self.level = 1;
                    if within != 0 {
                        return Some((self.node, within));
                    }
                } else {
                    self.rest[self.level] = s.le(view.boxes(s, target, self.node).0, bound);
                    self.first[self.level] = view.first_child(self.level, self.node);
                }
            }
            while self.level <= top && self.rest[self.level] == 0 {
                self.level += 1;
            }
            if self.level > top {
                return None;
            }
            let rest = self.rest[self.level];
            self.node = self.first[self.level] + rest.trailing_zeros() as usize;
            self.rest[self.level] = rest & (rest - 1);
            self.level -= 1;
            fresh = true;
        }
    }
}

/// Hands the points of some blocks that are within the bound to the sink.
#[inline(always)]
pub(in crate::point) fn search_blocks<S: Simd, V: LeafView, T: Sink<S>>(
    s: S,
    view: &V,
    target: &Target<S>,
    bound: S::F,
    blocks: Range<usize>,
    sink: &mut T,
) -> ControlFlow<()> {
    for block in blocks {
        let distance = view.point_distances(s, target, block);
        let hits = s.le(distance, bound);
        sink.take(s, view, block, distance, hits)?;
    }
    ControlFlow::Continue(())
}

/// Hands every point within the bound to the sink.
#[inline(always)]
pub(in crate::point) fn within<S: Simd, V: View, T: Sink<S>>(
    s: S,
    view: &V,
    target: &Target<S>,
    bound: f32,
    sink: &mut T,
) -> ControlFlow<()> {
    let bound = s.splat(bound);
    let mut front = Front::begin(view);
    let mut queue = LeafQueue::new();
    loop {
        while !queue.is_ready() {
            let Some((node, lanes)) = front.next(s, view, target, bound) else { break };
            queue.push_lanes(s, view, view.first_block(node), lanes);
        }
        if queue.is_empty() {
            return ControlFlow::Continue(());
        }
        for &leaf in queue.drain() {
            search_blocks(s, view, target, bound, leaf as usize..leaf as usize + view.leaf_blocks(), sink)?;
        }
    }
}
