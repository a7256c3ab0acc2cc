//! The triangle test by itself, for custom acceleration structures.

use crate::error::BuildError;
use crate::geometry::{Aabb, Box3, KERNEL_ULPS, LinearBounds, TimeInterval, ULP};
use crate::primitive::{PrimitiveSet, Scene, TriangleMesh, no_shapes};
use crate::ray::{Hit, Ray, Sheared, TreeRay};
use glam::{Vec3, Vec3A};

/// Tests triangles one by one, exactly as [`RayTree`](crate::RayTree) and [`BruteForce`](super::BruteForce) do.
///
/// For custom structures that are to be compared with the library's: any structure that culls conservatively, tests all
/// remaining triangles here and prefers the lowest index of several hits at the least `t`, gives the answers of brute force,
/// bit for bit.
///
/// All coordinates are in *tree space*, as in the library's trees: world space translated and scaled by a power of two such
/// that no coordinate is much larger than 1. A triangle's index counts through the meshes in their order.
///
/// ```
/// use mbkd::baseline::{BruteForce, TriangleTests};
/// use mbkd::{Hit, Ray, TriangleMesh, glam::Vec3};
/// let meshes = [TriangleMesh::fixed(vec![[0, 1, 2]; 2], vec![Vec3::ZERO, Vec3::X, Vec3::Y])];
/// let tests = TriangleTests::new(&meshes)?;
/// let ray = Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z);
/// let mut best: Option<Hit> = None;
/// if let Some(prepared) = tests.prepare(&ray) {
///     for index in 0..tests.len() as u32 {
///         let limit = best.map_or(f32::INFINITY, |hit| hit.t);
///         if let Some(hit) = tests.hit(&prepared, index, limit)
///             && best.is_none_or(|best| hit.t < best.t)
///         {
///             best = Some(hit);
///         }
///     }
/// }
/// assert_eq!(best, BruteForce::new(&meshes)?.closest_hit(&ray));
/// # Ok::<(), mbkd::BuildError>(())
/// ```
#[derive(Debug)]
pub struct TriangleTests {
    scene: Scene,
}

impl TriangleTests {
    /// Tests of triangle meshes.
    ///
    /// # Errors
    /// An invalid mesh, as [`RayTree::build`](crate::RayTree::build) reports it.
    pub fn new(meshes: &[TriangleMesh]) -> Result<TriangleTests, BuildError> {
        Ok(TriangleTests { scene: Scene::new(meshes, no_shapes())? })
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.scene.len()
    }

    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of the vertices and of the other data of the tests.
    pub fn bytes(&self) -> usize {
        self.scene.bytes()
    }

    /// The number of kept keys of a triangle's motion, at least 1; they are spaced evenly over the shutter.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn keys(&self, index: u32) -> usize {
        self.scene.triangles.keys(index)
    }

    /// The corners of a triangle at a time of the shutter.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn corners(&self, index: u32, time: f32) -> [Vec3; 3] {
        self.scene.triangles.corners(index, time)
    }

    /// Bounds that hold the corners of a triangle at every time of an interval.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn bounds(&self, index: u32, over: TimeInterval) -> LinearBounds {
        let bounds = self.scene.bounds(index, over);
        let wide = |b: Box3| Aabb { min: b.min.as_dvec3(), max: b.max.as_dvec3() };
        LinearBounds { begin: wide(bounds.begin), end: wide(bounds.end) }
    }

    /// The padding, on every side, of a box around triangles, if none of its coordinates is
    /// larger than `magnitude`: then a slab test, done in f32 with the ray's [`slack`](PreparedRay::slack), finds the box
    /// whenever [`hit`](TriangleTests::hit) hits one of these triangles. It includes the rounding of the slab test, not that of
    /// a box that is interpolated.
    pub fn padding(magnitude: f32) -> f32 {
        KERNEL_ULPS * ULP * magnitude
    }

    /// Prepares a ray for tests; `None` for one that cannot hit anything (see [`Ray`]).
    #[inline]
    pub fn prepare<'a>(&self, ray: &'a Ray) -> Option<PreparedRay<'a>> {
        TreeRay::new(ray, self.scene.frame()).map(|ray| PreparedRay { sheared: Sheared::new(&ray), ray })
    }

    /// The hit of a ray and a triangle, in the ray's range and no farther than `limit`.
    ///
    /// # Panics
    /// If there is no such triangle.
    #[inline]
    pub fn hit(&self, ray: &PreparedRay, index: u32, limit: f32) -> Option<Hit> {
        if !self.scene.exists_at(index, ray.time()) {
            return None;
        }
        test(&self.scene, index, ray, limit)
    }
}

#[inline(always)]
fn test(scene: &Scene, index: u32, ray: &PreparedRay, limit: f32) -> Option<Hit> {
    let hit = scene.intersect(index, &ray.ray, &ray.sheared)?;
    (hit.t <= limit).then(|| hit.answer(scene.mesh_and_primitive(index)))
}

/// A ray in tree space, for [`TriangleTests::hit`] and for slab tests: a point of it is `origin + direction * distance`, where the
/// direction is the ray's, scaled by a power of two so that its largest component is in [1, 2).
#[derive(Debug)]
pub struct PreparedRay<'a> {
    ray: TreeRay<'a>,
    sheared: Sheared,
}

impl PreparedRay<'_> {
    /// The origin of the ray; for rays that begin far away it was moved near the scene.
    #[inline]
    pub fn origin(&self) -> Vec3A {
        let [x, y, z, _] = self.ray.origin;
        Vec3A::new(x, y, z)
    }

    /// One over each component of the direction. Never infinite: components that are too small count as 2^-24.
    #[inline]
    pub fn inverse(&self) -> Vec3A {
        self.ray.slabs.inverse
    }

    /// How much slab tests must enlarge boxes, on every side.
    #[inline]
    pub fn slack(&self) -> f32 {
        self.ray.slack
    }

    /// The range of distances.
    #[inline]
    pub fn range(&self) -> (f32, f32) {
        (self.ray.begin, self.ray.end)
    }

    /// A distance beyond which no hit is as near as `t`.
    #[inline]
    pub fn reach(&self, t: f32) -> f32 {
        self.ray.reach(t)
    }

    /// The time of the ray.
    #[inline]
    pub fn time(&self) -> f32 {
        self.ray.time()
    }
}
