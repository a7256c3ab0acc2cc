//! The interface of a layout for ray traversal.

use super::collect::Collect;
use crate::primitive::Scene;
use crate::ray::filter::Filter;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;

/// A layout that rays can traverse.
pub(crate) trait RayLayout {
    /// Rays that begin farther from the origin of tree space are traversed in pieces.
    fn near(&self) -> f32;
    /// Offers every hit that may matter to `collect`. Of a ray in pieces it is given the first.
    fn traverse(
        self,
        scene: &Scene,
        ray: &mut TreeRay,
        filter: &impl Filter,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    );
}
