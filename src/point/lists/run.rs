//! Making lists on several threads, always the same ones.
//!
//! Groups of leaves are dealt out in waves, a few to each worker. A worker's lists of one wave are small enough for a
//! near cache; behind each wave they are copied one behind the other to where the caller will find them, which only
//! then takes memory traffic. Where each list ends up depends on nothing but the lists before it.

use super::csr::{Columns, NeighborCsr};
use super::error::ListError;
use super::gather::Candidates;
use super::group::Group;
use super::query::{ListQuery, Radii};
use super::reach::{Measure, Reach};
use super::row::{Listing, Lists, Near};
use super::torus::MOST_PERIODS;
use crate::parallel;
use crate::point::partition::{Layer, LayerView};
use crate::point::snapshot::View;
use crate::simd::{Kernel, LANES, Simd, dispatch};
use core::ops::Range;
use glam::Vec3;

/// Groups that a worker does in one wave, of up to 256 points each (512 where leaves have two blocks).
const SHARE: usize = 4;

/// Workers for each thread, so that threads that are done early find more to do.
const WORKERS: usize = 4;

/// A group: number of the layer and of the bottom node.
type Place = (usize, usize);

/// What one worker needs.
#[derive(Clone, Debug, Default)]
pub(super) struct Worker {
    /// Which of the groups.
    share: Range<usize>,
    group: Group,
    candidates: Candidates,
    near: Near,
    lists: Lists,
}

impl Worker {
    pub(super) fn bytes(&self) -> usize {
        self.candidates.bytes() + self.near.bytes() + self.lists.bytes()
    }
}

/// What is prepared before lists are made.
#[derive(Clone, Debug, Default)]
pub(super) struct Prepared {
    groups: Vec<Place>,
    /// By layer of the listed set, where radii of the listed points count.
    reaches: Vec<Reach>,
}

impl Prepared {
    pub(super) fn bytes(&self) -> usize {
        let reaches: usize = self.reaches.iter().map(Reach::bytes).sum();
        self.groups.capacity() * size_of::<Place>() + reaches
    }
}

/// Makes the lists of a checked query.
pub(super) fn run(query: &ListQuery<'_>, lists: &mut NeighborCsr) -> Result<(), ListError> {
    let mut prepared = core::mem::take(&mut lists.prepared);
    let done = prepare(query, &mut prepared).map(|()| fill(query, &prepared, lists));
    lists.prepared = prepared;
    if done.is_err() || !query.by_id {
        return done;
    }
    super::by_id::arrange(query, lists)
}

/// Runs a kernel on each layer of a tree at a time.
macro_rules! at_time {
    ($layer:expr, $time:expr, $view:ident => $do:expr) => {
        match $layer.at($time) {
            LayerView::Still($view) => $do,
            LayerView::Moving($view) => $do,
            LayerView::Timed($view) => $do,
        }
    };
}

fn prepare(query: &ListQuery<'_>, prepared: &mut Prepared) -> Result<(), ListError> {
    let (simd, time) = (query.tree.simd, query.time);
    prepared.groups.clear();
    for (number, layer) in query.tree.layers.iter().enumerate() {
        let groups = &mut prepared.groups;
        at_time!(layer, time, view => dispatch(simd, Bottoms { view, number, groups }));
    }
    for layer in query.tree.layers.iter().chain(&query.among.layers) {
        let most = at_time!(layer, time, view => dispatch(simd, Extent { view }));
        for (axis, length) in query.periods.iter().enumerate() {
            if length.is_some_and(|length| most[axis] > MOST_PERIODS * length) {
                return Err(ListError::FarFromPeriod { axis });
            }
        }
    }
    let mut measure = |layers: &[Layer], radii: &[f32]| {
        prepared.reaches.resize(prepared.reaches.len().max(layers.len()), Reach::default());
        for (layer, reach) in layers.iter().zip(&mut prepared.reaches) {
            at_time!(layer, time, view => dispatch(simd, Measure { view, radii, reach }));
            if let Some(id) = reach.missing {
                return Err(ListError::MissingRadius { id });
            }
        }
        Ok(())
    };
    match query.listing.radii {
        Radii::Equal(_) => Ok(()),
        Radii::Own(own) => measure(&query.tree.layers, own),
        Radii::Larger { own, others } => {
            measure(&query.tree.layers, own)?;
            measure(&query.among.layers, others)
        }
    }
}

