//! The oracle of the tests: every primitive, one after the other, with the same kernel.

use super::spheres::Spheres;
use crate::error::BuildError;
use crate::primitive::{Primitive, PrimitiveSet, Scene, TriangleMesh, no_shapes};
use crate::ray::{
    ClosestPoint, ClosestPointQuery, Everything, Filter, Hit, PlacedQuery, Ray, Sheared, TreeRay, Visible,
    closest_point_of_all,
};
use core::fmt;

/// Answers ray queries by testing every primitive.
///
/// All trees must agree with it bit for bit. It has its own copy of the primitives and uses no
/// tree. O(n) per ray: it visits every primitive, and skips those whose bounding spheres over the whole shutter are
/// clearly missed by the ray's line.
///
/// ```
/// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, baseline::BruteForce, glam::Vec3};
/// let meshes = [TriangleMesh::fixed(vec![[0, 1, 2]], vec![Vec3::ZERO, Vec3::X, Vec3::Y])];
/// let tree = RayTree::build(&meshes, &BuildParams::default())?;
/// let ray = Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z);
/// assert_eq!(tree.closest_hit(&ray), BruteForce::new(&meshes)?.closest_hit(&ray));
/// # Ok::<(), mbkd::BuildError>(())
/// ```
pub struct BruteForce {
    scene: Scene,
    spheres: Spheres,
}

impl fmt::Debug for BruteForce {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BruteForce").field("scene", &self.scene).finish_non_exhaustive()
    }
}

impl BruteForce {
    /// Brute force over triangle meshes.
    ///
    /// # Errors
    /// An invalid mesh, as [`RayTree::build`](crate::RayTree::build) reports it.
    pub fn new(meshes: &[TriangleMesh]) -> Result<BruteForce, BuildError> {
        Ok(BruteForce::over(Scene::new(meshes, no_shapes())?))
    }

    /// Brute force over meshes and other shapes.
    ///
    /// # Errors
    /// As [`RayTree::of_scene`](crate::RayTree::of_scene) reports them. (A tree may ask a shape for its bounds over other parts of
    /// the shutter as well, and refuse it for those.)
    pub fn of_scene<P: Primitive + 'static>(meshes: &[TriangleMesh], shapes: Vec<P>) -> Result<BruteForce, BuildError> {
        Ok(BruteForce::over(Scene::new(meshes, Box::new(shapes))?))
    }

    fn over(scene: Scene) -> BruteForce {
        let boxes = (0..scene.len() as u32).map(|id| scene.bounds(id, scene.active(id)).swept());
        BruteForce { spheres: boxes.collect(), scene }
    }

    /// All accepted hits in the order of ids.
    fn visit(&self, ray: &Ray, filter: &impl Filter, mut visitor: impl FnMut(Hit)) {
        let Some(ray) = TreeRay::new(ray, self.scene.frame()) else { return };
        let sheared = Sheared::new(&ray);
        self.spheres.near(&ray, |id| {
            if self.scene.active(id).contains(ray.time())
                && filter.sees(|| self.scene.mask(id))
                && let Some(hit) = self.scene.intersect(id, &ray, &sheared)
            {
                let hit = hit.answer(self.scene.mesh_and_primitive(id));
                if filter.accepts(|| (0, hit)) {
                    visitor(hit);
                }
            }
        });
    }

    fn closest(&self, ray: &Ray, filter: &impl Filter) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.visit(ray, filter, |hit| {
            if best.is_none_or(|b| hit.t < b.t) {
                best = Some(hit);
            }
        });
        best
    }

    /// As [`RayTree::closest_hit`](crate::RayTree::closest_hit).
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.closest(ray, &Everything)
    }

    /// As [`RayTree::any_hit`](crate::RayTree::any_hit).
    pub fn any_hit(&self, ray: &Ray) -> bool {
        self.closest_hit(ray).is_some()
    }

    /// As [`RayTree::all_hits`](crate::RayTree::all_hits), in the order of (mesh, primitive).
    pub fn all_hits(&self, ray: &Ray) -> Vec<Hit> {
        let mut hits = Vec::new();
        self.visit(ray, &Everything, |hit| {
            hits.push(hit);
        });
        hits
    }

    /// As [`RayTree::closest_point`](crate::RayTree::closest_point).
    pub fn closest_point(&self, query: &ClosestPointQuery) -> Option<ClosestPoint> {
        self.closest_point_placed(&(*query).into(), &Everything)
    }

    /// The same with all primitives placed in another space.
    pub(crate) fn closest_point_placed(
        &self,
        query: &PlacedQuery,
        filter: &impl Filter<ClosestPoint>,
    ) -> Option<ClosestPoint> {
        closest_point_of_all(&self.scene, query, filter)
    }

    /// As [`RayTree::closest_point_filtered`](crate::RayTree::closest_point_filtered).
    pub fn closest_point_filtered(
        &self,
        query: &ClosestPointQuery,
        mask: u32,
        accept: impl Fn(&ClosestPoint) -> bool,
    ) -> Option<ClosestPoint> {
        self.closest_point_placed(&(*query).into(), &Visible { mask, accept: Some(accept) })
    }

    /// As [`RayTree::closest_hit_filtered`](crate::RayTree::closest_hit_filtered).
    pub fn closest_hit_filtered(&self, ray: &Ray, mask: u32, accept: impl Fn(&Hit) -> bool) -> Option<Hit> {
        self.closest(ray, &Visible { mask, accept: Some(|(_, hit): &(usize, Hit)| accept(hit)) })
    }
}
