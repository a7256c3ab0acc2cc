//! An explosion: stones of 64 triangles flying outward about 30 % of the scene while they spin.
//!
//! Inside one stone motion is coherent, between stones it is not, and every stone crosses many cells.

use super::random::Random;
use super::shape::{Shape, animate};
use super::turn::{cos_sin, rotation};
use super::{Camera, Look, Scene, View};
use glam::Vec3;

/// Eight around, four rings, a tip at either end.
const AROUND: usize = 8;
const RINGS: usize = 4;
const PER_STONE: usize = AROUND * 2 * RINGS;
/// Two keys: corners move linearly, as in the paper, and a spinning stone shrinks a little at mid-shutter.
const KEYS: usize = 2;

/// Debris with about this many triangles; 3000 stones are 192 000.
///
/// ```
/// let scene = mbkd_scenes::debris(640);
/// assert_eq!(scene.triangles(), 640);
/// ```
pub fn debris(triangles: usize) -> Scene {
    let stones = (triangles / PER_STONE).max(1);
    // In f64, since f32 roots of the platform differ from machine to machine.
    let size = (2.4 / (stones as f64).cbrt() as f32).min(0.6);
    let mesh = animate(KEYS, |time| {
        let mut random = Random(0xdeb1);
        let mut shape = Shape::default();
        for _ in 0..stones {
            stone(&mut shape, &mut random, size, time);
        }
        shape
    });
    Scene {
        name: "debris".into(),
        meshes: vec![mesh],
        looks: vec![Look::varied(Vec3::new(0.30, 0.27, 0.25), Vec3::new(0.68, 0.42, 0.26), PER_STONE as u32)],
        camera: Camera::fixed(View::new(Vec3::new(1.2, 0.8, 6.0), Vec3::ZERO, 0.66)),
    }
}

fn stone(shape: &mut Shape, random: &mut Random, size: f32, time: f32) {
    let out = random.direction();
    // Farther out, faster: all began near the middle.
    let reach = random.between(0.25, 1.0);
    let centre = (out * 1.6 + random.in_ball() * 0.3) * reach + (out * reach + random.in_ball() * 0.2) * (0.9 * time);
    let turn = rotation(random.direction(), random.between(0.0, 1.0) + random.between(0.02, 0.12) * time);
    let radius = size * random.between(0.1, 0.35);
    let stretch = Vec3::new(random.between(0.6, 1.3), random.between(0.6, 1.3), random.between(0.6, 1.3));
    let bumps: [f32; AROUND * RINGS] = std::array::from_fn(|_| random.between(0.75, 1.15));
    let place = |p: Vec3| centre + turn * (p * stretch) * radius;
    let point = |ring: usize, k: usize| {
        let (z, r) = cos_sin(0.5 * (ring + 1) as f32 / (RINGS + 1) as f32);
        let (c, s) = cos_sin(k as f32 / AROUND as f32);
        // From the south tip to the north tip.
        place(Vec3::new(c * r, s * r, -z) * bumps[ring * AROUND + k])
    };
    shape.tube(Some(place(Vec3::NEG_Z)), RINGS, AROUND, point, Some(place(Vec3::Z)));
}
