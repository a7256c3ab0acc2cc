//! Everything within a radius: masks all the way down, in no particular order.

use super::Observe;
use crate::neighbor::view::{MAX_LEVELS, Target, View};
use super::walk::LANE;
use crate::simd::{LANES, Mask, Simd, StackMemory};
const LIST: usize = 256;
const OFFSETS: [[u32; LANES]; 2] = [LANE, [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30]];

use core::ops::ControlFlow;

/// What is done with the points of a block that lie within the radius.
pub(in crate::neighbor) trait Sink<S: Simd> {
    const ALWAYS: bool = false;
    /// Takes the lanes of `hits`, which is not empty.
    fn take<V: View>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()>;
}

/// Where a search stands: the children still to be visited, level by level.
#[derive(Clone, Copy, Debug)]
pub(in crate::neighbor) struct Front {
    first: [usize; MAX_LEVELS],
    rest: [Mask; MAX_LEVELS],
    level: usize,
    node: usize,
    fresh: bool,
}

impl Front {
    /// Before the root.
    #[inline(always)]
    pub(in crate::neighbor) fn begin<V: View>(view: &V) -> Front {
        let (level, node) = view.root();
        Front { first: [0; MAX_LEVELS], rest: [0; MAX_LEVELS], level, node, fresh: true }
    }

    /// The next bottom node with leaves within the radius, and the mask of these; nothing at the end.
    #[inline(always)]
    pub(in crate::neighbor) fn next<S: Simd, V: View, O: Observe>(
        &mut self,
        s: S,
        view: &V,
        target: &Target<S>,
        bound: S::F,
        observe: &mut O,
    ) -> Option<(usize, Mask)> {
        let top = view.root().0;
        let mut fresh = core::mem::replace(&mut self.fresh, false);
        loop {
            if fresh {
                observe.node();
                if self.level == 0 {
                    let within = s.le(view.leaf_distances(s, target, self.node), bound);
                    self.level = 1;
                    if within != 0 {
                        return Some((self.node, within));
                    }
                } else {
                    self.rest[self.level] = s.le(view.box_distances(s, target, self.node), bound);
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

/// Tests the leaves of a mask and hands what is within the bound to the sink.
#[inline(always)]
pub(in crate::neighbor) fn leaves<S: Simd, V: View, T: Sink<S>, O: Observe>(
    s: S,
    view: &V,
    target: &Target<S>,
    bound: S::F,
    (node, lanes): (usize, Mask),
    sink: &mut T,
    observe: &mut O,
) -> ControlFlow<()> {
    let first = view.first_block(node);
    let mut rest = lanes;
    while rest != 0 {
        let leaf = first + rest.trailing_zeros() as usize * view.leaf_blocks();
        rest &= rest - 1;
        for block in leaf..leaf + view.leaf_blocks() {
            observe.block();
            let distance = view.point_distances(s, target, block);
            let hits = s.le(distance, bound);
            if hits != 0 {
                sink.take(s, view, block, distance, hits)?;
            }
        }
    }
    ControlFlow::Continue(())
}

/// Hands every point within the bound to the sink.
#[inline(always)]
pub(in crate::neighbor) fn within<S: Simd, V: View, T: Sink<S>, O: Observe>(
    s: S,
    view: &V,
    target: &Target<S>,
    bound: f32,
    sink: &mut T,
    observe: &mut O,
) -> ControlFlow<()> {
    let bound = s.splat(bound);
    let mut front = Front::begin(view);
    let mut memory = StackMemory::<u64, LIST>::new();
    let mut leaves = memory.stack();
    let leaf_blocks = view.leaf_blocks();
    let offsets = s.load_u(&OFFSETS[leaf_blocks - 1]);
    loop {
        let mut count = 0;
        while count <= LIST - LANES {
            let Some((node, lanes)) = front.next(s, view, target, bound, observe) else { break };
            let first = s.splat_u(view.first_block(node) as u32);
            let n = lanes.count_ones() as usize;
            leaves.push_lanes(s, s.compress_u(s.add_u(first, offsets), lanes), n);
            count += n;
        }
        if count == 0 {
            return ControlFlow::Continue(());
        }
        while let Some(leaf) = leaves.pop() {
            let leaf = leaf as usize;
            for block in leaf..leaf + leaf_blocks {
                observe.block();
                let distance = view.point_distances(s, target, block);
                let hits = s.le(distance, bound);
                if T::ALWAYS || hits != 0 {
                    sink.take(s, view, block, distance, hits)?;
                }
            }
        }
    }
}
