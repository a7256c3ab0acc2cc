//! What one thread does: the lists of a share of the groups.

use super::candidates::Candidates;
use super::group::Group;
use super::list_layer::{ListLayer, ListView, with_view};
use super::list_request::{ListRequest, Listing};
use super::prepare::Prepared;
use super::radii::Radii;
use super::reach::Reach;
use super::row::{GroupLists, Lists, RowBuilder};
use crate::point::layout::snapshot::CoordinateView;
use crate::simd::{Kernel, Simd};
use core::marker::PhantomData;
use core::ops::Range;
use glam::Vec3;

/// What one worker needs.
#[derive(Clone, Debug, Default)]
pub(super) struct Worker {
    /// Which of the groups.
    pub(super) share: Range<usize>,
    group: Group,
    candidates: Candidates,
    near: RowBuilder,
    pub(super) lists: Lists,
}

impl Worker {
    pub(super) fn bytes(&self) -> usize {
        self.candidates.bytes() + self.near.bytes() + self.lists.bytes()
    }
}

/// The lists of a worker's share of groups.
pub(super) struct Share<'a> {
    pub(super) request: &'a ListRequest<'a>,
    pub(super) prepared: &'a Prepared,
    pub(super) worker: &'a mut Worker,
}

// The parts of the work on a group are functions of their own: each is much longer than a call.

/// Takes the points below a bottom node.
struct TakeGroup<'a, V> {
    view: V,
    group: &'a mut Group,
    node: usize,
    radii: &'a Radii<'a>,
}

impl<V: CoordinateView> Kernel for TakeGroup<'_, V> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let TakeGroup { view, group, node, radii } = self;
        group.take(s, &view, &view.target(s, Vec3::ZERO), node, radii);
    }
}

/// Adds what a group can reach in a view, or what can reach the group.
struct AddCandidates<'a, V> {
    view: V,
    candidates: &'a mut Candidates,
    group: &'a Group,
    listing: &'a Listing<'a>,
    reach: Option<&'a Reach>,
}

impl<V: CoordinateView> Kernel for AddCandidates<'_, V> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let AddCandidates { view, candidates, group, listing, reach } = self;
        let target = view.target(s, Vec3::ZERO);
        candidates.add(s, (&view, &target), group, &listing.periodic_box, (&listing.radii, reach));
    }
}

impl Kernel for Share<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Share { request, prepared, worker } = self;
        let listing = &request.listing;
        for &(layer, node) in &prepared.groups[worker.share.clone()] {
            let layer = ListLayer::of(request.tree, layer);
            let center = layer.center(node, request.time);
            let group = &mut worker.group;
            with_view!(layer.at(center, request.time), view => {
                s.call(TakeGroup { view, group, node, radii: &listing.radii });
            });
            if !worker.group.members.iter().any(|member| worker.lists.want_any(&member.points.id)) {
                continue;
            }
            worker.candidates.clear();
            for (number, layer) in ListLayer::all(request.among).enumerate() {
                let reach = listing.radii.others().and_then(|_| prepared.reaches.get(number));
                let (candidates, group) = (&mut worker.candidates, &worker.group);
                with_view!(layer.at(center, request.time), view => {
                    s.call(AddCandidates { view, candidates, group, listing, reach });
                });
            }
            let Worker { group, candidates, near: builder, lists, .. } = &mut *worker;
            if group.exact.is_empty() {
                s.call(GroupLists::<f32> { builder, listing, group, candidates, lists, coordinate: PhantomData });
            } else {
                s.call(GroupLists::<f64> { builder, listing, group, candidates, lists, coordinate: PhantomData });
            }
        }
    }
}
