//! The rays of one scene: primary, diffuse bounce, ambient occlusion, generated once and given to both sides.
//!
//! Primary rays come in tiles of 8×8 pixels, each ray at its own time. At their hits, bounce rays and occlusion rays
//! start at the same time, slightly off the surface, with cosine-distributed directions; several per hit if the scene
//! covers little of the picture, so that there are enough to time.

use crate::triangles::{facing_normal, scene_size};
use glam::Vec3;
use mbkd::{Hit, Ray, TriangleMesh, glam};
use mbkd_scenes::Camera;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Side of a tile of pixels.
const TILE: usize = 8;
/// The distance of secondary origins from the surface, relative to the scene's size.
const OFFSET: f32 = 1e-5;
/// The length of ambient occlusion rays, relative to the scene's size.
const OCCLUSION_REACH: f32 = 0.1;

/// The greatest number of secondary rays of a kind per hit.
const MOST_SAMPLES: usize = 16;

/// A kind of ray.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub enum Kind {
    /// Camera rays: closest hit.
    Primary,
    /// One diffuse bounce: closest hit.
    Bounce,
    /// Ambient occlusion: any hit within a tenth of the scene's size.
    Ao,
}

impl Kind {
    /// As in tables.
    pub fn name(self) -> &'static str {
        ["primary", "bounce", "AO"][self as usize]
    }
}

/// The rays of one scene by kind.
pub struct Rays {
    /// From the camera.
    pub primary: Vec<Ray>,
    /// From their hits.
    pub bounce: Vec<Ray>,
    /// From their hits, short.
    pub ao: Vec<Ray>,
}

impl Rays {
    /// The rays of a kind.
    pub fn of(&self, kind: Kind) -> &[Ray] {
        match kind {
            Kind::Primary => &self.primary,
            Kind::Bounce => &self.bounce,
            Kind::Ao => &self.ao,
        }
    }
}

/// The primary rays of `side`×`side` pixels, and the secondary rays from their hits.
pub fn generate(meshes: &[TriangleMesh], camera: &Camera, side: u32, hit: impl Fn(&Ray) -> Option<Hit>) -> Rays {
    let mut random = StdRng::seed_from_u64(0x0b5e_55ed);
    let size = scene_size(meshes);
    let mut rays = Rays { primary: primary(camera, side, &mut random), bounce: Vec::new(), ao: Vec::new() };
    let hits: Vec<(&Ray, Hit)> = rays.primary.iter().filter_map(|ray| Some((ray, hit(ray)?))).collect();
    let samples = (rays.primary.len() / (2 * hits.len()).max(1)).clamp(1, MOST_SAMPLES);
    for (ray, hit) in hits {
        let normal = facing_normal(meshes, ray, &hit);
        let origin = (ray.point(hit.t) + (normal * (OFFSET * size)).as_dvec3()).as_vec3();
        let secondary = |random: &mut StdRng| Ray::new(origin, cosine(normal, random)).at_time(ray.time);
        for _ in 0..samples {
            rays.bounce.push(secondary(&mut random));
            rays.ao.push(secondary(&mut random).between(0.0, OCCLUSION_REACH * size));
        }
    }
    rays
}

fn primary(camera: &Camera, side: u32, random: &mut StdRng) -> Vec<Ray> {
    let side = (side as usize).next_multiple_of(TILE);
    let tiles = side / TILE;
    let mut rays = Vec::with_capacity(side * side);
    for (ty, tx) in (0..tiles).flat_map(|ty| (0..tiles).map(move |tx| (ty, tx))) {
        for (y, x) in (0..TILE).flat_map(|y| (0..TILE).map(move |x| (ty * TILE + y, tx * TILE + x))) {
            let mut jittered = |at: usize| (at as f32 + random.random::<f32>()) / side as f32;
            let (px, py) = (jittered(x), jittered(y));
            let ray = camera.ray(px, py, 1.0, random.random());
            // Unit directions, so that distances read as lengths.
            rays.push(Ray { dir: ray.dir.normalize(), ..ray });
        }
    }
    rays
}

/// A cosine-distributed direction about `normal`: a point of the unit sphere on top of it.
fn cosine(normal: Vec3, random: &mut StdRng) -> Vec3 {
    loop {
        let p = Vec3::from_array(std::array::from_fn(|_| 2.0 * random.random::<f32>() - 1.0));
        let length = p.length_squared();
        if length > 1e-6 && length < 1.0 {
            let dir = normal + p.normalize();
            if dir.length_squared() > 1e-6 {
                return dir.normalize();
            }
        }
    }
}
