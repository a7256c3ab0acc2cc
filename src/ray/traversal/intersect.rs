//! The intersection of a ray with one primitive of a scene.

use crate::primitive::{PrimitiveSet, Scene};
use crate::ray::hit::SetHit;
use crate::ray::kernel::shear::Sheared;
use crate::ray::kernel::tree_ray::TreeRay;
use glam::{DVec3, Vec3};

impl Scene {
    /// The hit of a primitive at the ray's time within its range.
    #[inline(always)]
    pub(crate) fn intersect(&self, id: u32, ray: &TreeRay, sheared: &Sheared) -> Option<SetHit> {
        match self.shape(id) {
            None => {
                if let Some(corners) = self.triangles.precise_corners(id, ray.time()) {
                    return ray.decide_one(sheared, corners, ray.t_max());
                }
                let fine = || self.triangles.fine_corners(id, ray.time());
                // Where triangles move, the bound for all of the scene is tight enough: it lets a few more of them pass that the
                // ray passes within some 1e-6 of the scene.
                let size = if self.triangles.keys(id) == 1 { 0.0 } else { self.frame().reach };
                intersect_triangle(ray, sheared, self.triangles.corners(id, ray.time()), size, fine)
            }
            Some(shape) => {
                let hit = self.shapes.get(shape).intersect(ray.original)?;
                ray.hit(hit.t, hit.u, hit.v)
            }
        }
    }
}

/// Tests one triangle at the ray's time: its corners in f32, a bound of their size at the keys ([`Sheared::may_hit`]), and the
/// corners in f64 where they are needed.
#[inline(always)]
pub(crate) fn intersect_triangle(
    ray: &TreeRay,
    sheared: &Sheared,
    [a, b, c]: [Vec3; 3],
    size: f32,
    fine: impl FnOnce() -> [DVec3; 3],
) -> Option<SetHit> {
    // Each by itself: mapped arrays become calls.
    let corners = [sheared.corner(a, ray.origin), sheared.corner(b, ray.origin), sheared.corner(c, ray.origin)];
    if Sheared::may_hit(corners, size, ray.slack) { ray.decide_one(sheared, fine(), ray.t_max()) } else { None }
}
