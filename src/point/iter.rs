//! Points within a radius as an iterator, which searches one bottom node at a time.

use super::neighbor::Neighbor;
use super::partition::{Layer, LayerView};
use super::query::{Gather, NeighborQuery};
use super::search::Keep;
use super::search::candidates::Candidates;
use super::search::radius::{Front, leaves};
use super::snapshot::View;
use crate::simd::{Kernel, Simd, dispatch};

/// Iterator over the points within the radius of a query; made by [`NeighborQuery::iter`].
pub struct WithinIter<'a, K> {
    query: NeighborQuery<'a, K>,
    layer: usize,
    front: Option<Front>,
    /// Found in the last bottom node and not yet handed out.
    candidates: Candidates,
    next: usize,
}

impl<'a, K: Keep> WithinIter<'a, K> {
    pub(super) fn new(query: NeighborQuery<'a, K>) -> Self {
        let layer = if query.bound >= 0.0 { 0 } else { query.tree.layers.len() };
        let mut candidates = Candidates::default();
        if query.bound >= 0.0 && query.is_precise() {
            query.asked(|asked| asked.collect(&mut candidates));
        }
        WithinIter { query, layer, front: None, candidates, next: 0 }
    }
}

impl<'a, K: Keep> NeighborQuery<'a, K> {
    /// An iterator over the points within the radius, in no particular order. It searches as it goes, but among
    /// points that are kept in f64 all at once.
    ///
    /// ```
    /// use mbkd::{PointParams, PointTree};
    /// let tree = PointTree::build(&[[0.0f32; 3], [1.0; 3], [9.0; 3]], &PointParams::default())?;
    /// let far = tree.query([0.0f32; 3], 0.0).radius(2.0).iter().find(|n| n.distance() > 1.0);
    /// assert_eq!(far.map(|n| n.id), Some(1));
    /// # Ok::<(), mbkd::PointError>(())
    /// ```
    pub fn iter(self) -> WithinIter<'a, K> {
        WithinIter::new(self)
    }
}

impl<K: Keep> Iterator for WithinIter<'_, K> {
    type Item = Neighbor;

    fn next(&mut self) -> Option<Neighbor> {
        while self.next == self.candidates.count {
            let layer = self.query.tree.layers.get(self.layer)?;
            (self.next, self.candidates.count) = (0, 0);
            let level = self.query.tree.simd;
            if !dispatch(level, Step { iter: self, layer }) {
                self.layer += 1;
                self.front = None;
            }
        }
        let i = self.next;
        self.next += 1;
        Some(Neighbor { id: self.candidates.ids[i], distance_squared: self.candidates.distances[i] })
    }
}

/// Searches the next bottom node of a layer; false where there is none.
struct Step<'i, 'l, 'a, K> {
    iter: &'i mut WithinIter<'a, K>,
    layer: &'l Layer,
}

impl<K: Keep> Kernel for Step<'_, '_, '_, K> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        match self.layer.at(self.iter.query.time) {
            LayerView::Still(view) => step(s, self.iter, &view),
            LayerView::Moving(view) => step(s, self.iter, &view),
            LayerView::Timed(view) => step(s, self.iter, &view),
        }
    }
}

#[inline(always)]
fn step<S: Simd, V: View, K: Keep>(s: S, iter: &mut WithinIter<'_, K>, view: &V) -> bool {
    let bound = s.splat(iter.query.bound);
    let target = view.target(s, iter.query.point);
    let front = iter.front.get_or_insert_with(|| Front::begin(view));
    let Some(found) = front.next(s, view, &target, bound, &mut ()) else { return false };
    let mut sink = Gather { candidates: &mut iter.candidates, keep: &iter.query.keep };
    // A sink that never breaks.
    let _ = leaves(s, view, &target, bound, found, &mut sink, &mut ());
    true
}
