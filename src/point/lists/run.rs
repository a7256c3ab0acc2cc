//! Making lists on several threads, always the same ones.
//!
//! Groups of leaves are dealt out in waves, one to each worker. A worker's lists of one wave are small enough for a
//! near cache; behind each wave they are copied one behind the other to where the caller will find them, which only
//! then takes memory traffic. Where each list ends up depends on nothing but the lists before it.

use super::by_id;
use super::columns::Columns;
use super::csr::NeighborCsr;
use super::double::DoubleShare;
use super::error::ListError;
use super::prepare::{Prepared, prepare};
use super::question::{Listing, Question};
use super::worker::{Share, Worker};
use crate::parallel;
use crate::simd::dispatch;

/// Workers for each thread, so that threads that are done early find more to do. Fewer that do more groups in a wave wait
/// longer for each other.
pub(super) const WORKERS: usize = 16;

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
    let threads = parallel::threads();
    let count = if threads > 1 { WORKERS * threads } else { 1 };
    if lists.workers.len() < count {
        lists.workers.resize(count, Worker::default());
    }
    lists.offsets.push(0);
    (lists.distances, lists.displacements) = (query.listing.distances, query.listing.displacements);
    let groups = prepared.groups.len();
    if count == 1 {
        return alone(query, prepared, lists);
    }
    for wave in (0..groups).step_by(count) {
        let workers = &mut lists.workers[..count];
        for (number, worker) in workers.iter_mut().enumerate() {
            let group = wave + number;
            worker.share = group.min(groups)..(group + 1).min(groups);
            worker.lists.clear();
        }
        parallel::each(workers, |worker| work(Share { query, prepared, worker }));
        append(&query.listing, &lists.workers[..count], &mut lists.offsets, &mut lists.points, &mut lists.columns);
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

/// Appends what workers have made.
fn append(
    listing: &Listing<'_>,
    workers: &[Worker],
    offsets: &mut Vec<usize>,
    points: &mut Vec<u32>,
    columns: &mut Columns,
) {
    let begin = *offsets.last().expect("the first offset is there from the start");
    let mut end = begin;
    for Worker { lists, .. } in workers {
        points.extend_from_slice(&lists.points);
        offsets.extend(lists.ends.iter().map(|list_end| end + list_end));
        end += lists.len;
    }
    columns.make_room(end, listing.columns());
    let length = |worker: &Worker| worker.lists.len;
    copy(workers, &mut columns.ids[begin..end], &|worker| &worker.lists.columns.ids, &length);
    if listing.distances {
        copy(workers, &mut columns.distances[begin..end], &|worker| &worker.lists.columns.distances, &length);
    }
    if listing.displacements {
        for (axis, column) in columns.displacements.iter_mut().enumerate() {
            copy(workers, &mut column[begin..end], &|worker| &worker.lists.columns.displacements[axis], &length);
        }
    }
}

/// Copies the columns of workers one behind the other, halves at the same time.
fn copy<'a, T: Copy + Send + Sync + 'a>(
    workers: &'a [Worker],
    to: &mut [T],
    from: &(impl Fn(&'a Worker) -> &'a [T] + Sync),
    length: &(impl Fn(&Worker) -> usize + Sync),
) {
    match workers {
        [] => {}
        [worker] => to.copy_from_slice(&from(worker)[..length(worker)]),
        _ => {
            let (left, right) = workers.split_at(workers.len() / 2);
            let (to_left, to_right) = to.split_at_mut(left.iter().map(length).sum());
            parallel::both(|| copy(left, to_left, from, length), || copy(right, to_right, from, length));
        }
    }
}
