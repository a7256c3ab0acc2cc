//! A furnished building of very uneven triangles, empty or with a figure running through it.
//!
//! Floors and walls are triangles as long as the building; stair rails, chair legs and lamps are of triangles a
//! thousandth of that, and furniture crowds in some rooms. Few triangles have most of the area of all boxes.

use super::runner::{Part, runner};
use super::shape::{Shape, animate};
use super::turn::{cos_sin, rotation};
use super::{Camera, Look, Scene, View};
use glam::{Mat3, Vec3};

/// Half the length and the width, and the height of a storey.
const HALF: Vec3 = Vec3::new(12.0, 0.0, 7.0);
const STOREY: f32 = 3.2;
const STOREYS: usize = 2;
const WALL: f32 = 0.15;
/// Chairs, in two crowded rooms on each storey.
const CHAIRS: usize = 48;
const RAILS: usize = 26;
/// Triangles of walls, slabs, windows and steps, whatever the budget.
const FIXED: usize = 3000;
/// Round objects: the legs of chairs, rails, and lamps, which count as eight.
const ROUND: usize = 4 * CHAIRS + RAILS + 8 * LAMPS;
const LAMPS: usize = 12;

/// The empty static building, with about this many triangles.
///
/// ```
/// let scene = mbkd_scenes::building(20_000);
/// assert!(scene.meshes.iter().all(|mesh| mesh.keys.len() == 1));
/// ```
pub fn building(triangles: usize) -> Scene {
    // A tube of n points around and n / 2 rings has about n^2 triangles.
    let around = ((triangles.saturating_sub(FIXED) as f32 / ROUND as f32).sqrt() as usize).max(4);
    Scene {
        name: "building".into(),
        meshes: [walls(), furniture(around)].map(Shape::fixed).into(),
        looks: [Vec3::new(0.72, 0.68, 0.60), Vec3::new(0.36, 0.22, 0.13)].map(Look::plain).into(),
        camera: Camera::fixed(View::new(Vec3::new(-10.5, 1.7, 2.2), Vec3::new(2.0, 1.0, -1.0), 0.95)),
    }
}

/// The building with a figure of half the triangles running through it.
///
/// ```
/// let scene = mbkd_scenes::visited(20_000);
/// assert_eq!(scene.meshes.iter().filter(|mesh| mesh.keys.len() == 2).count(), 2);
/// ```
pub fn visited(triangles: usize) -> Scene {
    let mut scene = building(triangles / 2);
    scene.name = "visited".into();
    add_runner(&mut scene, triangles / 2, Vec3::new(-6.0, 0.0, 1.2), 0.25);
    scene
}

/// A small running figure far away, which most rays miss.
///
/// ```
/// let scene = mbkd_scenes::distant(20_000);
/// assert_eq!(scene.meshes.len(), 2);
/// ```
pub fn distant(triangles: usize) -> Scene {
    let camera = Camera::fixed(View::new(Vec3::new(6.0, 2.0, -14.0), Vec3::new(0.0, 1.0, 0.0), 0.6));
    let mut scene = Scene { name: "distant".into(), meshes: Vec::new(), looks: Vec::new(), camera };
    add_runner(&mut scene, triangles, Vec3::ZERO, 0.0);
    scene
}

/// Runners in rows, each of some eight thousand triangles and at its own moment of the stride.
///
/// ```
/// let scene = mbkd_scenes::crowd(40_000);
/// assert!(scene.meshes.iter().all(|mesh| mesh.keys.len() == 2));
/// ```
pub fn crowd(triangles: usize) -> Scene {
    const EACH: usize = 8000;
    let count = triangles.div_ceil(EACH).max(1);
    let row = (count as f32).sqrt().ceil() as usize;
    let camera = Camera::fixed(View::new(Vec3::new(0.5, 4.0, -6.0), Vec3::new(0.5 * row as f32, 0.0, 12.0), 0.8));
    let mut scene = Scene { name: "crowd".into(), meshes: Vec::new(), looks: Vec::new(), camera };
    for i in 0..count {
        let (x, z) = (i % row, i / row);
        let place = Vec3::new(1.1 * x as f32, 0.0, 1.6 * z as f32);
        add_runner(&mut scene, triangles / count, place, (i * 7 % 32) as f32 / 32.0);
    }
    scene
}

