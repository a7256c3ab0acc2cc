//! Deterministic procedural scenes for the examples, the benches and the tests.
//!
//! Each scene is one function of a triangle budget, in a file of its own, and exercises one property: hair
//! whose strands separate, loose triangles, a large static room with a small moving figure, long needles, flying
//! debris, one rigid body, moving spheres. All have the same bits on every machine: integer random numbers,
//! polynomials for sine and cosine (`turn.rs`), and arithmetic that IEEE 754 defines exactly. [`CATALOGUE`] lists them.
//!
//! Lengths are in scene units, y is up, and the shutter is [0, 1].

mod building;
mod camera;
mod coherent;
mod debris;
mod flake;
mod hairball;
mod hall;
mod hand;
mod heat;
mod mixed;
mod needles;
mod random;
mod runner;
mod shape;
#[cfg(test)]
mod tests;
mod tornado;
mod turn;

pub use building::{building, crowd, distant, visited};
pub use camera::{Camera, View};
pub use coherent::{coherent, turning};
pub use debris::debris;
pub use flake::{FlakeSphere, flake};
pub use hairball::hairball;
pub use hall::{camera, hall, walking, walking_from};
pub use hand::hand;
pub use heat::heat;
pub use mixed::mixed;
pub use needles::needles;
pub use random::Random;
pub use shape::Shape;
pub use tornado::tornado;
pub use turn::frame;

use engine::TriangleMesh;
use glam::Vec3;

/// The material of a mesh. The tree does not use it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Diffuse reflectance in linear light.
    pub color: Vec3,
    /// A second reflectance; each group of triangles lies somewhere between the two.
    pub other: Vec3,
    /// Number of successive triangles of a group (a strand, a stone); 0: the whole mesh is one group.
    pub group: u32,
}

impl Look {
    /// One colour throughout.
    pub fn plain(color: Vec3) -> Look {
        Look { color, other: color, group: 0 }
    }

    /// A colour between the two for every `group` triangles.
    pub fn varied(color: Vec3, other: Vec3, group: u32) -> Look {
        Look { color, other, group }
    }
}

/// Meshes, materials and a camera.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The name in [`CATALOGUE`], or a custom one.
    pub name: String,
    /// The geometry.
    pub meshes: Vec<TriangleMesh>,
    /// One for each mesh.
    pub looks: Vec<Look>,
    /// A camera that shows the scene well.
    pub camera: Camera,
}

impl Scene {
    /// Number of triangles in all meshes.
    pub fn triangles(&self) -> usize {
        self.meshes.iter().map(TriangleMesh::len).sum()
    }
}

/// A scene that can be made at any size.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// The name on command lines and in tables.
    pub name: &'static str,
    /// A description in one line.
    pub about: &'static str,
    /// Triangles at full size, the size that benchmarks use.
    pub full: usize,
    /// Makes the scene with about the given number of triangles, but at least one object of each kind.
    pub make: fn(usize) -> Scene,
}

/// Every scene of triangles ([`flake()`] is the one of spheres).
pub const CATALOGUE: &[Recipe] = &[
    Recipe { name: "hairball", about: "hair, each strand moving its own way", full: 2_500_000, make: hairball },
    Recipe { name: "tornado", about: "loose triangles in random motion", full: 200_000, make: tornado },
    Recipe { name: "hall", about: "still columns and a running figure", full: 300_000, make: hall },
    Recipe { name: "camera", about: "the hall, still, for a moving camera", full: 250_000, make: camera },
    Recipe { name: "hand", about: "a hand that closes", full: 60_000, make: hand },
    Recipe { name: "coherent", about: "one rock in flight", full: 300_000, make: coherent },
    Recipe {
        name: "needles",
        about: "long needles, half of them moving 5 %",
        full: 50_000,
        make: |n| needles(n, 0.05),
    },
    Recipe { name: "needles30", about: "the same moving 30 %", full: 50_000, make: |n| needles(n, 0.3) },
    Recipe { name: "debris", about: "stones flying far and spinning", full: 192_000, make: debris },
    Recipe { name: "mixed", about: "the hall, a rock in flight and a tornado", full: 400_000, make: mixed },
    Recipe { name: "building", about: "still rooms of very uneven triangles", full: 56_000, make: building },
    Recipe {
        name: "visited",
        about: "the building and a running figure of half its triangles",
        full: 130_000,
        make: visited,
    },
    Recipe { name: "distant", about: "a small figure that most rays miss", full: 12_000, make: distant },
    Recipe { name: "crowd", about: "hundreds of running figures", full: 1_000_000, make: crowd },
];

/// The recipe of that name.
///
/// ```
/// let recipe = mbkd_scenes::find("tornado").unwrap();
/// let scene = (recipe.make)(1000);
/// assert_eq!(scene.triangles(), 1000);
/// assert!(mbkd_scenes::find("teapot").is_none());
/// ```
pub fn find(name: &str) -> Option<&'static Recipe> {
    CATALOGUE.iter().find(|recipe| recipe.name == name)
}
