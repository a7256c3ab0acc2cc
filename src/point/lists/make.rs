//! Making lists, on one thread or several, always the same ones.

use super::columns::Columns;
use super::error::ListError;
use super::list_request::ListRequest;
use super::neighbor_lists::NeighborLists;
use super::prepare::{Prepared, prepare};
use super::scheduling::{Made, append_in_order, slots};
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
    let NeighborLists { offsets, points, columns, reordering, .. } = lists;
    let done = reordering.reorder(request.tree.len(), (offsets, points, columns));
    if done.is_err() {
        lists.clear();
    }
    done
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
    let NeighborLists { offsets, points, columns, workers, .. } = lists;
    let workers = &mut workers[..count];
    offsets.push(0);
    columns.requested = request.listing.columns();
    for worker in &mut *workers {
        // What is left of the lists before says nothing about these.
        worker.lists.clear();
        worker.lists.columns.requested = columns.requested;
    }
    if let [worker] = workers {
        return on_one_thread(request, prepared, (offsets, points, columns), worker);
    }
    let make = |group: usize, worker: &mut Worker| {
        worker.share = group..group + 1;
        worker.lists.clear();
        work(Share { request, prepared, worker });
    };
    append_in_order(prepared.groups.len(), workers, (offsets, points, columns), make, |worker| {
        let lists = &worker.lists;
        Made { points: &lists.points, ends: &lists.ends, data: &lists.columns }
    });
}

/// Makes the lists of a worker's share.
fn work(share: Share<'_>) {
    dispatch(share.request.tree.simd, share);
}

/// The same on one thread, whose lists need not be copied: it makes them where the caller will find them.
fn on_one_thread(
    request: &ListRequest<'_>,
    prepared: &Prepared,
    (offsets, points, columns): (&mut Vec<usize>, &mut Vec<u32>, &mut Columns),
    worker: &mut Worker,
) {
    worker.share = 0..prepared.groups.len();
    let mut swap = |worker: &mut Worker| {
        core::mem::swap(&mut worker.lists.columns, columns);
        core::mem::swap(&mut worker.lists.ends, offsets);
        core::mem::swap(&mut worker.lists.points, points);
    };
    swap(worker);
    work(Share { request, prepared, worker });
    swap(worker);
}
