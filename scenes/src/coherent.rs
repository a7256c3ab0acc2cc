//! One rock in flight: a finely displaced sphere that moves as a rigid body.
//!
//! Everything moves, but coherently. For structures that follow the motion it is static;
//! in a tree with fixed planes every triangle sweeps across many cells.

use super::random::Random;
use super::shape::{Shape, animate};
use super::turn::{cos_sin, rotation};
use super::{Camera, Look, Scene, View};
use engine::TriangleMesh;
use glam::{IVec3, Mat3, Vec3};

/// The rock, with about this many triangles.
///
/// ```
/// let scene = mbkd_scenes::coherent(5_000);
/// assert!(scene.triangles().abs_diff(5_000) < 500);
/// ```
pub fn coherent(triangles: usize) -> Scene {
    let mesh = rock(triangles, 2, |time| {
        (Vec3::new(0.12, 0.05, 0.04) * time, rotation(Vec3::new(0.48, 0.8, 0.36), 0.005 * time))
    });
    scene("coherent", mesh)
}

/// The same rock, rotating by a quarter turn in place, with this many keys: nonlinear motion.
///
/// ```
/// assert_eq!(mbkd_scenes::turning(2_000, 17).meshes[0].keys.len(), 17);
/// ```
pub fn turning(triangles: usize, keys: usize) -> Scene {
    let mesh = rock(triangles, keys, |time| (Vec3::ZERO, rotation(Vec3::new(0.48, 0.8, 0.36), 0.25 * time)));
    scene("turning", mesh)
}

fn scene(name: &str, mesh: TriangleMesh) -> Scene {
    Scene {
        name: name.into(),
        meshes: vec![mesh],
        looks: vec![Look::plain(Vec3::new(0.50, 0.44, 0.38))],
        camera: Camera::fixed(View::new(Vec3::new(0.1, 0.5, 4.2), Vec3::new(0.1, 0.05, 0.0), 0.74)),
    }
}

/// The rock with about this many triangles, and its pose at a time: centre and rotation.
fn rock(triangles: usize, keys: usize, at: impl Fn(f32) -> (Vec3, Mat3)) -> TriangleMesh {
    // Twice as many around as from pole to pole: 2 * 2r * r triangles.
    let rings = ((triangles as f32 / 4.0).sqrt() as usize).max(3);
    let around = 2 * rings;
    let rock: Vec<Vec3> = (0..rings * around)
        .map(|i| {
            let (z, r) = cos_sin(0.5 * (i / around + 1) as f32 / (rings + 1) as f32);
            let (c, s) = cos_sin((i % around) as f32 / around as f32);
            displaced(Vec3::new(c * r, s * r, -z))
        })
        .collect();
    let (south, north) = (displaced(Vec3::NEG_Z), displaced(Vec3::Z));
    animate(keys, |time| {
        let (centre, turn) = at(time);
        let mut shape = Shape::default();
        let place = |p: Vec3| centre + turn * p;
        let point = |ring: usize, k: usize| place(rock[ring * around + k]);
        shape.tube(Some(place(south)), rings, around, point, Some(place(north)));
        shape
    })
}

/// Hills in five octaves and a few craters, so that triangles differ in size and direction.
fn displaced(p: Vec3) -> Vec3 {
    let mut height = 1.0;
    let (mut scale, mut share) = (1.7, 0.16);
    for _ in 0..5 {
        height += share * noise(p * scale);
        scale *= 2.1;
        share *= 0.48;
    }
    let mut random = Random(0xc4a7);
    for _ in 0..24 {
        let (centre, radius) = (random.direction(), random.between(0.08, 0.35));
        let d2 = (p - centre).length_squared() / (radius * radius);
        if d2 < 1.0 {
            // A bowl with a rim that fades to nothing at the edge.
            height += radius * (1.0 - d2) * (1.0 - d2) * (1.6 * d2 - 0.35);
        }
    }
    p * height
}

/// Value noise in [-1, 1]: random numbers at lattice points, smoothly blended.
fn noise(p: Vec3) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let smooth = f * f * (Vec3::splat(3.0) - f * 2.0);
    let cell = cell.as_ivec3();
    let mut sum = 0.0;
    for corner in 0..8 {
        let at = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
        let weight = |axis: usize| if at[axis] == 1 { smooth[axis] } else { 1.0 - smooth[axis] };
        sum += lattice(cell + at) * (weight(0) * weight(1) * weight(2));
    }
    sum
}

fn lattice(cell: IVec3) -> f32 {
    let place = |x: i32, shift: u32| (i64::from(x) as u64 & 0xfffff) << shift;
    Random(place(cell.x, 0) | place(cell.y, 20) | place(cell.z, 40)).between(-1.0, 1.0)
}
