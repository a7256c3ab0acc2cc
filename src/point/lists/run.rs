//! Making lists on several threads, always the same ones.
//!
//! On several threads groups of leaves are made in turn (`in_turn`), and copied one behind the other to where the caller will
//! find them. Where each list ends up depends on nothing but the lists before it.

use super::by_id;
use super::columns::{Columns, Room};
use super::csr::NeighborCsr;
use super::double::DoubleShare;
use super::error::ListError;
use super::in_turn::{in_turn, slots};
use super::prepare::{Prepared, prepare};
use super::question::Question;
use super::worker::{Share, Worker};
use crate::parallel;
use crate::simd::dispatch;

/// Makes the lists of a checked query.
pub(super) fn run(query: &Question<'_>, lists: &mut NeighborCsr) -> Result<(), ListError> {
    let mut prepared = core::mem::take(&mut lists.prepared);
    let done = prepare(query, &mut prepared).map(|()| fill(query, &prepared, lists));
    lists.prepared = prepared;
    if done.is_err() || !query.by_id {
        return done;
    }
    by_id::arrange(query, lists)
}

fn fill(query: &Question<'_>, prepared: &Prepared, lists: &mut NeighborCsr) {
    let count = if parallel::threads() > 1 { slots() } else { 1 };
    if lists.workers.len() < count {
        lists.workers.resize(count, Worker::default());
    }
    lists.offsets.push(0);
    (lists.distances, lists.displacements) = (query.listing.distances, query.listing.displacements);
    if count == 1 {
        return alone(query, prepared, lists);
    }
    let asked = query.listing.columns();
    let (NeighborCsr { offsets, points, columns, workers, .. }, groups) = (lists, prepared.groups.len());
    let (workers, mut done) = (&mut workers[..count], 0);
    while done < groups {
        let begin = *offsets.last().expect("the first offset is there from the start");
        let mut room = columns.room(begin, asked);
        let place = |worker: &Worker| {
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
            work(Share { query, prepared, worker });
        };
        let copy = |worker: &Worker, room: Room<'_>| room.fill(&worker.lists.columns);
        done = in_turn(done..groups, workers, make, place, copy);
        if done < groups {
            // As many for each of the other groups as so far, and as the largest of those that there was no room for.
            let end = *offsets.last().expect("the first offset is there from the start");
            let most = workers.iter().map(|worker| worker.lists.len).max().unwrap_or(0);
            let usual = if done > 0 { end.div_ceil(done) } else { most };
            columns.make_room(end + most + usual * (groups - done), asked);
        }
    }
}

/// Makes the lists of a worker's share.
fn work(share: Share<'_>) {
    let tree = share.query.tree;
    if tree.precise.is_empty() {
        dispatch(tree.simd, share);
    } else {
        dispatch(tree.simd, DoubleShare(share));
    }
}

/// The same on one thread, whose lists need not be copied: it makes them where the caller will find them.
fn alone(query: &Question<'_>, prepared: &Prepared, lists: &mut NeighborCsr) {
    let NeighborCsr { offsets, points, columns, workers, .. } = lists;
    let worker = &mut workers[0];
    worker.share = 0..prepared.groups.len();
    let swap = |worker: &mut Worker, columns: &mut Columns, offsets: &mut Vec<usize>, points: &mut Vec<u32>| {
        core::mem::swap(&mut worker.lists.columns, columns);
        core::mem::swap(&mut worker.lists.ends, offsets);
        core::mem::swap(&mut worker.lists.points, points);
    };
    swap(worker, columns, offsets, points);
    worker.lists.len = 0;
    work(Share { query, prepared, worker });
    swap(worker, columns, offsets, points);
}
