//! What is rendered: things, their surfaces, the light, and a camera with a lens.

use crate::materials::Surface;
use crate::sky::Sky;
use mbkd::glam::Vec3;
use mbkd::{MovingSphere, TriangleMesh};
use mbkd_scenes::{Camera, FlakeSphere};

/// Meshes or spheres.
pub enum Things {
    /// Triangle meshes, each with its surface.
    Meshes(Vec<TriangleMesh>, Vec<Surface>),
    /// Spheres, coloured by level.
    Spheres(Vec<FlakeSphere>),
    /// Meshes with their surfaces, and drops with their colours.
    Fluid {
        /// What stands still.
        meshes: Vec<TriangleMesh>,
        /// One for each mesh.
        surfaces: Vec<Surface>,
        /// What flows.
        drops: Vec<(MovingSphere, Vec3)>,
    },
}

impl Things {
    /// Number of triangles or spheres.
    pub fn count(&self) -> usize {
        match self {
            Things::Meshes(meshes, _) => meshes.iter().map(TriangleMesh::len).sum(),
            Things::Spheres(spheres) => spheres.len(),
            Things::Fluid { drops, .. } => drops.len(),
        }
    }

    /// What they are called.
    pub fn noun(&self) -> &'static str {
        match self {
            Things::Meshes(..) => "triangles",
            Things::Spheres(_) => "spheres",
            Things::Fluid { .. } => "drops",
        }
    }
}

/// Everything a picture needs.
pub struct Stage {
    /// For messages.
    pub name: String,
    /// What there is to see.
    pub things: Things,
    /// Where from.
    pub camera: Camera,
    /// Radius of the lens; 0 is a pinhole.
    pub aperture: f32,
    /// Distance that is in focus; `None`: that of the camera's target.
    pub focus: Option<f32>,
    /// In what light.
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
