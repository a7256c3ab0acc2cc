//! Interleaved traversal: several rays traverse the wide layout in turn, one block at a time.
//!
//! A ray that needs a block which is not in the cache would wait for it as long as dozens of tests take. So the block is prefetched, and
//! the other rays of the group advance until it has arrived. The answers do not depend on this. On a tree that fits the cache, interleaving
//! only costs time, so rays of small trees are traversed one by one. So are rays of mostly static trees, whose steps are short.

use super::batch::{Batch, BatchQuery, Member};
use super::intersect::RaySource;
use super::tree_ray::TreeRay;
use crate::simd::{Kernel, Simd};
use crate::traverse::{Cursor, StackOf, WideTraversal};

/// Rays that are traversed at the same time.
const GROUP: usize = 8;

/// A batch for interleaved traversal, to be dispatched to an instruction set.
pub(super) struct Interleaved<'a, G, Q: BatchQuery>(pub Batch<'a, G, Q>);

impl<G: RaySource, Q: BatchQuery> Kernel for Interleaved<'_, G, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let traverser = self.0.traverser();
        let Batch { tree, set, rays, answers, .. } = self.0;
        let traversal = WideTraversal::interleaved(&tree.arena);
        let mut waiting = rays.iter().enumerate().filter_map(|(i, ray)| Some((i, TreeRay::new(ray, set.frame())?)));
        let mut memory: [StackOf; GROUP] = core::array::from_fn(|_| StackOf::new());
        let mut group: Vec<(Member<'_, Q>, Cursor<'_>)> = Vec::with_capacity(GROUP);
        for (memory, (index, ray)) in memory.iter_mut().zip(&mut waiting) {
            let cursor = Cursor::new(tree.root, memory.stack(tree.max_stack()));
            group.push((Member::new(index, ray), cursor));
        }
        while !group.is_empty() {
            let mut i = 0;
            while i < group.len() {
                let (member, cursor) = &mut group[i];
                if traversal.advance(s, cursor, &mut member.query(&traverser, &mut ())).is_continue() {
                    traverser.arena.prefetch(cursor.at.at(), cursor.at.lines());
                    i += 1;
                    continue;
                }
                answers[member.index] = Q::answer(&member.collect, set);
                match waiting.next() {
                    Some((index, ray)) => {
                        *member = Member::new(index, ray);
                        cursor.restart(tree.root);
                        i += 1;
                    }
                    None => {
                        group.swap_remove(i);
                    }
                }
            }
        }
    }
}