fn add_runner(scene: &mut Scene, triangles: usize, at: Vec3, phase: f32) {
    // 20 limbs of 2 n^2 triangles.
    let around = ((triangles as f32 / 40.0).sqrt() as usize).max(4);
    for part in [Part::Skin, Part::Clothes] {
        scene.meshes.push(animate(2, |time| {
            let mut shape = runner(part, phase + 0.04 * time, around);
            shape.place(rotation(Vec3::Y, 0.2), at + Vec3::new(0.1, 0.0, 0.04) * time);
            shape
        }));
    }
    scene.looks.push(Look::plain(Vec3::new(0.52, 0.30, 0.20)));
    scene.looks.push(Look::plain(Vec3::new(0.08, 0.14, 0.42)));
}

/// Slabs, outer walls with windows, inner walls with doors, steps, and a roof.
fn walls() -> Shape {
    let mut shape = Shape::default();
    shape.block(Vec3::new(-40.0, -0.6, -30.0), Vec3::new(40.0, -0.3, 30.0));
    for storey in 0..=STOREYS {
        let y = storey as f32 * STOREY;
        // A slab leaves a hole for the stairs, except the lowest and the highest.
        let closed = storey == 0 || storey == STOREYS;
        let (left, right) = if closed { (0.0, 0.0) } else { (3.0, 7.0) };
        let mut slab = |x0: f32, z0: f32, x1: f32, z1: f32| {
            shape.block(Vec3::new(x0, y - 0.3, z0), Vec3::new(x1, y, z1));
        };
        slab(-HALF.x, -HALF.z, left, HALF.z);
        slab(right, -HALF.z, HALF.x, HALF.z);
        slab(left, -2.0, right, HALF.z);
    }
    for storey in 0..STOREYS {
        let y = storey as f32 * STOREY;
        for side in [-1.0, 1.0] {
            wall(&mut shape, Vec3::new(-HALF.x, y, side * HALF.z), Vec3::X, 2.0 * HALF.x, 8, 0.9);
            wall(&mut shape, Vec3::new(side * HALF.x, y, -HALF.z), Vec3::Z, 2.0 * HALF.z, 5, 0.9);
        }
        wall(&mut shape, Vec3::new(-HALF.x, y, -1.0), Vec3::X, 2.0 * HALF.x, 4, 0.0);
        wall(&mut shape, Vec3::new(-2.0, y, -HALF.z), Vec3::Z, 2.0 * HALF.z, 2, 0.0);
        wall(&mut shape, Vec3::new(8.0, y, -HALF.z), Vec3::Z, 2.0 * HALF.z, 2, 0.0);
    }
    for step in 0..16 {
        let low = Vec3::new(3.2 + 0.22 * step as f32, STOREY / 16.0 * step as f32, -4.0);
        shape.block(low, low + Vec3::new(0.25, STOREY / 16.0, 1.6));
    }
    let ridge = Vec3::new(0.0, STOREYS as f32 * STOREY + 2.5, 0.0);
    for side in [-1.0, 1.0] {
        let eave = Vec3::new(0.0, ridge.y - 2.5, side * (HALF.z + 0.5));
        let corner = |p: Vec3, x: f32| p + Vec3::X * (x * (HALF.x + 0.5));
        shape.triangle([corner(eave, -side), corner(eave, side), corner(ridge, side)]);
        shape.triangle([corner(eave, -side), corner(ridge, side), corner(ridge, -side)]);
    }
    shape
}

/// A wall with evenly spaced openings, from this height above the floor on, each with a frame.
fn wall(shape: &mut Shape, at: Vec3, along: Vec3, length: f32, openings: usize, sill: f32) {
    let across = Vec3::new(along.z, 0.0, along.x) * WALL;
    let mut part = |from: f32, to: f32, low: f32, high: f32, thick: f32| {
        let (a, b) = (at + along * from + Vec3::Y * low, at + along * to + Vec3::Y * high);
        shape.block(a - across * thick, b + across * thick);
    };
    let (pitch, top, head) = (length / openings as f32, STOREY - 0.3, 2.2);
    let half = 0.5f32.min(0.3 * pitch);
    part(0.0, length, head, top, 1.0);
    if sill > 0.0 {
        part(0.0, length, 0.0, sill, 1.0);
    }
    let mut begin = 0.0;
    for i in 0..openings {
        let middle = (i as f32 + 0.5) * pitch;
        part(begin, middle - half, sill, head, 1.0);
        begin = middle + half;
        for edge in [middle - half, middle + half] {
            part(edge - 0.03, edge + 0.03, sill, head, 1.2);
        }
        if sill > 0.0 {
            part(middle - half, middle + half, sill, sill + 0.04, 1.4);
            part(middle - 0.02, middle + 0.02, sill, head, 0.2);
            part(middle - half, middle + half, 1.5, 1.54, 0.2);
        }
    }
    part(begin, length, sill, head, 1.0);
}

