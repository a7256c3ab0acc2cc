//! Assembling the output of several threads in a fixed order.
//!
//! Each task is written into an arena of its own that stays in the cache. As soon as all tasks before it are in place
//! it is appended, and the references in its nodes are relocated: the order is that of the tasks, whichever thread
//! wrote them. A small arena whose blocks are in place is reused by the next task.

use crate::error::BuildError;
use crate::layout::wide_node::{ChildRef, NODE_ROWS, children_mut};
use crate::parallel::{self, lock};
use crate::simd::{Arena, LANES};
use core::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// The number of tasks, at most, and no more than every fourth, that are written first to estimate the size of all of
/// them. The fewer they are, the more blocks are copied while they are in the cache.
pub(crate) const FIRST: usize = 16;

/// Blocks in an arena of their own, not yet in place.
#[derive(Default)]
pub(crate) struct Fragment {
    pub arena: Arena,
    /// The nodes in it.
    pub nodes: Vec<ChildRef>,
    /// The blocks that the caller wants to know: the root of a subtree, or leaf blocks.
    pub tops: Vec<ChildRef>,
}

impl Fragment {
    fn clear(&mut self) {
        self.arena.clear();
        self.nodes.clear();
        self.tops.clear();
    }
}

/// Fragments that wait for those before them, and fragments to be reused.
struct Waiting {
    done: Vec<Option<Fragment>>,
    spare: Vec<Fragment>,
}

/// The final arena, and the state of assembly.
struct InOrder<'a> {
    arena: &'a mut Arena,
    /// Relative sizes of the tasks.
    sizes: &'a [u32],
    further: usize,
    next: usize,
    tops: Vec<ChildRef>,
    /// Words, and relative sizes, of the tasks that are in place.
    words: usize,
    placed: f64,
}

/// Writes a task into a fragment.
type Write<'a> = &'a (dyn Fn(usize, &mut Fragment) -> Result<(), BuildError> + Sync);

impl InOrder<'_> {
    /// Appends all fragments whose turn has come. Children that are not `inside` a fragment are in the final arena
    /// already.
    fn put(&mut self, waiting: &Mutex<Waiting>, inside: &dyn Fn(ChildRef) -> bool) -> Result<(), BuildError> {
        loop {
            let ready = lock(waiting).done.get_mut(self.next).and_then(Option::take);
            let Some(mut fragment) = ready else { return Ok(()) };
            let words = fragment.arena.len() + LANES;
            self.words += words;
            self.placed += f64::from(self.sizes[self.next]);
            if self.arena.room() < words {
                // The estimate was too low. Extrapolate from the tasks that are in place.
                let rest = total(&self.sizes[self.next + 1..]) * (self.words as f64 / self.placed.max(1.0));
                self.arena.reserve_exact(words + (rest * SPARE) as usize + above(self.sizes.len()) + self.further);
            }
            let by = self.arena.append(&fragment.arena);
            let moved = |child: ChildRef| child.moved(by).ok_or(BuildError::TooLargeTree);
            for &node in &fragment.nodes {
                for word in children_mut(self.arena, moved(node)?) {
                    let child = ChildRef(*word);
                    if child != ChildRef::NOTHING && inside(child) {
                        *word = moved(child)?.0;
                    }
                }
            }
            for &top in &fragment.tops {
                self.tops.push(moved(top)?);
            }
            self.next += 1;
            fragment.clear();
            lock(waiting).spare.push(fragment);
        }
    }
}

/// Reserved words relative to the estimate.
const SPARE: f64 = 1.015;

/// The sum of sizes.
fn total<'a>(sizes: impl IntoIterator<Item = &'a u32>) -> f64 {
    sizes.into_iter().map(|&size| f64::from(size)).sum()
}

/// An upper estimate of the words of the nodes above so many subtrees.
fn above(subtrees: usize) -> usize {
    (subtrees / 4 + 1) * NODE_ROWS * LANES
}

