//! Long needles in every direction, every second of them moving.
//!
//! One triangle each, a hundred times longer than wide: their boxes are almost empty, so that splitting
//! space pays, and their motion determines how much of it is affordable.

use super::random::Random;
use super::shape::{Shape, animate};
use super::turn::frame;
use super::{Camera, Look, Scene, View};
use glam::Vec3;

/// Exactly `triangles` needles (at least two) in a ball of diameter 2, every second one moving `motion`
/// times that diameter in its own direction.
///
/// ```
/// let scene = mbkd_scenes::needles(100, 0.05);
/// assert_eq!((scene.meshes[0].len(), scene.meshes[1].len()), (50, 50)); // still, moving
/// ```
pub fn needles(triangles: usize, motion: f32) -> Scene {
    let moving = (triangles / 2).max(1);
    let still = (triangles - triangles / 2).max(1);
    let width = (0.35 / (triangles as f32).sqrt()).min(0.02);
    let half = |seed: u64, count: usize, keys: usize| {
        animate(keys, |time| {
            let mut random = Random(seed);
            let mut shape = Shape::default();
            for _ in 0..count {
                needle(&mut shape, &mut random, width, 2.0 * motion * time);
            }
            shape
        })
    };
    Scene {
        name: if motion > 0.1 { "needles30" } else { "needles" }.into(),
        meshes: vec![half(0x5711, still, 1), half(0x60e5, moving, 2)],
        looks: vec![
            Look::varied(Vec3::new(0.20, 0.32, 0.24), Vec3::new(0.36, 0.52, 0.33), 1),
            Look::varied(Vec3::new(0.85, 0.55, 0.20), Vec3::new(0.80, 0.36, 0.16), 1),
        ],
        camera: Camera::fixed(View::new(Vec3::new(0.5, 0.8, 2.9), Vec3::ZERO, 0.74)),
    }
}

fn needle(shape: &mut Shape, random: &mut Random, width: f32, way: f32) {
    let centre = random.in_ball() * 0.8 + random.direction() * way;
    let along = random.direction();
    let length = random.between(0.15, 0.6);
    let (side, other) = frame(along);
    let side = (side * random.between(-1.0, 1.0) + other).normalize() * width;
    let tail = centre - along * (length * 0.5);
    shape.triangle([tail - side, tail + side, centre + along * (length * 0.5)]);
}
