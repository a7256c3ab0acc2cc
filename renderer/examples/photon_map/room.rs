//! The room: a lamp, a glass sphere in flight, and a coloured ball that passes a wall.

use mbkd::glam::{DVec3, Mat3, Vec3};
use mbkd::{BuildError, BuildParams, MovingSphere, Ray, RayTree, TriangleMesh};
use mbkd_scenes::{Camera, View};
use std::f32::consts::PI;

/// How a surface scatters light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surface {
    /// Reflects diffusely.
    Matte(Vec3),
    /// Refracts and reflects.
    Glass,
    /// The lamp.
    Lamp,
}

/// A point on a surface.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Where it is.
    pub position: Vec3,
    /// Unit normal; of spheres it points outward, of walls to the side of the ray's origin.
    pub normal: Vec3,
    /// The surface.
    pub surface: Surface,
    /// The index of the body it belongs to.
    pub body: u32,
}

/// Half the width of the square lamp.
const LAMP: f32 = 0.16;
/// The position of its centre.
const LAMP_AT: Vec3 = Vec3::new(0.15, 2.995, -0.1);
/// Radiance of the lamp.
pub const EMITTED: Vec3 = Vec3::new(150.0, 138.0, 118.0);
/// Radius of the glass sphere.
const GLASS: f64 = 0.46;
/// The distance of ray origins from the surfaces they leave.
const LIFT: f32 = 2e-4;
/// Refractive index of the glass.
const INDEX: f32 = 1.5;

/// The scene: walls, boxes and spheres.
pub struct Room {
    tree: RayTree,
    colors: Vec<Vec3>,
    spheres: Vec<MovingSphere>,
    ball: Vec3,
    /// The camera.
    pub camera: Camera,
}

/// A rectangle as two triangles.
fn rectangle(corner: Vec3, a: Vec3, b: Vec3) -> TriangleMesh {
    TriangleMesh::fixed(vec![[0, 1, 2], [0, 2, 3]], vec![corner, corner + a, corner + a + b, corner + b])
}

/// A box that stands on the floor, rotated about the vertical.
fn block(center: Vec3, half: Vec3, cos: f32, sin: f32) -> TriangleMesh {
    let turn = Mat3::from_cols(Vec3::new(cos, 0.0, -sin), Vec3::Y, Vec3::new(sin, 0.0, cos));
    let corner = |i: u32| {
        let sign = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        center + turn * (half * Vec3::new(sign(0), sign(1), sign(2)))
    };
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let indices = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriangleMesh::fixed(indices, (0..8).map(corner).collect::<Vec<_>>())
}

impl Room {
    /// Builds it. The camera follows the glass sphere by the share `along` of its path.
    pub fn new(along: f32) -> Result<Room, BuildError> {
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        let (low, deep) = (Vec3::new(-2.0, 0.0, -2.0), 7.0);
        let white = Vec3::splat(0.74);
        let walls = [
            (rectangle(low, x * 4.0, z * deep), Vec3::new(0.66, 0.64, 0.6)),
            (rectangle(low + y * 3.0, x * 4.0, z * deep), white),
            (rectangle(low, x * 4.0, y * 3.0), white),
            (rectangle(low + z * deep, x * 4.0, y * 3.0), white * 0.6),
            (rectangle(low, z * deep, y * 3.0), white),
            (rectangle(low + x * 4.0, z * deep, y * 3.0), Vec3::new(0.30, 0.42, 0.62)),
            (block(Vec3::new(1.12, 0.55, -1.0), Vec3::new(0.42, 0.55, 0.42), 0.94, 0.342), Vec3::new(0.72, 0.68, 0.52)),
        ];
        let (meshes, colors): (Vec<_>, Vec<_>) = walls.into_iter().unzip();
        let sphere = |from: [f64; 3], to: [f64; 3], radius| {
            MovingSphere::new(vec![(DVec3::from_array(from), radius), (DVec3::from_array(to), radius)])
        };
        let spheres = vec![
            sphere([-0.75, 0.95, 0.75], [0.75, 0.95, 0.95], GLASS),
            sphere([-1.33, 0.55, -0.9], [-1.33, 1.45, -0.35], 0.5),
        ];
        // At mid-shutter the camera has the same position for every `along`.
        let flight = Vec3::new(1.5, 0.0, 0.2);
        let middle = View::new(Vec3::new(0.0, 1.7, 4.7), Vec3::new(0.0, 0.85, 0.1), 0.74);
        let view = |share: f32| {
            let way = flight * (share * along);
            View { position: middle.position + way, target: middle.target + way, ..middle }
        };
        Ok(Room {
            tree: RayTree::of_scene(&meshes, spheres.clone(), &BuildParams::default())?,
            colors,
            spheres,
            ball: Vec3::new(0.85, 0.13, 0.06),
            camera: Camera { keys: vec![view(-0.5), view(0.5)] },
        })
    }

