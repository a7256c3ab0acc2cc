//! A colonnade of very uneven triangles, with or without a figure running through it.
//!
//! Slabs and beams of two triangles a side stand beside fluted shafts of slivers five units long and capitals
//! whose ornament is a thousandth of that. All of it is static; the figure is a sixth of the triangles.

use super::runner::{Part, runner};
use super::shape::{Shape, animate};
use super::turn::cos_sin;
use super::{Camera, Look, Scene, View};
use engine::TriangleMesh;
use glam::{Mat3, Vec3};

/// Columns on each side.
const COLUMNS: usize = 7;
const SPACING: f32 = 2.6;
/// Distance of a row of columns from the middle.
const AISLE: f32 = 2.7;
const STONE: Vec3 = Vec3::new(0.74, 0.66, 0.53);

/// The hall with its runner, with about this many triangles, a sixth of which move.
///
/// ```
/// let scene = mbkd_scenes::hall(20_000);
/// assert!(scene.meshes.iter().any(|mesh| mesh.keys.len() == 2));
/// ```
pub fn hall(triangles: usize) -> Scene {
    walking(triangles, 2)
}

/// The hall with its runner at this many keys: nonlinear motion next to static geometry.
///
/// ```
/// let scene = mbkd_scenes::walking(20_000, 17);
/// assert!(scene.meshes.iter().any(|mesh| mesh.keys.len() == 17));
/// ```
pub fn walking(triangles: usize, keys: usize) -> Scene {
    walking_from(triangles, keys, 0.0)
}

/// The same after the figure has been running for a number of shutters: the frames of an animation.
///
/// ```
/// let frame = |i: usize| mbkd_scenes::walking_from(20_000, 2, 0.5 * i as f32);
/// let (first, second) = (frame(0), frame(1));
/// let moved = first.meshes.iter().zip(&second.meshes).filter(|(a, b)| a.keys != b.keys);
/// assert_eq!(moved.count(), 2);
/// ```
pub fn walking_from(triangles: usize, keys: usize, begin: f32) -> Scene {
    let mut scene = still(triangles - triangles / 6);
    // 20 limbs of 2 n^2 triangles.
    let around = ((triangles as f32 / 240.0).sqrt() as usize).max(4);
    for part in [Part::Skin, Part::Clothes] {
        scene.meshes.push(animate(keys, |time| running(part, begin + time, around)));
    }
    scene.looks.push(Look::plain(Vec3::new(0.52, 0.30, 0.20)));
    scene.looks.push(Look::plain(Vec3::new(0.62, 0.07, 0.05)));
    scene
}

/// The hall without the runner, seen by a camera that moves along it.
///
/// ```
/// let scene = mbkd_scenes::camera(20_000);
/// assert!(scene.camera.keys.len() > 1 && scene.meshes.iter().all(|mesh| mesh.keys.len() == 1));
/// ```
pub fn camera(triangles: usize) -> Scene {
    let mut scene = still(triangles);
    scene.name = "camera".into();
    let view = |z: f32, turn: f32| View::new(Vec3::new(-0.9, 1.7, z), Vec3::new(turn, 2.1, z - 6.0), 0.95);
    scene.camera = Camera { keys: vec![view(7.4, 0.1), view(7.25, 0.14), view(7.1, 0.18)] };
    scene
}

fn running(part: Part, time: f32, around: usize) -> Shape {
    let mut shape = runner(part, 0.17 + 0.04 * time, around);
    let (c, s) = cos_sin(0.07);
    let turn = Mat3::from_cols(Vec3::new(c, 0.0, -s), Vec3::Y, Vec3::new(s, 0.0, c));
    shape.place(turn, Vec3::new(0.25, 0.0, 2.1) + turn * Vec3::Z * (0.12 * time));
    shape
}

fn still(triangles: usize) -> Scene {
    // A column of n points around and 27 rings is 54 n triangles; slabs and beams are 7400.
    let around = (triangles.saturating_sub(7400) / (2 * COLUMNS * 54) / 8 * 8).max(8);
    let (light, dark) = floor();
    let meshes: Vec<TriangleMesh> = [columns(around), beams(), light, dark, ground()].map(Shape::fixed).into();
    Scene {
        name: "hall".into(),
        meshes,
        looks: [
            STONE,
            STONE * 0.95,
            Vec3::new(0.62, 0.55, 0.45),
            Vec3::new(0.30, 0.20, 0.16),
            Vec3::new(0.42, 0.36, 0.25),
        ]
        .map(Look::plain)
        .into(),
        camera: Camera::fixed(View::new(Vec3::new(-1.55, 1.05, 6.0), Vec3::new(0.3, 1.55, 0.0), 0.88)),
    }
}

/// The positions of the columns.
fn places() -> impl Iterator<Item = Vec3> {
    (0..2 * COLUMNS).map(|i| {
        let side = if i % 2 == 0 { -1.0 } else { 1.0 };
        Vec3::new(side * AISLE, 0.0, ((i / 2) as f32 - 0.5 * (COLUMNS - 1) as f32) * SPACING)
    })
}

/// Base, fluted shaft and capital: one tube each, of `around` points.
fn columns(around: usize) -> Shape {
    let mut shape = Shape::default();
    for place in places() {
        column(&mut shape, place, around);
    }
    shape
}

