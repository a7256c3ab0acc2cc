//! Hair on a small ball, each strand moving its own way by 2 to 5 % of the ball's diameter.
//!
//! The hardest kind of scene for any hierarchy: long, thin, curved, everywhere overlapping, and with
//! neighbours that part. All vertices of a strand move identically, so only the strands are incoherent.

use super::random::Random;
use super::shape::{Shape, animate};
use super::turn::frame;
use super::{Camera, Look, Scene, View};
use glam::Vec3;

const SEGMENTS: usize = 24;
/// Three-sided tubes with a tip at the end.
const PER_STRAND: usize = SEGMENTS * 6 - 3;

/// The hairball, with about this many triangles; 2.5 million are 17 730 strands.
///
/// ```
/// let scene = mbkd_scenes::hairball(14_100);
/// assert_eq!(scene.triangles(), 14_100);
/// ```
pub fn hairball(triangles: usize) -> Scene {
    let strands = (triangles / PER_STRAND).max(1);
    // Thinner hair where there is more of it, so that every size looks about equally full.
    let radius = (0.35 / (strands as f32).sqrt()).min(0.012);
    let mesh = animate(2, |time| {
        let mut random = Random(0x4a17);
        let mut shape = Shape::default();
        for _ in 0..strands {
            strand(&mut shape, &mut random, radius, time);
        }
        shape
    });
    Scene {
        name: "hairball".into(),
        meshes: vec![mesh],
        looks: vec![Look::varied(Vec3::new(0.62, 0.34, 0.13), Vec3::new(0.85, 0.67, 0.38), PER_STRAND as u32)],
        camera: Camera::fixed(View::new(Vec3::new(0.0, 0.55, 3.4), Vec3::new(0.0, -0.06, 0.0), 0.8)),
    }
}

/// A tube along a curve that leaves the ball at right angles and wanders.
fn strand(shape: &mut Shape, random: &mut Random, radius: f32, time: f32) {
    let root = random.direction();
    let length = random.between(0.65, 0.85);
    let bend = random.in_ball() * 0.9 + Vec3::new(0.0, -0.35, 0.0);
    let curl = random.in_ball() * 0.5;
    let moved = random.direction() * random.between(0.04, 0.1) * time;
    let start = root * 0.25 + moved;
    // A cubic: out along the root, then to one side, then curled.
    let at = |s: f32| start + (root * s + bend * (s * s * 0.5) + curl * (s * s * s)) * length;
    let (side, other) = frame(root);
    let corner = [side, other * 0.866 - side * 0.5, -other * 0.866 - side * 0.5];
    let point = |ring: usize, k: usize| {
        let s = ring as f32 / SEGMENTS as f32;
        at(s) + corner[k] * (radius * (1.0 - 0.8 * s))
    };
    shape.tube(None, SEGMENTS, 3, point, Some(at(1.0)));
}
