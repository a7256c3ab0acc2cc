//! The steps of a search for a group, each of which is compiled once: what does not depend on the visitor for all of them.

use super::candidates::{Behind, SweptCandidates};
use super::coordinate::SweptCoordinate;
use super::criteria::Criteria;
use super::encounter::EncounterVisitor;
use super::group::{Block, SweptGroup};
use super::pair_filter::PairFilter;
use super::window::Window;
use crate::point::layout::over_interval::BlockTree;
use crate::simd::{Kernel, Simd};

/// See [`SweptGroup::take`].
pub(super) struct TakeGroup<'a, T: BlockTree> {
    pub(super) group: &'a mut SweptGroup<T::Coordinate>,
    pub(super) tree: &'a T,
    pub(super) node: usize,
    pub(super) times: [f32; 2],
    pub(super) excess: f64,
}

impl<C: SweptCoordinate, T: BlockTree<Coordinate = C>> Kernel for TakeGroup<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        self.group.take(self.tree, self.node, self.times, self.excess);
    }
}

/// See [`SweptCandidates::add`].
pub(super) struct AddCandidates<'a, T: BlockTree> {
    pub(super) candidates: &'a mut SweptCandidates<T::Coordinate>,
    pub(super) tree: &'a T,
    pub(super) group: &'a SweptGroup<T::Coordinate>,
    pub(super) window: (Window, Behind<'a>),
    pub(super) criteria: &'a Criteria<'a>,
    pub(super) most: usize,
}

impl<C: SweptCoordinate, T: BlockTree<Coordinate = C>> Kernel for AddCandidates<'_, T> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let AddCandidates { candidates, tree, group, window, criteria, most } = self;
        candidates.add(s, tree, group, window, criteria, most)
    }
}

/// See [`PairFilter::visit`].
pub(super) struct ShowBlock<'a, V, C: SweptCoordinate> {
    pub(super) block: &'a Block<C>,
    pub(super) candidates: &'a SweptCandidates<C>,
    pub(super) criteria: &'a Criteria<'a>,
    pub(super) filter: &'a mut PairFilter,
    pub(super) visitor: &'a mut V,
}

impl<V: EncounterVisitor, C: SweptCoordinate> Kernel for ShowBlock<'_, V, C> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let ShowBlock { block, candidates, criteria, filter, visitor } = self;
        filter.visit(s, (block, candidates), criteria, visitor);
    }
}