fn column(shape: &mut Shape, place: Vec3, around: usize) {
    // Height and radius of each ring, and how deep the flutes or the ornament are.
    let base = [
        (0.16, 0.47, 0.0),
        (0.18, 0.50, 0.0),
        (0.23, 0.515, 0.0),
        (0.28, 0.49, 0.0),
        (0.30, 0.44, 0.0),
        (0.35, 0.415, 0.0),
        (0.40, 0.44, 0.0),
        (0.44, 0.435, 0.0),
        (0.46, 0.40, 0.0),
    ];
    let shaft = [(0.47, 0.385, 0.0), (0.55, 0.385, 0.025), (2.4, 0.37, 0.025), (5.0, 0.315, 0.022), (5.05, 0.315, 0.0)];
    let neck = [(5.07, 0.345, 0.0), (5.11, 0.35, 0.0), (5.13, 0.33, 0.0)];
    let rings: Vec<(f32, f32, f32)> = base
        .into_iter()
        .chain(shaft)
        .chain(neck)
        .chain((0..10).map(|i| {
            let s = i as f32 / 9.0;
            (5.15 + 0.42 * s, 0.33 + 0.2 * s * s, 0.05 * (1.0 - cos_sin(2.0 * s).0) * 0.5)
        }))
        .collect();
    let point = |ring: usize, k: usize| {
        let (height, radius, depth) = rings[ring];
        let (c, s) = cos_sin(k as f32 / around as f32);
        // 20 flutes on the shaft; 10 leaves on the capital, turned half a leaf from row to row.
        let wave = if height < 5.1 {
            cos_sin(20.0 * k as f32 / around as f32).0
        } else {
            cos_sin(10.0 * k as f32 / around as f32 + if ring % 6 < 3 { 0.0 } else { 0.5 }).0
        };
        let r = radius - depth * (0.5 - 0.5 * wave);
        place + Vec3::new(s * r, height, c * r)
    };
    shape.tube(Some(place + Vec3::Y * 0.16), rings.len(), around, point, Some(place + Vec3::Y * 5.57));
    let block = |shape: &mut Shape, low: f32, high: f32, half: f32| {
        shape.block(place + Vec3::new(-half, low, -half), place + Vec3::new(half, high, half));
    };
    block(shape, 0.0, 0.16, 0.55);
    block(shape, 5.57, 5.72, 0.56);
}

/// Beams on the columns with a row of teeth, and thin rafters across.
fn beams() -> Shape {
    let mut shape = Shape::default();
    let end = 0.5 * (COLUMNS - 1) as f32 * SPACING + 0.62;
    for side in [-1.0, 1.0] {
        let beam = |shape: &mut Shape, low: f32, high: f32, half: f32| {
            let (a, b) = (side * AISLE - half, side * AISLE + half);
            shape.block(Vec3::new(a, low, -end - half + 0.4), Vec3::new(b, high, end + half - 0.4));
        };
        beam(&mut shape, 5.72, 6.15, 0.42);
        beam(&mut shape, 6.15, 6.42, 0.38);
        beam(&mut shape, 6.52, 6.75, 0.58);
        let teeth = 100;
        for i in 0..teeth {
            let z = -end + 2.0 * end * (i as f32 + 0.5) / teeth as f32;
            for face in [-0.44, 0.44] {
                let middle = Vec3::new(side * AISLE + face, 6.47, z);
                shape.block(middle - Vec3::new(0.07, 0.05, 0.045), middle + Vec3::new(0.07, 0.05, 0.045));
            }
        }
    }
    for i in 0..2 * COLUMNS {
        let z = -end + 2.0 * end * (i as f32 + 0.5) / (2 * COLUMNS) as f32;
        shape.block(Vec3::new(-AISLE - 0.9, 6.75, z - 0.09), Vec3::new(AISLE + 0.9, 7.0, z + 0.09));
    }
    shape
}

/// Square slabs with narrow joints, light and dark, on three steps.
fn floor() -> (Shape, Shape) {
    let (mut light, mut dark) = (Shape::default(), Shape::default());
    let (half_x, half_z) = (AISLE + 0.9, 0.5 * (COLUMNS - 1) as f32 * SPACING + 1.2);
    for step in 1..=3 {
        let (out, top) = (0.35 * step as f32, -0.02 - 0.16 * (step - 1) as f32);
        shape_step(&mut light, half_x + out, half_z + out, top);
    }
    let (across, along) = (8, 20);
    let size = Vec3::new(2.0 * half_x / across as f32, 0.0, 2.0 * half_z / along as f32);
    for i in 0..across * along {
        let (x, z) = (i % across, i / across);
        let low = Vec3::new(-half_x, -0.06, -half_z) + Vec3::new(x as f32 * size.x, 0.0, z as f32 * size.z);
        let joint = Vec3::new(0.008, 0.0, 0.008);
        let slab = if (x + z) % 2 == 0 { &mut light } else { &mut dark };
        slab.block(low + joint, low + Vec3::new(size.x, 0.06, size.z) - joint);
    }
    (light, dark)
}

fn shape_step(shape: &mut Shape, half_x: f32, half_z: f32, top: f32) {
    shape.block(Vec3::new(-half_x, top - 0.16, -half_z), Vec3::new(half_x, top, half_z));
}

/// Two triangles for everything around.
fn ground() -> Shape {
    let mut shape = Shape::default();
    let corner = |x: f32, z: f32| Vec3::new(60.0 * x, -0.5, 60.0 * z);
    shape.triangle([corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0)]);
    shape.triangle([corner(-1.0, -1.0), corner(1.0, 1.0), corner(1.0, -1.0)]);
    shape
}
