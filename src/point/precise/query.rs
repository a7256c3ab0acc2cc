//! Searches among f64 points, compiled once for all filters.

use super::layer::{AtTime, PreciseLayer};
use crate::point::layout::view::LeafView;
use crate::point::neighbor::Neighbor;
use crate::point::search::candidates::Candidates;
use crate::point::search::k_nearest::KNearest;
use crate::point::search::nearest::Best;
use crate::point::search::radius::{Sink, within};
use crate::point::search::sinks::{Count, Gather, Visit, VisitSome};
use crate::point::search::sort::few_in_order;
use crate::point::search::walk::walk;
use crate::point::search::{Keep, KeepAll, KeptLanes, NeighborWork};
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, SimdLevel, dispatch};
use core::ops::ControlFlow;
use glam::{DVec3, Vec3};

/// A predicate on ids, if there is one.
#[derive(Clone, Copy)]
pub(in crate::point) struct Allowed<'a>(pub(in crate::point) Option<KeptLanes<'a>>);

impl Keep for Allowed<'_> {
    const FILTERS: bool = true;
    fn keep(&self, id: u32) -> bool {
        self.kept(&[id; LANES], 1) != 0
    }
    #[inline(always)]
    fn kept(&self, ids: &Lanes<u32>, mask: Mask) -> Mask {
        match self.0 {
            Some(kept) if mask != 0 => kept(ids, mask),
            _ => mask,
        }
    }
}

/// A query among f64 points. (Its kernels are not those of f32 points: sharing them made these searches slower.)
#[derive(Clone, Copy)]
pub(in crate::point) struct PreciseQuery<'a> {
    pub(in crate::point) layers: &'a [PreciseLayer],
    pub(in crate::point) simd: SimdLevel,
    pub(in crate::point) point: DVec3,
    pub(in crate::point) time: f32,
    /// Squared distance up to which points count.
    pub(in crate::point) bound: f32,
    /// Factor on the bound for boxes.
    pub(in crate::point) shrink: f32,
    pub(in crate::point) keep: Allowed<'a>,
}

/// Runs the same on each layer.
macro_rules! for_each_layer {
    ($query:expr, $view:ident => $do:expr) => {
        for layer in $query.layers {
            match layer.at($query.point, $query.time) {
                AtTime::Static($view) => $do,
                AtTime::Moving($view) => $do,
            }
        }
    };
}

impl PreciseQuery<'_> {
    /// Passes every point within the bound to the sink.
    #[inline(always)]
    fn within<S: Simd>(&self, s: S, sink: &mut impl Sink<S>) -> ControlFlow<()> {
        for_each_layer!(self, view => within(s, &view, &view.target(s, Vec3::ZERO), self.bound, sink)?);
        ControlFlow::Continue(())
    }

    /// Id and squared distance of the nearest point.
    pub(in crate::point) fn nearest(&self) -> Option<(u32, f32)> {
        dispatch(self.simd, Nearest(self))
    }

    /// Collects the k nearest points; whether they are in order.
    pub(in crate::point) fn nearest_n(
        &self,
        k: usize,
        candidates: &mut Candidates,
        found: &mut Vec<Neighbor>,
        work: &mut NeighborWork,
    ) -> bool {
        dispatch(self.simd, NearestN { query: self, k, candidates, found, work })
    }

    /// Collects the points within the bound.
    pub(in crate::point) fn collect(&self, candidates: &mut Candidates) {
        dispatch(self.simd, Collecting { query: self, candidates });
    }

    /// The number of points within the bound.
    pub(in crate::point) fn count(&self) -> usize {
        dispatch(self.simd, Counting(self))
    }

    /// Shows the points within the bound to a visitor, whatever is kept.
    pub(in crate::point) fn for_some(&self, visit: VisitSome<'_>) -> ControlFlow<()> {
        dispatch(self.simd, Visiting { query: self, visit })
    }
}

struct Nearest<'a>(&'a PreciseQuery<'a>);

impl Kernel for Nearest<'_> {
    type Output = Option<(u32, f32)>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Option<(u32, f32)> {
        // This search waits for what it finds, so that even testing whether there is a filter would be noticed.
        if self.0.keep.0.is_none() { nearest(s, self.0, &KeepAll) } else { nearest(s, self.0, &self.0.keep) }
    }
}

#[inline(always)]
fn nearest<S: Simd>(s: S, query: &PreciseQuery<'_>, keep: &impl Keep) -> Option<(u32, f32)> {
    let mut best = Best::within(s, query.bound, query.shrink, keep);
    for_each_layer!(query, view => best.search(s, &view, &view.target(s, Vec3::ZERO)));
    best.finish(s)
}

struct NearestN<'a, 'b> {
    query: &'a PreciseQuery<'a>,
    k: usize,
    candidates: &'b mut Candidates,
    found: &'b mut Vec<Neighbor>,
    work: &'b mut NeighborWork,
}

impl Kernel for NearestN<'_, '_> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let NearestN { query, k, candidates, found, work } = self;
        let mut search = KNearest::within(k, query.bound, query.shrink, candidates, &query.keep, work);
        loop {
            for_each_layer!(query, view => walk(s, &view, &view.target(s, Vec3::ZERO), &mut search));
            if !search.retry() {
                break;
            }
        }
        few_in_order(s, k, candidates, found)
    }
}

struct Collecting<'a, 'b> {
    query: &'a PreciseQuery<'a>,
    candidates: &'b mut Candidates,
}

impl Kernel for Collecting<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Collecting { query, candidates } = self;
        candidates.count = 0;
        // A sink that never breaks.
        let _ = query.within(s, &mut Gather { candidates, keep: &query.keep });
    }
}

struct Counting<'a>(&'a PreciseQuery<'a>);

impl Kernel for Counting<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> usize {
        let mut sink = Count { count: 0, keep: &self.0.keep };
        // A sink that never breaks.
        let _ = self.0.within(s, &mut sink);
        sink.count
    }
}

struct Visiting<'a, 'b> {
    query: &'a PreciseQuery<'a>,
    visit: VisitSome<'b>,
}

impl Kernel for Visiting<'_, '_> {
    type Output = ControlFlow<()>;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> ControlFlow<()> {
        let Visiting { query, visit } = self;
        let mut sink = Visit::new(visit);
        query.within(s, &mut sink)?;
        sink.finish()
    }
}
