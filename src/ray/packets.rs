//! Packets of up to sixteen rays in the wide layout.
//!
//! Rays of neighbouring pixels visit mostly the same nodes. So the sixteen boxes of a node are tested once for all rays of a packet
//! ([`Packet`]), and then the few remaining boxes are tested once each against sixteen rays. Rays are traversed one by one in leaf
//! blocks, and wherever too few of them are left for packet tests to pay. The answers do not depend on this.

use super::batch::{Batch, BatchQuery, Member};
use super::filter::Everything;
use super::intersect::RaySource;
use super::packet::Packet;
use super::root_box::RootBox;
use super::traverser::Traverser;
use super::tree_ray::TreeRay;
use crate::layout::{ChildRef, Kind, LANES_OF_NODE, NODE_ROWS, STATIC_NODE_ROWS, WideTree};
use crate::simd::{Kernel, LANES, Mask, Simd, Stack};
use crate::traverse::{Cursor, StackOf, WideTraversal, children_of, push_in_order};

/// If at most this many rays are left (half a packet), they are traversed one by one: their own tests then cost no more than those of
/// the packet.
const ALONE: u32 = LANES as u32 / 2;

/// A batch that is traversed in packets, to be dispatched to an instruction set.
pub(super) struct Packets<'a, G, Q: BatchQuery>(pub Batch<'a, G, Q>);

/// The state of the traversal.
struct Traversal<'a, G, Q: BatchQuery> {
    tree: &'a WideTree,
    traverser: Traverser<'a, G, Everything>,
    /// The rays of the packet come first; the others are unused.
    members: [Member<'a, Q>; LANES],
    packet: Packet,
    /// The pending lanes of nodes: keys in the high halves, references in the low halves.
    stack: Stack<'a, u64>,
    /// For a ray that is traversed alone.
    cursor: Cursor<'a>,
}

impl<G: RaySource, Q: BatchQuery> Kernel for Packets<'_, G, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let traverser = self.0.traverser();
        let Batch { tree, set, rays, answers } = self.0;
        let Some(first) = rays.first() else { return };
        let (mut memory, mut own_memory) = (StackOf::new(), StackOf::new());
        let mut traversal = Traversal::<'_, G, Q> {
            tree,
            traverser,
            members: core::array::from_fn(|_| Member::new(0, TreeRay::of(first, set.frame()).0)),
            packet: Packet::empty(),
            stack: memory.stack(tree.max_stack()),
            cursor: Cursor::new(tree.root, own_memory.stack(tree.max_stack())),
        };
        let root_box = RootBox::of(s, tree);
        let mut next = 0;
        loop {
            let mut count = 0;
            while count < LANES
                && let Some(ray) = rays.get(next)
            {
                // The ray is constructed in place. Moving it would copy it by wide loads, which stall on the preceding narrow stores.
                let (of, regular) = TreeRay::of(ray, set.frame());
                if regular & root_box.is_missed_by(&of) {
                    next += 1;
                    continue;
                }
                let member = &mut traversal.members[count];
                *member = Member::new(next, of);
                if !regular {
                    member.ray.recompute(set.frame());
                    member.collect = Q::collect(&member.ray);
                }
                if member.ray.has_empty_range() {
                    next += 1;
                    continue;
                }
                let in_packet = traversal.packet.takes(&member.ray);
                if !in_packet && count > 0 {
                    break;
                }
                if in_packet {
                    traversal.packet.add(&member.ray);
                }
                (count, next) = (count + 1, next + 1);
                if !in_packet {
                    break;
                }
            }
            if count == 0 {
                return;
            }
            traversal.traverse(s, count);
            for member in &traversal.members[..count] {
                answers[member.index] = Q::answer(&member.collect, set);
            }
            traversal.packet = Packet::empty();
        }
    }
}

impl<G: RaySource, Q: BatchQuery> Traversal<'_, G, Q> {
    /// Traverses the tree with the first `count` members: a packet, or a single ray that no packet takes.
    #[inline(always)]
    fn traverse<S: Simd>(&mut self, s: S, count: usize) {
        self.stack.clear();
        let (mut at, mut active) = (self.tree.root, ((1u32 << count) - 1) as Mask);
        loop {
            let mut entered = match at.kind() {
                Kind::Node if active.count_ones() > ALONE => self.enter::<S, NODE_ROWS>(s, at),
                Kind::StaticNode if active.count_ones() > ALONE => self.enter::<S, STATIC_NODE_ROWS>(s, at),
                _ => {
                    self.singly(s, at, active);
                    None
                }
            };
            loop {
                let Some(lane) = entered.take().or_else(|| self.pop()) else { return };
                let block = self.tree.arena.block(lane.at());
                let children = match lane.kind() {
                    Kind::Node => {
                        active = self.packet.meet::<S, NODE_ROWS>(s, block, lane.lane());
                        children_of::<NODE_ROWS>(block)
                    }
                    _ => {
                        active = self.packet.meet::<S, STATIC_NODE_ROWS>(s, block, lane.lane());
                        children_of::<STATIC_NODE_ROWS>(block)
                    }
                };
                if active != 0 {
                    at = ChildRef(children[lane.lane()].to_bits());
                    break;
                }
            }
        }
    }

    /// Pushes the lanes of a node that any ray may meet. If order matters and there are several lanes, the nearest one is returned
    /// instead.
    #[inline(always)]
    fn enter<S: Simd, const ROWS: usize>(&mut self, s: S, node: ChildRef) -> Option<ChildRef> {
        let (mask, keys) = self.packet.enter::<S, ROWS>(s, self.tree.arena.block(node.at()));
        let lanes = s.splat_u(node.first_lane().0) | s.load_u(&LANES_OF_NODE);
        if Q::ORDERED && mask & mask.wrapping_sub(1) != 0 {
            return Some(push_in_order::<S>(s, mask, keys, lanes, &mut self.stack));
        }
        self.stack.push_lanes(s, lanes, mask);
        None
    }

    /// Pops the next lane that is near enough to matter to some ray.
    #[inline(always)]
    fn pop(&mut self) -> Option<ChildRef> {
        loop {
            let entry = self.stack.pop()?;
            if f32::from_bits((entry >> 32) as u32) <= self.packet.limit() {
                return Some(ChildRef(entry as u32));
            }
        }
    }

    /// Traverses a subtree with some of the rays, one after the other.
    #[inline(always)]
    fn singly<S: Simd>(&mut self, s: S, at: ChildRef, mut active: Mask) {
        let traversal = WideTraversal::new(&self.tree.arena);
        while active != 0 {
            let i = active.trailing_zeros() as usize;
            active &= active - 1;
            let (member, observer) = (&mut self.members[i % LANES], &mut ());
            let mut query = member.query(&self.traverser, observer);
            self.cursor.restart(at);
            while traversal.advance(s, &mut self.cursor, &mut query).is_continue() {}
            self.packet.set_reach(i, Q::reach(&member.collect));
        }
        self.packet.update_limit(s);
    }
}