/// Writes tasks separately and appends them in order; returns the top blocks. `sizes` are the relative sizes of the
/// tasks, and `inside` tells which children of nodes are written with them. The caller will append `further` words. The
/// size of all tasks is estimated by about `first` of them, [`FIRST`] unless the relative sizes are exact.
///
/// Each thread takes the next task, writes it into a fragment to be reused, and appends the fragments that are ready,
/// unless another thread is doing that: so few fragments wait, and data is copied while it is still in the caches.
pub(crate) fn write_in_order(
    arena: &mut Arena,
    sizes: &[u32],
    further: usize,
    first: usize,
    inside: &(dyn Fn(ChildRef) -> bool + Sync),
    write: Write<'_>,
) -> Result<Vec<ChildRef>, BuildError> {
    let n = sizes.len();
    if n == 1 {
        return write_at_end(arena, 0, write);
    }
    let step = n.div_ceil(first).max(4);
    let first = parallel::map(n.div_ceil(step), |i| {
        let mut fragment = Fragment::default();
        write(i * step, &mut fragment).map(|()| fragment)
    });
    let first = first.into_iter().collect::<Result<Vec<Fragment>, BuildError>>()?;
    let words: usize = first.iter().map(|fragment| fragment.arena.len() + LANES).sum();
    let expected = words as f64 * (total(sizes) / total(sizes.iter().step_by(step)).max(1.0));
    arena.reserve((expected * SPARE) as usize + above(n) + further);

    let mut done: Vec<Option<Fragment>> = core::iter::repeat_with(|| None).take(n).collect();
    done.iter_mut().step_by(step).zip(first).for_each(|(place, fragment)| *place = Some(fragment));
    let waiting = Mutex::new(Waiting { done, spare: Vec::new() });
    let in_order = InOrder { arena, sizes, further, next: 0, tops: Vec::with_capacity(n), words: 0, placed: 0.0 };
    let in_order = Mutex::new(in_order);
    let next = AtomicUsize::new(0);
    let threads = parallel::map(parallel::threads(), |_| {
        loop {
            let task = next.fetch_add(1, Ordering::Relaxed);
            if task >= n {
                return Ok(());
            }
            if !task.is_multiple_of(step) {
                let spare = lock(&waiting).spare.pop();
                let mut fragment = spare.unwrap_or_default();
                write(task, &mut fragment)?;
                lock(&waiting).done[task] = Some(fragment);
            }
            if let Ok(mut in_order) = in_order.try_lock() {
                in_order.put(&waiting, inside)?;
            }
        }
    });
    threads.into_iter().collect::<Result<(), BuildError>>()?;
    let mut in_order = in_order.into_inner().unwrap_or_else(PoisonError::into_inner);
    in_order.put(&waiting, inside)?;
    Ok(in_order.tops)
}

/// Writes a task straight to the end of the final arena, and returns its top blocks.
fn write_at_end(arena: &mut Arena, task: usize, write: Write<'_>) -> Result<Vec<ChildRef>, BuildError> {
    arena.align();
    let mut all = Fragment { arena: core::mem::take(arena), ..Fragment::default() };
    let written = write(task, &mut all);
    *arena = all.arena;
    arena.align();
    written.map(|()| all.tops)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::wide_node::Kind;

    #[test]
    fn tasks_larger_than_those_written_first_follow_in_order() {
        for n in [1, 2, 5, 64, 301] {
            let lines = |i: usize| if i.is_multiple_of(4) { 1 } else { 1 + i };
            let write = |i: usize, fragment: &mut Fragment| {
                let at = fragment.arena.grow(lines(i) * LANES);
                fragment.arena.ints_mut()[at..].fill(i as u32);
                fragment.tops.push(ChildRef::new(Kind::OtherLeaf, at, 1).ok_or(BuildError::TooLargeTree)?);
                Ok(())
            };
            let mut arena = Arena::default();
            let tops = write_in_order(&mut arena, &vec![1; n], 0, FIRST, &|_| false, &write).unwrap();
            assert_eq!(tops.len(), n);
            let mut expected = 0;
            for (i, top) in tops.iter().enumerate() {
                assert_eq!(top.at(), expected);
                assert!(arena.ints()[top.at()..][..lines(i) * LANES].iter().all(|&word| word == i as u32));
                expected += lines(i) * LANES;
            }
            assert_eq!(arena.len(), expected);
        }
    }
}
