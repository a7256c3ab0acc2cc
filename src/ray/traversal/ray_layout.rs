//! The interface of a layout for ray traversal.

use super::collect::Collect;
use super::intersect::RaySource;
use crate::ray::filter::Filter;
use crate::ray::kernel::tree_ray::TreeRay;
use crate::ray::observer::Observer;

/// A layout that rays can traverse.
pub(crate) trait RayLayout {
    /// Offers every hit that may matter to `collect`.
    fn traverse<G: RaySource>(
        self,
        set: &G,
        ray: &TreeRay,
        filter: &impl Filter,
        collect: &mut impl Collect,
        observer: &mut impl Observer,
    );
}
