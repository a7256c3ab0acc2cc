//! Interleaved traversal: several rays traverse the wide layout in turn, one block at a time.
//!
//! A ray that needs a block which is not in the cache would wait for it as long as dozens of tests take. So the block is
//! prefetched, and the other rays of the group advance until it has arrived. The answers do not depend on this. On a tree that fits
//! the cache, interleaving only costs time, so rays of small trees are traversed one by one. So are rays of mostly static trees,
//! whose steps are short.

use super::batch::{Batch, BatchQuery, Member, Way};
use crate::primitive::PrimitiveSet;
use crate::ray::filter::Filter;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::simd::Simd;
use crate::traverse::{Cursor, StackOf, WideTraversal};

/// Rays that are traversed at the same time.
const GROUP: usize = 8;

/// Interleaved traversal.
pub(in crate::ray) struct Interleaved;

impl Way for Interleaved {
    #[inline(always)]
    fn run<S: Simd, F: Filter, Q: BatchQuery>(s: S, batch: Batch<'_, F, Q>) {
        let traverser = batch.traverser();
        let Batch { tree, scene, filter, query, task, .. } = batch;
        let traversal = WideTraversal::interleaved(&tree.arena);
        let mut waiting = task.rays.iter().enumerate().filter_map(|(i, ray)| {
            let ray = TreeRay::new(ray, scene.frame())?;
            Some(Member::new(i, ray, query.collect(&ray, filter.accepts_all())))
        });
        let mut memory: [StackOf; GROUP] = core::array::from_fn(|_| StackOf::new());
        let mut group: Vec<(Member<'_, Q::Collect>, Cursor<'_>)> = Vec::with_capacity(GROUP);
        for (memory, member) in memory.iter_mut().zip(&mut waiting) {
            group.push((member, Cursor::new(tree.root, memory.stack(tree.max_stack()))));
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
                task.answers[member.ray.index] = Q::answer(member.collect, scene);
                match waiting.next() {
                    Some(next) => {
                        *member = next;
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