fn fill(query: &ListQuery<'_>, prepared: &Prepared, lists: &mut NeighborCsr) {
    let threads = parallel::threads();
    let count = if threads > 1 { WORKERS * threads } else { 1 };
    if lists.workers.len() < count {
        lists.workers.resize(count, Worker::default());
    }
    lists.offsets.push(0);
    (lists.distances, lists.displacements) = (query.listing.distances, query.listing.displacements);
    let groups = prepared.groups.len();
    for wave in (0..groups).step_by(SHARE * count) {
        let workers = &mut lists.workers[..count];
        for (number, worker) in workers.iter_mut().enumerate() {
            let begin = (wave + number * SHARE).min(groups);
            worker.share = begin..(begin + SHARE).min(groups);
        }
        parallel::each(workers, |worker| {
            dispatch(query.tree.simd, Share { query, prepared, worker });
        });
        append(&query.listing, &lists.workers[..count], &mut lists.offsets, &mut lists.points, &mut lists.columns);
    }
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
    columns.make_room(end, listing);
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

impl Columns {
    /// Gives the columns that are asked for at least this length.
    pub(super) fn make_room(&mut self, length: usize, listing: &Listing<'_>) {
        grow(&mut self.ids, length);
        for (asked, column) in listing.columns().into_iter().zip(self.floats()) {
            if asked {
                grow(column, length);
            }
        }
    }
}

/// At least this length, with room to grow.
fn grow<T: Copy + Default>(column: &mut Vec<T>, length: usize) {
    if column.len() < length {
        // A new vector on huge pages: most of the time of the first lists would go into mapping small ones.
        let mut larger = crate::simd::huge_vec(length + length / 2 + LANES);
        larger.extend_from_slice(column);
        larger.resize(larger.capacity(), T::default());
        *column = larger;
    }
}

/// Finds the bottom nodes of a view, in the order of the tree.
struct Bottoms<'a, V> {
    view: V,
    number: usize,
    groups: &'a mut Vec<Place>,
}

impl<V: View> Kernel for Bottoms<'_, V> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Bottoms { view, number, groups } = self;
        let target = view.target(s, Vec3::ZERO);
        let begin = groups.len();
        let (top, root) = view.root();
        groups.push((top, root));
        // One level after the other: each node makes place for its children.
        for level in (1..=top).rev() {
            let end = groups.len();
            for i in begin..end {
                let node = groups[i].1;
                let mut lanes = view.present(s, &target, node);
                while lanes != 0 {
                    groups.push((number, view.first_child(level, node) + lanes.trailing_zeros() as usize));
                    lanes &= lanes - 1;
                }
            }
            groups.drain(begin..end);
        }
        if top == 0 {
            groups[begin].0 = number;
        }
    }
}

/// The largest magnitude of a coordinate along each axis.
struct Extent<V> {
    view: V,
}

impl<V: View> Kernel for Extent<V> {
    type Output = [f32; 3];
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> [f32; 3] {
        let target = self.view.target(s, Vec3::ZERO);
        let node = self.view.root().1;
        let present = self.view.present(s, &target, node);
        let (lo, hi) = self.view.faces(s, &target, node);
        let mut most = [0.0f32; 3];
        for axis in 0..3 {
            let (mut below, mut above) = ([0.0; LANES], [0.0; LANES]);
            s.store(lo[axis], &mut below);
            s.store(hi[axis], &mut above);
            for lane in (0..LANES).filter(|lane| present >> lane & 1 != 0) {
                most[axis] = most[axis].max(below[lane].abs()).max(above[lane].abs());
            }
        }
        most
    }
}

/// The lists of a worker's share of groups.
struct Share<'a> {
    query: &'a ListQuery<'a>,
    prepared: &'a Prepared,
    worker: &'a mut Worker,
}

impl Kernel for Share<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Share { query, prepared, worker } = self;
        let listing = &query.listing;
        worker.lists.clear();
        for &(layer, node) in &prepared.groups[worker.share.clone()] {
            let group = &mut worker.group;
            at_time!(query.tree.layers[layer], query.time, view => {
                group.take(s, &view, &view.target(s, Vec3::ZERO), node, &listing.radii);
            });
            worker.candidates.clear();
            for (number, layer) in query.among.layers.iter().enumerate() {
                let reach = match listing.radii {
                    Radii::Larger { .. } => prepared.reaches.get(number),
                    _ => None,
                };
                at_time!(layer, query.time, view => {
                    let target = view.target(s, Vec3::ZERO);
                    worker.candidates.add(s, (&view, &target), &worker.group, &listing.torus, (&listing.radii, reach));
                });
            }
            for member in &worker.group.members {
                worker.near.list(s, listing, member, &worker.candidates, &mut worker.lists);
            }
        }
    }
}
