//! What one thread does: the lists of a share of the groups.

use super::candidates::{AddCandidates, Candidates};
use super::group::{Group, MOST_BLOCKS, TakeGroup};
use super::list_request::ListRequest;
use super::list_writer::ListWriter;
use super::prepare::Prepared;
use super::row::{GroupLists, RowBuilder};
use crate::point::search::layers::{LayerView, with_view};
use crate::simd::{Kernel, LANES, Simd};
use core::marker::PhantomData;
use core::ops::Range;
use glam::DVec3;

/// What one worker needs.
#[derive(Clone, Debug, Default)]
pub(super) struct Worker {
    /// Which of the groups.
    pub(super) share: Range<usize>,
    group: Group,
    /// A point of the group, where its points are searched for one by one.
    alone: Group,
    candidates: Candidates,
    builder: RowBuilder,
    pub(super) lists: ListWriter,
}

impl Worker {
    pub(super) fn bytes(&self) -> usize {
        let groups = self.group.bytes() + self.alone.bytes();
        groups + self.candidates.bytes() + self.builder.bytes() + self.lists.bytes()
    }
}

/// The lists of a worker's share of groups.
pub(super) struct Share<'a> {
    pub(super) request: &'a ListRequest<'a>,
    pub(super) prepared: &'a Prepared,
    pub(super) worker: &'a mut Worker,
}

// The parts of the work on a group are functions of their own: each is much longer than a call.

/// The lists of a group, whose positions are relative to `center` where they are in f64. None and `false` if it has more candidates
/// than `most` blocks.
struct ListGroup<'a> {
    request: &'a ListRequest<'a>,
    prepared: &'a Prepared,
    group: &'a Group,
    center: DVec3,
    most: usize,
    candidates: &'a mut Candidates,
    builder: &'a mut RowBuilder,
    lists: &'a mut ListWriter,
}

impl Kernel for ListGroup<'_> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let ListGroup { request, prepared, group, center, most, candidates, builder, lists } = self;
        let listing = &request.listing;
        candidates.clear();
        for (number, layer) in request.others().layers.iter().enumerate() {
            let reach = listing.radii.others().and_then(|_| prepared.reaches.get(number));
            let candidates = &mut *candidates;
            let all = with_view!(layer.at(center, request.time), view => {
                s.call(AddCandidates { view, candidates, group, listing, reach, most })
            });
            if !all {
                return false;
            }
        }
        if group.double.is_empty() {
            s.call(GroupLists::<f32> { builder, listing, group, candidates, lists, coordinate: PhantomData });
        } else {
            s.call(GroupLists::<f64> { builder, listing, group, candidates, lists, coordinate: PhantomData });
        }
        true
    }
}

impl Kernel for Share<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Share { request, prepared, worker } = self;
        let listing = &request.listing;
        for &(layer, node) in &prepared.groups[worker.share.clone()] {
            let layer = &request.tree.layers[layer];
            let center = layer.center(node, request.time);
            let Worker { group, alone, candidates, builder, lists, .. } = &mut *worker;
            with_view!(layer.at(center, request.time), view => {
                s.call(TakeGroup { view, group, node, radii: &listing.radii });
            });
            if !group.members.iter().any(|member| lists.want_any(&member.points.id)) {
                continue;
            }
            // Few points among many others lie far apart in a tree of their own.
            let scattered = listing.other_set && group.is_scattered(&listing.radii, prepared.most_reach);
            let lanes = group.members.len() * LANES;
            let most = if scattered { MOST_BLOCKS * lanes } else { usize::MAX };
            if s.call(ListGroup { request, prepared, group, center, most, candidates, builder, lists }) {
                continue;
            }
            for lane in 0..lanes {
                if alone.take_one(group, lane / LANES, lane % LANES) {
                    let most = usize::MAX;
                    s.call(ListGroup { request, prepared, group: alone, center, most, candidates, builder, lists });
                }
            }
        }
    }
}
