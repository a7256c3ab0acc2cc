//! Streams of up to thirty-two rays in the wide layout.
//!
//! Rays that begin near each other visit many nodes in common, whatever their directions. So the rays of a stream that reach a node
//! are tested against it one after the other, and each child is visited with the rays that meet it. A ray that is traversed alone
//! waits for each of its steps; in a stream the tests of one ray overlap with those of the next, and no branch depends on their
//! results. (Compare Barringer and Akenine-Möller, "Dynamic Ray Stream Traversal", 2014.)
//!
//! Tests and leaf blocks are those of single rays, so the answers do not depend on this.

use super::batch::{Batch, BatchQuery, Member, Task, Way};
use super::collect::Collect;
use super::traverser::Traverser;
use crate::layout::{ChildRef, Kind, NODE_ROWS, STATIC_NODE_ROWS, WideTree};
use crate::primitive::PrimitiveSet;
use crate::ray::filter::Filter;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::simd::{LANES, Simd, Stack, StackMemory};
use crate::traverse::{Cursor, STACK, StackOf, WideTraversal, children_of, of_time_slice};

/// The rays of a stream: one bit of a word for each.
const RAYS: usize = u32::BITS as usize;

/// Traversal in streams.
pub(in crate::ray) struct Streams;

/// A block, and the rays that will visit it.
#[derive(Clone, Copy)]
struct Visit {
    at: ChildRef,
    /// One bit for each ray.
    rays: u32,
    /// The least of the rays' keys; 0 where order does not matter.
    key: f32,
}

impl Visit {
    const NONE: Visit = Visit { at: ChildRef::NOTHING, rays: 0, key: 0.0 };
}

/// The state of the traversal.
struct Traversal<'a, F, C> {
    tree: &'a WideTree,
    traverser: Traverser<'a, F>,
    /// The rays of the stream come first; the others are unused.
    members: [Member<'a, C>; RAYS],
    /// The rays whose answers may change.
    open: u32,
    pending: Stack<'a, Visit>,
    /// For a ray that is traversed alone.
    cursor: Cursor<'a>,
}

impl Way for Streams {
    #[inline(always)]
    fn run<S: Simd, F: Filter, Q: BatchQuery>(s: S, batch: Batch<'_, F, Q>) {
        let traverser = batch.traverser();
        let Batch { tree, outline, scene, filter, query, task: Task { rays, answers, .. } } = batch;
        let all = filter.accepts_all();
        let Some(first) = rays.first() else { return };
        let (mut memory, mut own_memory) = (StackMemory::<Visit, STACK>::new(), StackOf::new());
        let unused = TreeRay::of(first, scene.frame(), f32::INFINITY).0;
        let mut traversal = Traversal {
            tree,
            traverser,
            members: [Member::new(0, unused, query.collect(&unused, all)); RAYS],
            open: 0,
            pending: memory.stack(tree.max_stack()),
            cursor: Cursor::new(tree.root, own_memory.stack(tree.max_stack())),
        };
        let mut next = 0;
        while next < rays.len() {
            let mut count = 0;
            while count < RAYS
                && let Some(ray) = rays.get(next)
            {
                next += 1;
                if outline.is_missed(s, ray, scene.frame()) {
                    continue;
                }
                // The ray is constructed in place. Moving it would copy it by wide loads, which stall on the preceding narrow
                // stores.
                let (of, regular) = TreeRay::of(ray, scene.frame(), f32::INFINITY);
                let member = &mut traversal.members[count];
                *member = Member::new(next - 1, of, query.collect(&of, all));
                if !regular {
                    member.ray.recompute(scene.frame(), f32::INFINITY);
                    member.collect = query.collect(&member.ray, all);
                }
                count += usize::from(!member.ray.has_empty_range());
            }
            traversal.traverse(s, count);
            for member in &traversal.members[..count] {
                answers[member.ray.index] = Q::answer(member.collect, scene);
            }
        }
    }
}

