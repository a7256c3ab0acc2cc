//! Making lists on several threads, always the same ones.
//!
//! On several threads, the lists of groups of leaves are made in parallel (`in_order`), and copied one behind the other to the
//! memory of the caller. The position of each list depends on nothing but the lists before it.

use super::by_id;
use super::columns::{Columns, Room};
use super::error::ListError;
use super::list_request::ListRequest;
use super::neighbor_lists::NeighborLists;
use super::prepare::{Prepared, prepare};
use super::scheduling::{in_order, room_for, slots};
use super::worker::{Share, Worker};
use crate::parallel;
use crate::simd::dispatch;

/// Makes the lists of a checked request.
pub(super) fn lists(request: &ListRequest<'_>, lists: &mut NeighborLists) -> Result<(), ListError> {
    let mut prepared = core::mem::take(&mut lists.prepared);
    let done = prepare(request, &mut prepared).and_then(|()| fill(request, &prepared, lists));
    lists.prepared = prepared;
    if done.is_err() || !request.by_id {
        return done;
    }
    by_id::reorder(request, lists)
}

/// Makes the lists of all groups.
fn fill(request: &ListRequest<'_>, prepared: &Prepared, lists: &mut NeighborLists) -> Result<(), ListError> {
    make_all(request, prepared, lists);
    match lists.workers.iter_mut().filter_map(|worker| worker.lists.crowded.take()).min() {
        None => Ok(()),
        Some(id) => {
            lists.clear();
            Err(ListError::TooManyNeighbors { id })
        }
    }
}

fn make_all(request: &ListRequest<'_>, prepared: &Prepared, lists: &mut NeighborLists) {
    let count = if parallel::threads() > 1 { slots() } else { 1 };
    if lists.workers.len() < count {
        lists.workers.resize(count, Worker::default());
    }
    lists.offsets.push(0);
    (lists.distances, lists.displacements) = (request.listing.distances, request.listing.displacements);
    if count == 1 {
        return on_one_thread(request, prepared, lists);
    }
    let requested = request.listing.columns();
    let (NeighborLists { offsets, points, columns, workers, .. }, groups) = (lists, prepared.groups.len());
    let (workers, mut done) = (&mut workers[..count], 0);
    // What is left of the lists before says nothing about these.
    workers.iter_mut().for_each(|worker| worker.lists.clear());
    while done < groups {
        let begin = *offsets.last().expect("the first offset is there from the start");
        let mut room = columns.room(begin, requested);
        let assign = |worker: &Worker| {
            let lists = &worker.lists;
            let room = room.take(lists.len)?;
            let begin = *offsets.last().expect("the first offset is there from the start");
            points.extend_from_slice(&lists.points);
            offsets.extend(lists.ends.iter().map(|end| begin + end));
            Some(room)
        };
        let make = |group: usize, worker: &mut Worker| {
            worker.share = group..group + 1;
            worker.lists.clear();
            work(Share { request, prepared, worker });
        };
        let copy = |worker: &Worker, room: Room<'_>| room.fill(&worker.lists.columns);
        done = in_order(done..groups, workers, make, assign, copy);
        if done < groups {
            let end = *offsets.last().expect("the first offset is there from the start");
            let made = workers.iter().map(|worker| worker.lists.len);
            columns.make_room(room_for(end, done, groups - done, made), requested);
        }
    }
}

/// Makes the lists of a worker's share.
fn work(share: Share<'_>) {
    dispatch(share.request.tree.simd, share);
}

/// The same on one thread, whose lists need not be copied: it makes them where the caller will find them.
fn on_one_thread(request: &ListRequest<'_>, prepared: &Prepared, lists: &mut NeighborLists) {
    let NeighborLists { offsets, points, columns, workers, .. } = lists;
    let worker = &mut workers[0];
    worker.share = 0..prepared.groups.len();
    let swap = |worker: &mut Worker, columns: &mut Columns, offsets: &mut Vec<usize>, points: &mut Vec<u32>| {
        core::mem::swap(&mut worker.lists.columns, columns);
        core::mem::swap(&mut worker.lists.ends, offsets);
        core::mem::swap(&mut worker.lists.points, points);
    };
    swap(worker, columns, offsets, points);
    worker.lists.len = 0;
    work(Share { request, prepared, worker });
    swap(worker, columns, offsets, points);
}
