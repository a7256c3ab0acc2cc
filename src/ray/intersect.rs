//! What a ray hits of one primitive of a set.

use super::hit::SetHit;
use super::tree_ray::TreeRay;
use crate::layout::WideSource;
use crate::primitive::{Primitive, Shapes, Triangles};
use glam::Vec3;

/// A set of primitives that rays can be tested against one by one.
pub(crate) trait RaySource: WideSource {
    /// The hit at the ray's time within its range.
    fn intersect(&self, id: u32, ray: &TreeRay) -> Option<SetHit>;
}

impl RaySource for Triangles {
    #[inline]
    fn intersect(&self, id: u32, ray: &TreeRay) -> Option<SetHit> {
        intersect_triangle(ray, self.corners(id, ray.time))
    }
}

impl<P: Primitive> RaySource for Shapes<P> {
    fn intersect(&self, id: u32, ray: &TreeRay) -> Option<SetHit> {
        let hit = self.shapes()[id as usize].intersect(&ray.world)?;
        let t = ray.tree_t(hit.t);
        // In this form NaN is no hit.
        (ray.t_min <= t && t <= ray.t_max).then_some(SetHit { t, u: hit.u, v: hit.v })
    }
}

/// Tests one triangle at the ray's time.
#[inline]
pub(crate) fn intersect_triangle(ray: &TreeRay, corners: [Vec3; 3]) -> Option<SetHit> {
    let shear = &ray.shear;
    shear.test(corners.map(|v| shear.corner(v, ray.origin)), ray.t_min, ray.t_max)
}
