//! The surface at a hit: corners and normals of triangles, points at other times, and rays that leave it.

use super::hit::Hit;
use super::interaction::SurfaceInteraction;
use super::layout::Layout;
use super::ray_tree::RayTree;
use crate::geometry::Ray;
use crate::primitive::{Intersection, Primitive, PrimitiveSet};
use glam::{DVec3, Vec3};

impl RayTree {
    /// The corners of a triangle of a mesh at any time, exactly as rays meet them. (Queries of closest points round moving ones to
    /// f32.) NaN if there is no such triangle. A time outside `[0, 1]` extrapolates the motion. So does one outside the active
    /// interval of a mesh of more than two keys, unless it is [`precise`](crate::TriangleMesh::precise): a tree holds only the keys
    /// around the interval.
    pub fn triangle(&self, mesh: u32, triangle: u32, time: f32) -> [DVec3; 3] {
        match self.scene.triangles.id(mesh, triangle) {
            Some(id) => {
                let [a, b, c] = self.scene.triangles.precise_corners(id, time).unwrap_or_else(|| match &self.layout {
                    Layout::Wide(tree) => tree.corners(&self.scene.triangles, id, time),
                    Layout::Kd(_) | Layout::Lazy(_) => self.scene.triangles.corners_at_any_time(id, time),
                });
                let frame = self.frame();
                [frame.fine_to_world(a), frame.fine_to_world(b), frame.fine_to_world(c)]
            }
            None => [DVec3::NAN; 3],
        }
    }

    /// The corners of the triangle that was hit, at any time: see [`RayTree::triangle`], also for times outside the active interval
    /// of its mesh.
    pub fn vertices(&self, hit: &Hit, time: f32) -> [DVec3; 3] {
        self.triangle(hit.mesh, hit.primitive, time)
    }

    /// The unit normal of the triangle that was hit, at any time. Seen from the side that it points to, the corners are in
    /// counter-clockwise order. Zero for a degenerate triangle, for indices that this tree does not have, and for a hit on a shape,
    /// whose normal depends on the point: see [`RayTree::surface_normal`].
    pub fn triangle_normal(&self, hit: &Hit, time: f32) -> Vec3 {
        self.normal_of_triangle(hit, time).as_vec3()
    }

    pub(crate) fn normal_of_triangle(&self, hit: &Hit, time: f32) -> DVec3 {
        let [a, b, c] = self.vertices(hit, time);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// The unit normal of the surface at the point that `ray` hit, at its time: of a triangle as [`RayTree::triangle_normal`] has
    /// it, of a sphere outwards, wherever the ray came from, of a custom primitive as it says itself
    /// ([`Primitive::surface_normal`]). Zero where there is none.
    ///
    /// ```
    /// use mbkd::{BuildParams, MovingSphere, Ray, RayTree, glam::{DVec3, Vec3}};
    /// let ball = MovingSphere::new(vec![(DVec3::ZERO, 2.0), (DVec3::X * 4.0, 2.0)]);
    /// let tree = RayTree::of_scene(&[], vec![ball], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(2.0, 0.0, 9.0), Vec3::NEG_Z).at_time(0.5);
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// assert_eq!(tree.surface_normal(&ray, &hit), Vec3::Z);
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn surface_normal(&self, ray: &Ray, hit: &Hit) -> Vec3 {
        self.interaction(ray, hit).normal()
    }

    /// The point of the surface that `ray` hit, its normal and rays that leave from there, all at once: where more than one of
    /// them is needed, this takes less time than [`RayTree::surface_normal`], [`RayTree::point_at`] and
    /// [`RayTree::secondary_ray`], which each look the triangle or shape up. Where this tree does not have the indices of `hit`,
    /// there is no normal.
    ///
    /// ```
    /// use mbkd::{BuildParams, MovingSphere, Ray, RayTree, glam::{DVec3, Vec3}};
    /// let ball = MovingSphere::new(vec![(DVec3::ZERO, 2.0), (DVec3::X * 4.0, 2.0)]);
    /// let tree = RayTree::of_scene(&[], vec![ball], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(2.0, 0.0, 9.0), Vec3::NEG_Z).at_time(0.5);
    /// let surface = tree.interaction(&ray, &tree.closest_hit(&ray).unwrap());
    /// assert_eq!((surface.point(), surface.normal()), (DVec3::new(2.0, 0.0, 2.0), Vec3::Z));
    /// assert!(!tree.any_hit(&surface.secondary_ray(Vec3::new(1.0, 0.0, 0.1))));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn interaction(&self, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        let (corners, space) = (self.vertices(hit, ray.time), self.frame().origin);
        SurfaceInteraction::with_triangle(corners, space, ray, hit)
            .unwrap_or_else(|| SurfaceInteraction::with_shape(self.shape_of(hit), ray, hit))
    }

