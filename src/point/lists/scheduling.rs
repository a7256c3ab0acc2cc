//! Making lists on several threads that do not wait for each other, always in the same order.
//!
//! The lists of groups of points are made in parallel, and copied one behind the other to the memory of the caller.
//!
//! The slots form a ring. A thread takes the next group and makes its lists in the memory of the next slot, which is small
//! enough for a near cache. The output range of the lists is known when all groups before have been made. The thread that
//! completes them assigns the ranges of all groups for which this holds, and copies their lists there. The others make
//! further groups meanwhile. A thread waits only if all slots are made and not copied. Ranges depend on nothing but the
//! lists before.

use super::list_rows::{ListData, ListRows};
use crate::parallel::{self, lock};
use core::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Slots for each thread: enough that no thread waits for another that is late by a group or two, and few enough to stay
/// in a near cache together.
const SLOTS: usize = 4;

/// The number of slots for this thread's pool.
pub(super) fn slots() -> usize {
    SLOTS * parallel::threads()
}

/// How many times the results that are known those of the groups without room are expected to be at most.
const GROWTH: usize = 4;

/// The room that all results need, where the first `done` groups have `end` together and there is no room for the next of `left`
/// others. `made` are the numbers of results in the slots.
///
/// A group is expected to have as many as others on average. But the first ones may lie in a clump, where points have a thousand
/// times the usual number of neighbours. So the room grows in steps, each in proportion to what is known, and the largest group
/// always finds room.
fn room_for(end: usize, done: usize, left: usize, made: impl ExactSizeIterator<Item = usize> + Clone) -> usize {
    let (slots, most, sum) = (made.len().max(1), made.clone().max().unwrap_or(0), made.sum::<usize>());
    let usual = if done > 0 { end.div_ceil(done) } else { sum.div_ceil(slots) };
    end + most + usual.saturating_mul(left).min(end.max(sum).saturating_mul(GROWTH))
}

/// Makes the lists of so many groups in the memory of the workers, where `made` finds those of a group, and appends them to others
/// in the order of the groups.
pub(super) fn append_in_order<W: Send, D: ListData>(
    groups: usize,
    workers: &mut [W],
    lists: &mut ListRows<D>,
    make: impl Fn(usize, &mut W) + Sync,
    made: impl Fn(&W) -> &ListRows<D> + Sync,
) {
    let mut done = 0;
    while done < groups {
        let mut end = lists.end();
        done = {
            let ListRows { offsets, points, data } = &mut *lists;
            let mut room = data.room(end);
            let assign = |worker: &W| {
                let made = made(worker);
                let room = D::take(&mut room, made.end())?;
                points.extend_from_slice(&made.points);
                offsets.extend(made.offsets[1..].iter().map(|of_group| end + of_group));
                end += made.end();
                Some(room)
            };
            let copy = |worker: &W, room: D::Room<'_>| made(worker).data.fill(room);
            in_order(done..groups, workers, &make, assign, copy)
        };
        if done < groups {
            let made = workers.iter().map(|worker| made(worker).end());
            lists.data.make_room(room_for(lists.end(), done, groups - done, made));
        }
    }
}

/// The progress of all threads.
struct State<P> {
    /// The next group to be made, and the next whose output range is to be assigned.
    next: usize,
    front: usize,
    /// By slot: whether its group is made and has no output range yet, and whether the slot is empty.
    made: Vec<bool>,
    free: Vec<bool>,
    /// Whether no more groups are to be taken.
    stop: bool,
    assign: P,
}

/// Makes the groups of a range in slots, assigns output ranges in the order of the groups, and copies them there. Ends
/// when there is no room left, and returns the first group that was not copied.
fn in_order<W: Send, J>(
    groups: Range<usize>,
    slots: &mut [W],
    make: impl Fn(usize, &mut W) + Sync,
    assign: impl FnMut(&W) -> Option<J> + Send,
    copy: impl Fn(&W, J) + Sync,
) -> usize {
    let count = slots.len();
    let slots: Vec<Mutex<&mut W>> = slots.iter_mut().map(Mutex::new).collect();
    let (next, front) = (groups.start, groups.start);
    let state =
        Mutex::new(State { next, front, made: vec![false; count], free: vec![true; count], stop: false, assign });
    parallel::map(parallel::threads(), |_| {
        let _stop = StopAfterPanic(&state);
        while let Some(group) = take(&state, groups.end) {
            make(group, &mut lock(&slots[group % count]));
            let placed = assign_outputs(&state, group, &slots);
            for (group, job) in placed {
                copy(&lock(&slots[group % count]), job);
                lock(&state).free[group % count] = true;
            }
        }
    });
    state.into_inner().unwrap_or_else(PoisonError::into_inner).front
}

/// Takes the next group, once its slot is free.
fn take<P>(state: &Mutex<State<P>>, end: usize) -> Option<usize> {
    loop {
        let mut now = lock(state);
        let (group, count) = (now.next, now.free.len());
        if now.stop || group == end {
            return None;
        }
        if core::mem::take(&mut now.free[group % count]) {
            now.next += 1;
            return Some(group);
        }
        // What fills the ring is being made or copied by a thread that waits for nothing.
        drop(now);
        std::thread::yield_now();
    }
}

/// Called when a group has been made: the output ranges of all groups up to the first that is not made yet.
fn assign_outputs<W, J, P: FnMut(&W) -> Option<J>>(
    state: &Mutex<State<P>>,
    group: usize,
    slots: &[Mutex<&mut W>],
) -> Vec<(usize, J)> {
    let mut now = lock(state);
    let (now, count) = (&mut *now, slots.len());
    now.made[group % count] = true;
    let mut placed = Vec::new();
    while now.made[now.front % count] && !now.stop {
        // Made and without an output range: nobody holds it.
        match (now.assign)(&lock(&slots[now.front % count])) {
            Some(job) => placed.push((now.front, job)),
            None => {
                now.stop = true;
                break;
            }
        }
        now.made[now.front % count] = false;
        now.front += 1;
    }
    placed
}

/// Lets the other threads end where one panics.
struct StopAfterPanic<'a, P>(&'a Mutex<State<P>>);

impl<P> Drop for StopAfterPanic<'_, P> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            lock(self.0).stop = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_assigned_in_order() {
        for room in [1000, 37, 0] {
            let mut slots = vec![0; 3];
            let mut order = Vec::new();
            let copied = Mutex::new(vec![0; 1000]);
            let assign = |slot: &usize| {
                order.push(*slot);
                (order.len() <= room).then_some(order.len() - 1)
            };
            let done = in_order(
                5..200,
                &mut slots,
                |group, slot| *slot = group,
                assign,
                |&slot, assign| {
                    lock(&copied)[assign] = slot;
                },
            );
            let count = room.min(195);
            assert_eq!(done, 5 + count);
            assert!(lock(&copied)[..count].iter().copied().eq(5..5 + count));
        }
    }
}
