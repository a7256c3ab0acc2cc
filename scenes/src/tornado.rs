//! Loose triangles in a funnel, each in its own random motion of 10 % of the funnel's height.
//!
//! The motion is incoherent: the bounds of any group are wide, and time is the only axis along
//! which triangles can be separated.

use super::random::Random;
use super::shape::{Shape, animate};
use super::turn::cos_sin;
use super::{Camera, Look, Scene, View};
use glam::Vec3;

const HEIGHT: f32 = 4.0;

/// The tornado, with exactly this many triangles (at least one).
///
/// ```
/// let scene = mbkd_scenes::tornado(500);
/// assert_eq!(scene.meshes[0].keys.len(), 2);
/// ```
pub fn tornado(triangles: usize) -> Scene {
    let triangles = triangles.max(1);
    let size = (4.0 / (triangles as f32).sqrt()).min(0.2);
    let mesh = animate(2, |time| {
        let mut random = Random(0x70b0);
        let mut shape = Shape::default();
        for _ in 0..triangles {
            let centre = in_funnel(&mut random) + random.direction() * (0.1 * HEIGHT * time);
            // The corners rotate a little around their centre, each triangle differently.
            let mut corner = || centre + (random.direction() + random.in_ball() * (0.3 * time)) * size;
            shape.triangle([corner(), corner(), corner()]);
        }
        shape
    });
    Scene {
        name: "tornado".into(),
        meshes: vec![mesh],
        looks: vec![Look::varied(Vec3::new(0.75, 0.28, 0.06), Vec3::new(0.75, 0.66, 0.38), 1)],
        camera: Camera::fixed(View::new(Vec3::new(0.0, 1.7, 7.6), Vec3::new(0.0, 2.15, 0.0), 0.64)),
    }
}

/// Dense at the foot and along the wall, wide and thin above, leaning and winding.
fn in_funnel(random: &mut Random) -> Vec3 {
    let u = random.unit();
    let h = 0.35 * u + 0.65 * u * u;
    let (c, s) = cos_sin(random.unit());
    let wall = 1.0 - 0.35 * random.unit() * random.unit();
    let radius = (0.08 + 1.35 * h * h) * wall;
    let (lean, wind) = cos_sin(0.15 + 0.4 * h);
    let axis = Vec3::new(0.35 * h * lean, HEIGHT * h, 0.35 * h * wind);
    axis + Vec3::new(c * radius, 0.12 * radius * random.between(-1.0, 1.0), s * radius)
}
