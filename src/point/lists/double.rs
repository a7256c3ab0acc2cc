//! Lists of points in f64: for each of them a search of its own.
//!
//! Groups of leaves are searched together where all positions are f32 ones relative to one origin. Here each point is a
//! query of the tree as any query does, with the same arithmetic, and what it finds goes to the same columns.

use super::candidates::write;
use super::columns::Columns;
use super::list_request::Listing;
use super::radii::squared_radius;
use super::row::Lists;
use super::worker::Share;
use crate::point::layout::snapshot::Leaves;
use crate::point::search::radius::Sink;
use crate::simd::{Kernel, LANES, Mask, Simd, lanes_at_mut};
use core::ops::ControlFlow;

/// The lists of a worker's share of groups.
pub(super) struct DoubleShare<'a>(pub(super) Share<'a>);

impl Kernel for DoubleShare<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Share { request, prepared, worker } = self.0;
        let (listing, lists) = (&request.listing, &mut worker.lists);
        for &(layer, node) in &prepared.groups[worker.share.clone()] {
            for (id, at) in request.tree.precise[layer].tree_at(request.time).points_behind(node, request.time) {
                let bound = squared_radius(listing.radii.of(id));
                let begin = lists.len;
                let own = if listing.other_set && !listing.once { u32::MAX } else { id };
                let mut row = Row { listing, lists, own };
                for among in &request.among.precise {
                    // A sink that never breaks.
                    let _ = among.within(s, (at, request.time), bound, &mut row);
                }
                lists.end_list(id, begin, lists.len, listing);
            }
        }
    }
}

/// A list in the making.
struct Row<'a, 'b> {
    listing: &'a Listing<'b>,
    lists: &'a mut Lists,
    /// The id that is no neighbour, or the one that those of neighbours are above.
    own: u32,
}

impl<S: Simd> Sink<S> for Row<'_, '_> {
    const TAKES_NONE: bool = true;
    #[inline(always)]
    fn take<V: Leaves>(&mut self, s: S, view: &V, block: usize, distance: S::F, hits: Mask) -> ControlFlow<()> {
        let Row { listing, lists, own } = self;
        let (ids, own) = (s.load_u(view.ids(block)), s.splat_u(*own));
        let hits = hits & if listing.once { s.lt_u(own, ids) } else { !s.eq_u(own, ids) };
        lists.reserve(LANES, listing);
        let end = lists.len;
        let Columns { ids: listed, floats: [distances, ..] } = &mut lists.columns;
        s.store_compressed_u(ids, hits, lanes_at_mut(listed, end));
        if listing.distances {
            write(s, distances, end, distance, hits);
        }
        lists.len = end + hits.count_ones() as usize;
        ControlFlow::Continue(())
    }
}
