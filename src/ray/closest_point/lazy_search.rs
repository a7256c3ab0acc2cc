//! The closest point in a lazy tree: the coarse tree orders the subtrees by distance, and all of them share one best
//! answer.

use super::closest_search::{Best, ClosestPoint, InPrimitives, begin};
use super::nearest_first::{LeafSearch, NearestFirst};
use super::point_query::{PlacedQuery, QueryInTree};
use crate::layout::{ChildRef, LazyTree};
use crate::primitive::{PrimitiveSet, Scene};
use crate::ray::filter::Filter;
use crate::ray::observer::Observer;
use crate::simd::{Simd, SimdLevel, dispatch};

/// The closest point in a lazy tree.
#[inline(never)]
pub(in crate::ray) fn closest_point_in_lazy(
    simd: SimdLevel,
    tree: &LazyTree,
    scene: &Scene,
    query: &PlacedQuery,
    filter: &impl Filter<ClosestPoint>,
    observer: &mut impl Observer,
) -> Option<ClosestPoint> {
    let query = &QueryInTree::new(query, scene.frame())?;
    let mut best = begin(scene, query, filter);
    let mut leaves = InSubtrees { simd, tree, best: &mut best, observer };
    dispatch(simd, NearestFirst { tree: &tree.top, query, leaves: &mut leaves });
    best.finish()
}

/// Leaves of one subtree each.
struct InSubtrees<'a, 'b, F, O> {
    simd: SimdLevel,
    tree: &'a LazyTree,
    best: &'b mut Best<'a, F>,
    observer: &'b mut O,
}

impl<F: Filter<ClosestPoint>, O: Observer> LeafSearch for InSubtrees<'_, '_, F, O> {
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.best.limit
    }

    #[inline(always)]
    fn hides(&self, block: ChildRef) -> bool {
        self.best.hides(&self.tree.top, block)
    }

    #[inline(always)]
    fn node(&mut self) {
        self.observer.node();
    }

    #[inline(always)]
    fn leaf<S: Simd>(&mut self, _: S, leaf: ChildRef) {
        let tree = self.tree.subtree(self.best.scene, self.tree.below(leaf));
        let query = self.best.query;
        let mut leaves = InPrimitives { tree, best: &mut *self.best, observer: &mut *self.observer };
        dispatch(self.simd, NearestFirst { tree, query, leaves: &mut leaves });
    }
}