/// Chairs and tables, lamps, and the rail of the stairs.
fn furniture(around: usize) -> Shape {
    let mut shape = Shape::default();
    for i in 0..CHAIRS {
        // Each room has a block of four rows.
        let (room, place) = (i / 12, i % 12);
        let y = (room / 2) as f32 * STOREY;
        let corner = [Vec3::new(-9.0, y, -5.5), Vec3::new(-8.0, y, 1.0)][room % 2];
        chair(&mut shape, corner + Vec3::new((place % 4) as f32 * 0.9, 0.0, (place / 4) as f32 * 1.1), i, around);
    }
    for i in 0..LAMPS {
        let y = (i / 6 + 1) as f32 * STOREY - 0.9;
        let centre = Vec3::new((i % 3) as f32 * 5.0 - 8.0, y, if i / 3 % 2 == 0 { -4.0 } else { 2.5 });
        let n = 3 * around;
        let point = |ring: usize, k: usize| {
            let ((c, s), (x, z)) = (cos_sin((ring + 1) as f32 / n as f32 - 0.25), cos_sin(k as f32 / n as f32));
            centre + Vec3::new(c * x, s, c * z) * 0.22
        };
        shape.tube(Some(centre - Vec3::Y * 0.22), n / 2 - 1, n, point, Some(centre + Vec3::Y * 0.22));
        rod(&mut shape, centre + Vec3::Y * 0.2, centre + Vec3::Y * 0.6, 0.01, 4, 2);
    }
    for i in 0..RAILS {
        let foot = Vec3::new(3.3 + 0.14 * i as f32, STOREY / 16.0 * (0.14 * i as f32 / 0.22 + 1.0), -2.45);
        rod(&mut shape, foot, foot + Vec3::Y * 0.9, 0.015, around, around / 2);
    }
    let rail = Vec3::new(3.2, 1.1, -2.45);
    rod(&mut shape, rail, rail + Vec3::new(3.6, STOREY, 0.0), 0.03, around, 2);
    shape
}

/// A seat, a back of thin laths, and four round legs, turned a little.
fn chair(shape: &mut Shape, at: Vec3, number: usize, around: usize) {
    let turn = rotation(Vec3::Y, 0.02 * (number % 7) as f32);
    let place = |p: Vec3| at + turn * p;
    let mut board = |centre: Vec3, half: Vec3| shape.cuboid(place(centre), turn * Mat3::from_diagonal(half));
    board(Vec3::new(0.0, 0.45, 0.0), Vec3::new(0.22, 0.02, 0.21));
    for lath in 0..5 {
        board(Vec3::new(-0.16 + 0.08 * lath as f32, 0.7, -0.2), Vec3::new(0.015, 0.24, 0.008));
    }
    board(Vec3::new(0.0, 0.95, -0.2), Vec3::new(0.2, 0.03, 0.012));
    for leg in 0..4 {
        let foot = Vec3::new(if leg % 2 == 0 { 0.19 } else { -0.19 }, 0.0, if leg / 2 == 0 { 0.18 } else { -0.18 });
        rod(shape, place(foot * 1.1), place(foot + Vec3::Y * 0.44), 0.018, around, around / 2);
    }
}

/// A closed rod, thicker in its middle.
fn rod(shape: &mut Shape, from: Vec3, to: Vec3, radius: f32, around: usize, rings: usize) {
    let axis = (to - from).normalize_or(Vec3::Y);
    let side = axis.any_orthonormal_vector();
    let (rings, up) = (rings.max(2), axis.cross(side));
    let point = |ring: usize, k: usize| {
        let s = ring as f32 / (rings - 1) as f32;
        let (c, sin) = cos_sin(k as f32 / around as f32);
        from + (to - from) * s + (side * c + up * sin) * (radius * (1.0 + s * (1.0 - s)))
    };
    shape.tube(Some(from), rings, around, point, Some(to));
}
