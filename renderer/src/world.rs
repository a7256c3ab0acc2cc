//! A stage with its tree: what rays are asked of, and what is known where they hit.

use crate::materials::Surface;
use crate::stage::{LEVELS, Things};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    BuildError, BuildParams, Hit, Keys, MovingSphere, Observer, Ray, RayTree, Shapes, Statistics, TriangleMesh,
};
use mbkd_scenes::FlakeSphere;

/// A tree and the surfaces of the things in it.
pub struct World {
    tree: Tree,
    /// How far points are lifted off a surface before the next ray starts, relative to the distances involved.
    lift: f32,
}

enum Tree {
    Meshes { tree: RayTree, surfaces: Vec<Surface>, indices: Vec<Vec<[u32; 3]>> },
    Spheres { tree: RayTree<Shapes<MovingSphere>>, levels: Vec<u32> },
    Fluid { solid: RayTree, surfaces: Vec<Surface>, drops: RayTree<Shapes<MovingSphere>>, colors: Vec<Vec3> },
}

/// The mesh that hits on drops of a fluid are given.
const DROPS: u32 = u32::MAX;

/// A point on a surface.
pub struct Point {
    /// Where it is, lifted off the surface towards the ray's origin.
    pub position: DVec3,
    /// Unit normal for shading, on the side of the ray's origin.
    pub normal: Vec3,
    /// Diffuse reflectance.
    pub color: Vec3,
}

impl World {
    /// Builds the tree of a stage.
    pub fn build(things: &Things, params: &BuildParams) -> Result<World, BuildError> {
        Ok(match things {
            Things::Meshes(meshes, surfaces) => World {
                lift: 4e-6 * meshes.iter().map(extent).fold(0.0, f32::max),
                tree: Tree::Meshes {
                    tree: RayTree::build(meshes, params)?,
                    surfaces: surfaces.clone(),
                    indices: meshes.iter().map(|mesh| mesh.indices.clone()).collect(),
                },
            },
            Things::Spheres(spheres) => World {
                lift: 1e-5,
                tree: Tree::Spheres {
                    tree: RayTree::of_primitives(spheres.iter().map(moving).collect(), params)?,
                    levels: spheres.iter().map(|sphere| sphere.level).collect(),
                },
            },
            Things::Fluid { meshes, surfaces, drops } => World {
                lift: 1e-5,
                tree: Tree::Fluid {
                    solid: RayTree::build(meshes, params)?,
                    surfaces: surfaces.clone(),
                    drops: RayTree::of_primitives(drops.iter().map(|drop| drop.0.clone()).collect(), params)?,
                    colors: drops.iter().map(|drop| drop.1).collect(),
                },
            },
        })
    }

    /// The nearest hit.
    pub fn closest(&self, ray: &Ray, observer: &mut impl Observer) -> Option<Hit> {
        match &self.tree {
            Tree::Meshes { tree, .. } => tree.closest_hit_observed(ray, observer),
            Tree::Spheres { tree, .. } => tree.closest_hit_observed(ray, observer),
            Tree::Fluid { solid, drops, .. } => {
                let behind = solid.closest_hit_observed(ray, observer);
                let most = behind.map_or(ray.t_max, |hit| hit.t);
                let drop = drops.closest_hit_observed(&ray.between(ray.t_min, most), observer);
                drop.map(|hit| Hit { mesh: DROPS, ..hit }).or(behind)
            }
        }
    }

    /// Whether there is any hit.
    pub fn any(&self, ray: &Ray, observer: &mut impl Observer) -> bool {
        match &self.tree {
            Tree::Meshes { tree, .. } => tree.any_hit_observed(ray, observer),
            Tree::Spheres { tree, .. } => tree.any_hit_observed(ray, observer),
            Tree::Fluid { solid, drops, .. } => {
                drops.any_hit_observed(ray, observer) || solid.any_hit_observed(ray, observer)
            }
        }
    }

    /// What is where a ray hit.
    pub fn point(&self, ray: &Ray, hit: &Hit) -> Point {
        let at = ray.point(hit.t);
        let facing = |normal: Vec3| if normal.dot(ray.dir) > 0.0 { -normal } else { normal };
        let (flat, normal, color) = match &self.tree {
            Tree::Meshes { tree, surfaces, indices } => {
                let (mesh, triangle) = (hit.mesh as usize, hit.primitive as usize);
                let flat = facing(tree.normal(hit, ray.time));
                let surface = &surfaces[mesh];
                (flat, surface.normal_at(hit, ray.time, flat), surface.color_at(hit, indices[mesh][triangle]))
            }
            Tree::Spheres { tree, levels } => {
                let sphere = hit.primitive as usize;
                let (center, _) = tree.primitives()[sphere].at(ray.time);
                let color = LEVELS[levels[sphere] as usize % LEVELS.len()];
                let normal = facing((at - center).normalize_or_zero().as_vec3());
                (normal, normal, color)
            }
            Tree::Fluid { drops, colors, .. } if hit.mesh == DROPS => {
                let drop = hit.primitive as usize;
                let normal = facing((at - drops.primitives()[drop].at(ray.time).0).normalize_or_zero().as_vec3());
                (normal, normal, colors[drop])
            }
            Tree::Fluid { solid, surfaces, .. } => {
                let flat = facing(solid.normal(hit, ray.time));
                (flat, flat, surfaces[hit.mesh as usize].color)
            }
        };
        let lift = self.lift + 2e-6 * hit.t * ray.dir.length();
        Point { position: at + flat.as_dvec3() * f64::from(lift), normal, color }
    }

    /// Figures of the tree.
    pub fn statistics(&self) -> Statistics {
        match &self.tree {
            Tree::Meshes { tree, .. } => tree.statistics(),
            Tree::Spheres { tree, .. } | Tree::Fluid { drops: tree, .. } => tree.statistics(),
        }
    }
}

/// The largest coordinate of a mesh.
fn extent(mesh: &TriangleMesh) -> f32 {
    match &mesh.keys {
        Keys::F32(keys) => keys.iter().flatten().fold(0.0, |most, p| p.abs().max_element().max(most)),
        Keys::F64(keys) => keys.iter().flatten().fold(0.0, |most, p| p.abs().max_element().max(most)) as f32,
    }
}

fn moving(sphere: &FlakeSphere) -> MovingSphere {
    MovingSphere::new(sphere.centers.map(|center| (center.as_dvec3(), f64::from(sphere.radius))).into())
}