    /// The nearest surface along a ray.
    pub fn closest(&self, ray: &Ray) -> Option<Spot> {
        let hit = self.tree.closest_hit(ray)?;
        if hit.mesh as usize == self.tree.mesh_count() {
            let (center, _) = self.spheres[hit.primitive as usize].at(ray.time);
            let at = ray.point(hit.t);
            let surface = if hit.primitive == 0 { Surface::Glass } else { Surface::Matte(self.ball) };
            let normal = (at - center).normalize().as_vec3();
            return Some(Spot { position: at.as_vec3(), normal, surface, body: u32::MAX - hit.primitive });
        }
        let normal = self.tree.triangle_normal(&hit, ray.time);
        let normal = if normal.dot(ray.dir) > 0.0 { -normal } else { normal };
        let position = ray.point(hit.t).as_vec3();
        let body = hit.mesh;
        let from_lamp = position - LAMP_AT;
        if hit.mesh == 1 && from_lamp.x.abs() <= LAMP && from_lamp.z.abs() <= LAMP {
            return Some(Spot { position, normal, surface: Surface::Lamp, body });
        }
        let color = if hit.mesh == 0 { self.tiles(position) } else { self.colors[hit.mesh as usize] };
        Some(Spot { position, normal, surface: Surface::Matte(color), body })
    }

    /// The colour of the floor's tiles, with joints between them.
    fn tiles(&self, at: Vec3) -> Vec3 {
        let place = |x: f32| (x / 0.5).rem_euclid(1.0);
        let joint = place(at.x) < 0.03 || place(at.z) < 0.03;
        if joint { self.colors[0] * 0.55 } else { self.colors[0] }
    }

    /// Whether two points are mutually visible.
    fn free(&self, from: Vec3, to: Vec3, time: f32) -> bool {
        let ray = Ray::new(from, to - from).at_time(time).between(0.0, 1.0 - 1e-4);
        !self.tree.any_hit(&ray)
    }

    /// Light directly from the lamp, reflected by a matte surface. Glass casts a shadow: light through it is carried by
    /// photons.
    pub fn direct(&self, spot: &Spot, color: Vec3, time: f32, at: mbkd::glam::Vec2) -> Vec3 {
        let lamp = lamp_point(at);
        let way = lamp - spot.position;
        let squared = way.length_squared();
        let cosines = way.dot(spot.normal).max(0.0) * way.y.max(0.0) / squared;
        if cosines <= 0.0 || !self.free(lifted(spot.position, spot.normal), lamp - Vec3::Y * 1e-3, time) {
            return Vec3::ZERO;
        }
        color / PI * EMITTED * (cosines / squared * lamp_area())
    }

    /// Centre and radius of the glass sphere.
    pub fn glass(&self, time: f32) -> (Vec3, f32) {
        let (center, radius) = self.spheres[0].at(time);
        (center.as_vec3(), radius as f32)
    }
}

/// The area of the lamp.
pub fn lamp_area() -> f32 {
    4.0 * LAMP * LAMP
}

/// A point of the lamp from a point of the unit square.
pub fn lamp_point(at: mbkd::glam::Vec2) -> Vec3 {
    LAMP_AT + Vec3::new(2.0 * at.x - 1.0, 0.0, 2.0 * at.y - 1.0) * LAMP
}

/// A point a little off a surface, on the side of `towards`.
pub fn lifted(position: Vec3, towards: Vec3) -> Vec3 {
    position + towards * LIFT
}

/// The direction of light behind glass: reflected or refracted, chosen by a random number in [0, 1). Fresnel's
/// equations.
pub fn through_glass(dir: Vec3, outward: Vec3, random: f32) -> Vec3 {
    let entering = dir.dot(outward) < 0.0;
    let (normal, ratio) = if entering { (outward, 1.0 / INDEX) } else { (-outward, INDEX) };
    let cosine = -dir.dot(normal);
    let sine2 = ratio * ratio * (1.0 - cosine * cosine);
    let mirrored = dir + normal * (2.0 * cosine);
    if sine2 >= 1.0 {
        return mirrored;
    }
    let inner = (1.0 - sine2).sqrt();
    let across = (ratio * cosine - inner) / (ratio * cosine + inner);
    let along = (cosine - ratio * inner) / (cosine + ratio * inner);
    let reflected = 0.5 * (across * across + along * along);
    if random < reflected { mirrored } else { (dir * ratio + normal * (ratio * cosine - inner)).normalize() }
}