impl<F: Filter, C: Collect> Traversal<'_, F, C> {
    /// Traverses the tree with the first `count` members.
    #[inline(always)]
    fn traverse<S: Simd>(&mut self, s: S, count: usize) {
        self.open = ((1u64 << count) - 1) as u32;
        self.pending.clear();
        self.pending.push(Visit { at: self.tree.root, rays: self.open, key: 0.0 });
        while let Some(visit) = self.pending.pop() {
            let rays = visit.rays & self.open;
            let several = rays & rays.wrapping_sub(1) != 0;
            match visit.at.kind() {
                _ if self.traverser.hides(visit.at) => {}
                Kind::Node if several => self.enter::<S, NODE_ROWS>(s, visit.at, rays),
                Kind::StaticNode if several => self.enter::<S, STATIC_NODE_ROWS>(s, visit.at, rays),
                Kind::Time if several => self.enter_time_slices(visit, rays),
                _ => self.singly(s, visit, rays),
            }
        }
    }

    /// Tests some rays against the boxes of a node. If order matters, the child that any of them enters first is visited first.
    #[inline(always)]
    fn enter<S: Simd, const ROWS: usize>(&mut self, s: S, node: ChildRef, mut rays: u32) {
        let block = self.tree.arena.block(node.at());
        let (mut visitors, mut keys) = (s.splat_u(0), s.splat(f32::INFINITY));
        while rays != 0 {
            let i = rays.trailing_zeros();
            rays &= rays - 1;
            let member = &self.members[i as usize % RAYS];
            let (met, key) = member.ray.slabs.enter::<S, ROWS>(s, block, member.collect.reach());
            visitors = visitors | s.select_u(met, s.splat_u(1 << i), s.splat_u(0));
            if C::ORDERED {
                keys = s.select(met, s.min_signed(keys, key), keys);
            }
        }
        let met = !s.eq_u(visitors, s.splat_u(0));
        let (mut of, mut children, mut near) = ([0; LANES], [0; LANES], [0.0; LANES]);
        s.store_compressed_u(visitors, met, &mut of);
        s.store_compressed_u(s.to_bits(s.load(children_of::<ROWS>(block))), met, &mut children);
        if C::ORDERED {
            s.store_compressed(keys, met, &mut near);
        }
        let mut visits = [Visit::NONE; LANES];
        // The remainder makes a bounds check unnecessary.
        let visits = &mut visits[..met.count_ones() as usize % (LANES + 1)];
        for (i, visit) in visits.iter_mut().enumerate() {
            *visit = Visit { at: ChildRef(children[i]), rays: of[i], key: near[i] };
        }
        if C::ORDERED {
            farthest_first(visits);
        }
        for &visit in &*visits {
            self.tree.arena.prefetch_block(visit.at.at());
            self.pending.push(visit);
        }
    }

    /// Visits the subtree of a time slice with the rays whose times lie in it, and leaves the other rays for later.
    #[inline(always)]
    fn enter_time_slices(&mut self, visit: Visit, rays: u32) {
        let (mut first, mut same, mut left) = (None, 0, rays);
        while left != 0 {
            let i = left.trailing_zeros();
            left &= left - 1;
            let time = self.members[i as usize % RAYS].ray.time();
            let child = of_time_slice(&self.tree.arena, visit.at, time);
            same |= u32::from(child == *first.get_or_insert(child)) << i;
        }
        if same != rays {
            self.pending.push(Visit { rays: rays & !same, ..visit });
        }
        if let Some(at) = first {
            self.pending.push(Visit { at, rays: same, key: visit.key });
        }
    }

    /// Traverses a subtree with some of the rays, one after the other.
    #[inline(always)]
    fn singly<S: Simd>(&mut self, s: S, visit: Visit, mut rays: u32) {
        let traversal = WideTraversal::new(&self.tree.arena);
        while rays != 0 {
            let i = rays.trailing_zeros();
            rays &= rays - 1;
            let (member, observer) = (&mut self.members[i as usize % RAYS], &mut ());
            if C::ORDERED && visit.key > member.ray.slabs.key(member.collect.reach()) {
                continue;
            }
            let mut query = member.query(&self.traverser, observer);
            self.cursor.restart(visit.at);
            while traversal.advance(s, &mut self.cursor, &mut query).is_continue() {}
            self.open &= !(u32::from(member.collect.is_final()) << i);
        }
    }
}

/// Sorts visits by key, the greatest first. There are few, so it sorts by insertion.
#[inline(always)]
fn farthest_first(visits: &mut [Visit]) {
    for i in 1..visits.len() {
        let mut place = i;
        while place > 0 && visits[place - 1].key < visits[place].key {
            visits.swap(place - 1, place);
            place -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_last_and_of_equal_keys_the_order_stays() {
        let mut visits: Vec<Visit> = [2.0, 0.5, 7.0, 0.5, 3.0]
            .into_iter()
            .enumerate()
            .map(|(i, key)| Visit { at: ChildRef::NOTHING, rays: i as u32, key })
            .collect();
        farthest_first(&mut visits);
        assert!(visits.iter().map(|visit| visit.rays).eq([2, 4, 0, 1, 3]));
        farthest_first(&mut []);
    }
}
