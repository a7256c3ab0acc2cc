//! The input of rendering: objects, their surfaces, the light, and a camera with a lens.

use crate::materials::Surface;
use crate::sky::Sky;
use mbkd::TriangleMesh;
use mbkd::glam::Vec3;
use mbkd_scenes::{Camera, FlakeSphere};

/// The visible objects.
#[derive(Default)]
pub struct Things {
    /// Triangle meshes.
    pub meshes: Vec<TriangleMesh>,
    /// The surface of each mesh.
    pub surfaces: Vec<Surface>,
    /// Spheres, coloured by level.
    pub spheres: Vec<FlakeSphere>,
    /// The colours of the levels; [`LEVELS`] if empty.
    pub colors: Vec<Vec3>,
}

impl Things {
    /// Triangle meshes, each with its surface.
    pub fn meshes(meshes: Vec<TriangleMesh>, surfaces: Vec<Surface>) -> Things {
        Things { meshes, surfaces, ..Things::default() }
    }

    /// Number of triangles and spheres.
    pub fn count(&self) -> usize {
        self.meshes.iter().map(TriangleMesh::len).sum::<usize>() + self.spheres.len()
    }

    /// The noun for them in messages.
    pub fn noun(&self) -> &'static str {
        match (self.meshes.is_empty(), self.spheres.is_empty()) {
            (_, true) => "triangles",
            (true, false) => "spheres",
            (false, false) => "triangles and spheres",
        }
    }
}

/// Everything a picture needs.
pub struct Stage {
    /// The name, for messages.
    pub name: String,
    /// The visible objects.
    pub things: Things,
    /// The camera.
    pub camera: Camera,
    /// Radius of the lens; 0 is a pinhole.
    pub aperture: f32,
    /// Distance that is in focus; `None`: that of the camera's target.
    pub focus: Option<f32>,
    /// The light from outside.
    pub sky: Sky,
}

/// Colours of the levels of the flake.
pub const LEVELS: [Vec3; 6] = [
    Vec3::new(0.62, 0.60, 0.58),
    Vec3::new(0.80, 0.52, 0.14),
    Vec3::new(0.70, 0.18, 0.08),
    Vec3::new(0.16, 0.36, 0.52),
    Vec3::new(0.75, 0.70, 0.60),
    Vec3::new(0.80, 0.45, 0.20),
];
