//! A stage with its tree: ray queries, and the surface at a hit.

use crate::gloss::{Gloss, Scattered};
use crate::lamps::{Lamps, Sight, spread};
use crate::materials::Surface;
use crate::sampling::Sampler;
use crate::stage::{LEVELS, Things};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildError, BuildParams, Hit, MovingSphere, Observer, Ray, RayTree, Statistics};
use mbkd_scenes::FlakeSphere;
use std::f32::consts::PI;

/// A tree and the surfaces of its primitives.
pub struct World {
    tree: RayTree,
    /// The surface and the triangles of each mesh.
    surfaces: Vec<(Surface, Vec<[u32; 3]>)>,
    /// The colour of each sphere.
    colors: Vec<Vec3>,
    /// The lamps that shadow rays sample.
    pub(crate) lamps: Lamps,
}

/// Shadow rays end this share of their length before the lamp.
const BEFORE_LAMP: f32 = 1.0 - 1e-5;

/// A point on a surface.
pub struct Point {
    /// Its position, just off the surface on the side of the ray's origin.
    pub position: DVec3,
    /// Unit normal for shading, on the side of the ray's origin.
    pub normal: Vec3,
    /// Diffuse reflectance, where there is no gloss.
    pub color: Vec3,
    /// Its gloss, if any.
    gloss: Option<Gloss>,
    /// Emitted radiance.
    pub emission: Vec3,
}

impl Point {
    /// The light reflected to the eye from a direction, relative to that of a white diffuse surface.
    pub fn reflects(&self, to_eye: Vec3, to_light: Vec3) -> Vec3 {
        self.gloss.map_or(self.color, |gloss| gloss.reflects(self.normal, to_eye, to_light))
    }

    /// Samples a direction of incoming light; `None` if it is absorbed.
    pub fn scatter(&self, to_eye: Vec3, sampler: &mut Sampler) -> Option<Scattered> {
        match self.gloss {
            Some(gloss) => gloss.scatter(self.normal, to_eye, sampler),
            None => Some(Scattered { dir: sampler.cosine(self.normal), share: self.color, spread: 1.0 }),
        }
    }

    /// The density with which `scatter` samples a direction, per steradian.
    pub fn density(&self, to_eye: Vec3, to_light: Vec3) -> f32 {
        match self.gloss {
            Some(gloss) => gloss.density(self.normal, to_eye, to_light),
            None => self.normal.dot(to_light).max(0.0) / PI,
        }
    }

    /// The same point with mirrors, if it has any, that tilt at least this far.
    pub fn leaning(self, least: f32) -> Point {
        Point { gloss: self.gloss.map(|gloss| gloss.leaning(least)), ..self }
    }
}

impl World {
    /// Builds the tree of a stage.
    pub fn build(things: &Things, params: &BuildParams) -> Result<World, BuildError> {
        let Things { meshes, surfaces, spheres, colors } = things;
        let colors = if colors.is_empty() { &LEVELS[..] } else { colors };
        Ok(World {
            tree: RayTree::of_scene(meshes, spheres.iter().map(moving).collect(), params)?,
            surfaces: surfaces.iter().cloned().zip(meshes.iter().map(|mesh| mesh.indices.clone())).collect(),
            lamps: Lamps::new(meshes, surfaces),
            colors: spheres.iter().map(|sphere| colors[sphere.level as usize % colors.len()]).collect(),
        })
    }

    /// The closest hit.
    pub fn closest(&self, ray: &Ray, observer: &mut impl Observer) -> Option<Hit> {
        self.tree.closest_hit_observed(ray, observer)
    }

    /// Whether there is any hit.
    pub fn any(&self, ray: &Ray, observer: &mut impl Observer) -> bool {
        self.tree.any_hit_observed(ray, observer)
    }

    /// The surface point at a hit.
    pub fn point(&self, ray: &Ray, hit: &Hit) -> Point {
        let at_hit = self.tree.interaction(ray, hit);
        let outward = at_hit.normal();
        let flat = if outward.dot(ray.dir) > 0.0 { -outward } else { outward };
        let (mut gloss, mut emission) = (None, Vec3::ZERO);
        let (normal, color) = match self.surfaces.get(hit.mesh as usize) {
            Some((surface, indices)) => {
                let triangle = indices[hit.primitive as usize];
                let color = surface.color_at(hit, triangle);
                (gloss, emission) = (surface.gloss_at(hit, triangle, color), surface.emission_at(hit, triangle));
                (surface.normal_at(hit, ray.time, flat), color)
            }
            None => (flat, self.colors[hit.primitive as usize]),
        };
        Point { position: at_hit.secondary_ray(flat).origin, normal, color, gloss, emission }
    }

    /// Samples a point on a lamp: its shadow ray, and the light it sends if unoccluded; `None` without lamps.
    pub fn towards_lamp(&self, from: &Point, time: f32, sampler: &mut Sampler) -> Option<(Sight, Ray, Vec3)> {
        let (mesh, primitive) = self.lamps.chosen(sampler.unit())?;
        let [u, v] = spread(sampler.square());
        let corners @ [a, b, c] = self.tree.triangle(mesh, primitive, time);
        let place = a * f64::from(1.0 - u - v) + b * f64::from(u) + c * f64::from(v);
        let sight = Sight::new(from.position, place, corners, self.lamps.chance(mesh, primitive));
        let (surface, indices) = &self.surfaces[mesh as usize];
        let emission = surface.emission_at(&Hit { t: 0.0, u, v, mesh, primitive }, indices[primitive as usize]);
        let ray = Ray::new(from.position, sight.dir).at_time(time).between(0.0, sight.distance as f32 * BEFORE_LAMP);
        Some((sight, ray, emission))
    }

    /// The density with which a shadow ray would have sampled the point that another ray hit, per steradian.
    pub fn lamp_density(&self, ray: &Ray, hit: &Hit) -> f32 {
        let chance = self.lamps.chance(hit.mesh, hit.primitive);
        Sight::new(ray.origin, ray.point(hit.t), self.tree.vertices(hit, ray.time), chance).density
    }

    /// The statistics of the tree.
    pub fn statistics(&self) -> Statistics {
        self.tree.statistics()
    }
}

fn moving(sphere: &FlakeSphere) -> MovingSphere {
    MovingSphere::new(sphere.centers.map(|center| (center.as_dvec3(), f64::from(sphere.radius))).into())
}
