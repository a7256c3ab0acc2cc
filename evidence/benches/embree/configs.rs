//! The ways Embree is set up for motion blur: every one of them is tried, and per cell the best is the one
//! to beat.
//!
//! Embree splits time only where it is given more time steps, so the same motion is also registered with
//! each segment between keys cut into 2 and into 8. Meshes that stand still are registered like the moving
//! ones, or with a single step, for which Embree has its static nodes.

use crate::ffi::{Device, EmbreeScene, Mesh};
use crate::geometry::positions;
use glam::Vec3;
use mbkd::{TriangleMesh, glam};
use std::borrow::Cow;

/// One way to set Embree up.
#[derive(Clone, Copy)]
pub struct Config {
    pub name: &'static str,
    /// Embree's configuration string, beside threads and instruction set.
    settings: &'static str,
    /// Parts that each segment between two keys is cut into.
    parts: usize,
    /// Whether still meshes get one step.
    still_as_one: bool,
}

const T4V: &str = "tri_accel_mb=bvh8.triangle4vmb";

/// All ways, the default first; those that differ in still meshes only where there are some.
pub fn all(meshes: &[TriangleMesh]) -> Vec<Config> {
    let config = |name, settings, parts, still_as_one| Config { name, settings, parts, still_as_one };
    let mut configs = vec![
        config("default", "", 1, false),
        config("t4v", T4V, 1, false),
        config("t4v, 3 steps", T4V, 2, false),
        config("t4v, 9 steps", T4V, 8, false),
    ];
    if meshes.iter().any(is_still) {
        configs.extend([
            config("default, still as 1", "", 1, true),
            config("t4v, still as 1", T4V, 1, true),
            config("t4v, 3 steps, still as 1", T4V, 2, true),
            config("t4v, 9 steps, still as 1", T4V, 8, true),
        ]);
    }
    configs
}

/// Whether no vertex moves.
pub fn is_still(mesh: &TriangleMesh) -> bool {
    positions(mesh).windows(2).all(|pair| pair[0] == pair[1])
}

impl Config {
    /// Embree's whole configuration string.
    pub fn settings(&self, threads: usize, isa: Option<&str>) -> String {
        let isa = isa.map_or(String::new(), |isa| format!(",isa={isa}"));
        let comma = if self.settings.is_empty() { "" } else { "," };
        format!("threads={threads}{isa}{comma}{}", self.settings)
    }

    /// The scene with its buffers filled, not yet committed.
    pub fn scene<'d>(
        &self,
        device: &'d Device<'_>,
        meshes: &[TriangleMesh],
        robust: bool,
    ) -> Result<EmbreeScene<'d>, String> {
        let scene = device.scene(robust)?;
        for (id, mesh) in meshes.iter().enumerate() {
            scene.attach(id as u32, &Mesh { indices: &mesh.indices, steps: self.steps(mesh) })?;
        }
        Ok(scene)
    }

    /// The mesh's positions at evenly spaced times, as this configuration registers them.
    fn steps<'m>(&self, mesh: &'m TriangleMesh) -> Vec<Cow<'m, [Vec3]>> {
        let keys = positions(mesh);
        if is_still(mesh) {
            let count = if self.still_as_one { 1 } else { 1 + self.parts };
            return vec![keys[0].clone(); count];
        }
        let mut steps = Vec::new();
        for pair in keys.windows(2) {
            steps.push(pair[0].clone());
            steps.extend((1..self.parts).map(|part| {
                let s = part as f32 / self.parts as f32;
                Cow::from_iter(pair[0].iter().zip(pair[1].iter()).map(|(&a, &b)| a + (b - a) * s))
            }));
        }
        steps.extend(keys.last().cloned());
        steps
    }
}
