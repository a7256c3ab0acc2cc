//! What one thread does: the lists of a share of the groups.

use super::candidates::Candidates;
use super::group::Group;
use super::list_layer::{ListLayer, ListView, with_view};
use super::list_request::ListRequest;
use super::prepare::Prepared;
use super::row::{Lists, RowBuilder};
use crate::point::layout::snapshot::Leaves;
use crate::simd::{Kernel, Simd};
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
                group.take(s, &view, &view.target(s, Vec3::ZERO), node, &listing.radii);
            });
            worker.candidates.clear();
            for (number, layer) in ListLayer::all(request.among).enumerate() {
                let reach = listing.radii.others().and_then(|_| prepared.reaches.get(number));
                with_view!(layer.at(center, request.time), view => {
                    let target = view.target(s, Vec3::ZERO);
                    worker.candidates.add(s, (&view, &target), &worker.group, &listing.periodic_box, (&listing.radii, reach));
                });
            }
            if worker.group.exact.is_empty() {
                worker.near.lists::<S, f32>(s, listing, &worker.group, &worker.candidates, &mut worker.lists);
            } else {
                worker.near.lists::<S, f64>(s, listing, &worker.group, &worker.candidates, &mut worker.lists);
            }
        }
    }
}