    /// Where the point of the surface that `ray` hit is at another time of the shutter: for motion vectors. A point of a triangle
    /// keeps its weights, a point of a sphere its direction from the centre, and a custom primitive says it itself
    /// ([`Primitive::point_at`]). `None` where it does not, for indices that this tree does not have, and for a time outside of
    /// [0, 1]. Outside the active interval of a mesh, the motion is extrapolated as by [`RayTree::triangle`].
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::{DVec3, Vec3}};
    /// let open = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let close = open.iter().map(|p| p + 3.0 * Vec3::X).collect();
    /// let tree = RayTree::build(&[TriangleMesh::new(vec![[0, 1, 2]], vec![open, close])], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(1.75, 0.25, 1.0), Vec3::NEG_Z).at_time(0.5);
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// let [before, after] = [0.0, 1.0].map(|time| tree.point_at(&ray, &hit, time).unwrap());
    /// assert_eq!((before, after), (DVec3::new(0.25, 0.25, 0.0), DVec3::new(3.25, 0.25, 0.0)));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn point_at(&self, ray: &Ray, hit: &Hit, time: f32) -> Option<DVec3> {
        if let Some(shape) = self.shape_of(hit) {
            return point_of_shape(shape, ray, hit, time);
        }
        if !(0.0..=1.0).contains(&time) {
            return None;
        }
        let [a, b, c] = self.vertices(hit, time);
        let point = a + (b - a) * f64::from(hit.u) + (c - a) * f64::from(hit.v);
        (!point.is_nan()).then_some(point)
    }

    /// The number of meshes. A hit with this number as its mesh is one on a shape ([`RayTree::shape`]), and any lower one is the
    /// index of a mesh.
    pub fn mesh_count(&self) -> usize {
        self.scene.triangles.mesh_count()
    }

    /// The number of spheres and custom primitives.
    pub fn shape_count(&self) -> usize {
        self.scene.shapes.len()
    }

    /// A sphere or custom primitive by its index among those that were given to the build or the last refit, without the keys that
    /// were dropped ([`Primitive::merge_keys`]); `None` beyond them.
    ///
    /// ```
    /// use mbkd::{BuildParams, MovingSphere, RayTree, glam::DVec3};
    /// let tree = RayTree::of_scene(&[], vec![MovingSphere::fixed(DVec3::ZERO, 2.0)], &BuildParams::default())?;
    /// let ball = tree.shape(0).and_then(|shape| shape.as_sphere()).unwrap();
    /// assert_eq!(ball.keys, [(DVec3::ZERO, 2.0)]);
    /// assert!(tree.shape(1).is_none());
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn shape(&self, index: u32) -> Option<&dyn Primitive> {
        ((index as usize) < self.shape_count()).then(|| self.scene.shapes.get(index))
    }

    /// The shape that was hit; `None` if it was a triangle, or is not in this tree.
    fn shape_of(&self, hit: &Hit) -> Option<&dyn Primitive> {
        if hit.mesh as usize == self.mesh_count() { self.shape(hit.primitive) } else { None }
    }

    /// The ray from the point where `ray` hit the surface into the direction `dir`, at the same time: for shadow rays, reflections,
    /// refractions and bounces. Its origin is moved off the surface, to the side that `dir` leaves to, so that it does not hit the
    /// same triangle or sphere again at once. Its range is from 0 to infinity; limit that of a shadow ray by [`Ray::between`],
    /// whose ends are included: where the lamp is a surface of the scene, end a little before it. (Where the direction is so long
    /// that the origin moves by less than 7e-46 of it, half of the least `t` above 0, the same triangle is hit at 0.)
    ///
    /// A hit on a triangle need not come from a query: one with a `t` of 0 and `u` and `v` of any point of it, and any ray at the
    /// time, give rays that leave from there, to bake ambient occlusion into a mesh.
    ///
    /// The origin moves by 2^-36 of the coordinates and the size of the triangle (of a sphere's radius), which is far less than
    /// their coordinates in f32 are rounded by, and by what those of the point are; further on triangles that are more than a
    /// thousand times as long as wide. What else is in the scene does not matter. Of a custom primitive that is no sphere
    /// ([`Primitive::as_sphere`]) the surface is not known: there the origin moves by 2^-22 of the distance from the origin of
    /// `ray`, along the normal ([`Primitive::surface_normal`]) or, if there is none, along `ray`: then a ray that leaves at a
    /// grazing angle may hit the same primitive again at once.
    ///
    /// ```
    /// use mbkd::{BuildParams, Ray, RayTree, TriangleMesh, glam::Vec3};
    /// let floor = vec![Vec3::new(-9.0, -9.0, 0.1), Vec3::new(9.0, -9.0, 0.1), Vec3::new(0.0, 9.0, 0.1)];
    /// let tree = RayTree::build(&[TriangleMesh::fixed(vec![[0, 1, 2]], floor)], &BuildParams::default())?;
    /// let ray = Ray::new(Vec3::new(0.3, 0.4, 7.0), Vec3::new(0.1, 0.2, -1.0)).at_time(0.5);
    /// let hit = tree.closest_hit(&ray).unwrap();
    /// let light = Vec3::new(2.0, 3.0, 4.0);
    /// let to_light = light - tree.point_at(&ray, &hit, ray.time).unwrap().as_vec3();
    /// let shadow = tree.secondary_ray(&ray, &hit, to_light).between(0.0, 1.0);
    /// assert!(!tree.any_hit(&shadow));
    /// # Ok::<(), mbkd::BuildError>(())
    /// ```
    pub fn secondary_ray(&self, ray: &Ray, hit: &Hit, dir: Vec3) -> Ray {
        self.interaction(ray, hit).secondary_ray(dir)
    }
}

/// Where the point of a shape that was hit is at another time of the shutter; `None` if it is not known.
fn point_of_shape(shape: &dyn Primitive, ray: &Ray, hit: &Hit, time: f32) -> Option<DVec3> {
    if !(0.0..=1.0).contains(&time) {
        return None;
    }
    let met = Intersection { t: hit.t, u: hit.u, v: hit.v };
    let point = match shape.as_sphere() {
        Some(sphere) => sphere.point_at(ray, met, time),
        None => shape.point_at(ray, met, time),
    };
    point.filter(|point| !point.is_nan())
}
