//! Making lists, on one thread or several, always the same ones.

use super::error::ListError;
use super::list_request::ListRequest;
use super::neighbor_lists::NeighborLists;
use super::prepare::{Prepared, prepare};
use super::scheduling::{append_in_order, slots};
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
    lists.reordering.reorder(request.tree.len(), &mut lists.rows)
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
    let NeighborLists { rows, workers, .. } = lists;
    let workers = &mut workers[..count];
    rows.data.requested = request.listing.columns();
    for worker in &mut *workers {
        // What is left of the lists before says nothing about these.
        worker.lists.rows.clear();
        worker.lists.rows.data.requested = rows.data.requested;
    }
    if let [worker] = workers {
        // They need not be copied: it makes them where the caller will find them.
        worker.share = 0..prepared.groups.len();
        core::mem::swap(&mut worker.lists.rows, rows);
        work(Share { request, prepared, worker });
        return core::mem::swap(&mut worker.lists.rows, rows);
    }
    let make = |group: usize, worker: &mut Worker| {
        worker.share = group..group + 1;
        worker.lists.rows.clear();
        work(Share { request, prepared, worker });
    };
    append_in_order(prepared.groups.len(), workers, rows, make, |worker| &worker.lists.rows);
}

/// Makes the lists of a worker's share.
fn work(share: Share<'_>) {
    dispatch(share.request.tree.simd, share);
}
