//! Three kinds of motion in one scene: the static hall with its runner, the rock in flight, and the tornado in the aisle.
//!
//! A good temporal split for one of them is wasted on the others, so a tree has to choose for each region.

use super::{Scene, coherent, hall, tornado};
use engine::Keys;
use glam::Vec3;

/// The scene with about this many triangles: two fifths the hall, the rest rock and tornado in equal parts.
///
/// ```
/// let scene = mbkd_scenes::mixed(20_000);
/// let moving = scene.meshes.iter().filter(|mesh| mesh.keys.len() > 1);
/// assert!(moving.count() >= 4); // skin and clothes of the runner, rock, tornado
/// ```
pub fn mixed(triangles: usize) -> Scene {
    let mut scene = hall(triangles * 2 / 5);
    scene.name = "mixed".into();
    add(&mut scene, coherent(triangles * 3 / 10), 0.75, Vec3::new(-1.0, 3.1, 1.2));
    add(&mut scene, tornado(triangles * 3 / 10), 0.9, Vec3::new(0.5, 0.0, -0.8));
    scene
}

/// Adds another scene's meshes at a position of this one.
fn add(scene: &mut Scene, other: Scene, scale: f32, at: Vec3) {
    for mut mesh in other.meshes {
        if let Keys::F32(keys) = &mut mesh.keys {
            keys.iter_mut().flatten().for_each(|p| *p = *p * scale + at);
        }
        scene.meshes.push(mesh);
    }
    scene.looks.extend(other.looks);
}
