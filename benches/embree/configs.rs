//! Embree's configurations for motion blur: all of them are measured, and each cell compares with the best one.
//!
//! Its option of precomputed triangles (`t4v`) has no robust form: Embree then ignores the robust flag and uses the
//! fast test. So it is in the fast configurations only.
//!
//! Embree splits time only at time steps, so the same motion is also registered with each segment between keys divided
//! into 2 and into 8. Static meshes are registered like the moving ones, or with a single step, for which Embree has
//! static nodes.

use crate::ffi::{Device, EmbreeScene, Mesh, Quality};
use crate::options::Mode;
use glam::Vec3;
use mbkd::{Hit, TriangleMesh, glam};
use mbkd_evidence::triangles::positions;
use std::borrow::Cow;

/// A configuration of Embree.
#[derive(Clone, Copy)]
pub struct Config {
    triangles: Triangles,
    /// Time steps per segment between two keys.
    parts: usize,
    still: Still,
}

/// How Embree stores triangles.
#[derive(Clone, Copy, PartialEq)]
enum Triangles {
    /// Embree's default.
    Default,
    /// Moving vertices in the leaves, in a tree of width eight.
    Vertices,
}

/// How static meshes are registered.
#[derive(Clone, Copy)]
enum Still {
    /// With as many time steps as the others.
    AsMoving,
    /// With one step, in a tree of their own.
    OneStep,
    /// That tree with spatial splits.
    OneStepHighQuality,
}

/// The greatest number of time steps that Embree accepts (`RTC_MAX_TIME_STEP_COUNT`).
const MOST_STEPS: usize = 129;

/// All configurations of a mode, the default first. Those that differ in one kind of meshes are included only if there
/// are such meshes, and those with many steps only if Embree accepts their number.
pub fn all(meshes: &[TriangleMesh], mode: Mode) -> Vec<Config> {
    let stores: &[Triangles] = match mode {
        Mode::Robust => &[Triangles::Default],
        Mode::Fast => &[Triangles::Default, Triangles::Vertices],
    };
    let parts: &[usize] = if meshes.iter().all(is_still) { &[1] } else { &[1, 2, 8] };
    let segments = meshes.iter().map(|mesh| mesh.keys.len().max(2) - 1).max().unwrap_or(1);
    let fits = |parts: &&usize| **parts == 1 || segments * **parts < MOST_STEPS;
    let stills: &[Still] = if meshes.iter().any(is_still) {
        &[Still::AsMoving, Still::OneStep, Still::OneStepHighQuality]
    } else {
        &[Still::AsMoving]
    };
    let mut configs = Vec::new();
    for &still in stills {
        for &triangles in stores {
            configs.extend(parts.iter().filter(fits).map(|&parts| Config { triangles, parts, still }));
        }
    }
    configs
}

/// Whether no vertex moves.
pub fn is_still(mesh: &TriangleMesh) -> bool {
    positions(mesh).windows(2).all(|pair| pair[0] == pair[1])
}

impl Config {
    /// The name in tables.
    pub fn name(&self) -> String {
        let triangles = if self.triangles == Triangles::Default { "default" } else { "t4v" };
        let steps = if self.parts == 1 { String::new() } else { format!(", {} steps", self.parts + 1) };
        let still = match self.still {
            Still::AsMoving => "",
            Still::OneStep => ", still as 1",
            Still::OneStepHighQuality => ", still as 1, high quality",
        };
        format!("{triangles}{steps}{still}")
    }

    /// Embree's whole configuration string.
    pub fn settings(&self, threads: usize, isa: Option<&str>) -> String {
        let isa = isa.map_or(String::new(), |isa| format!(",isa={isa}"));
        let triangles = if self.triangles == Triangles::Default { "" } else { ",tri_accel_mb=bvh8.triangle4vmb" };
        format!("threads={threads}{isa}{triangles}")
    }

    /// The scene with its buffers filled, not yet committed.
    pub fn scene<'d>(
        &self,
        device: &'d Device<'_>,
        meshes: &[TriangleMesh],
        mode: Mode,
    ) -> Result<EmbreeScene<'d>, String> {
        self.scene_of(device, meshes, mode, |scene, id, mesh| scene.attach(id, mesh))
    }

    /// The same with a filter of hits.
    pub fn filtered_scene<'d>(
        &self,
        device: &'d Device<'_>,
        meshes: &[TriangleMesh],
        mode: Mode,
        accept: &'d impl Fn(&Hit) -> bool,
    ) -> Result<EmbreeScene<'d>, String> {
        self.scene_of(device, meshes, mode, |scene, id, mesh| scene.attach_filtered(id, mesh, accept))
    }

    fn scene_of<'d>(
        &self,
        device: &'d Device<'_>,
        meshes: &[TriangleMesh],
        mode: Mode,
        attach: impl Fn(&EmbreeScene<'d>, u32, &Mesh<'_>) -> Result<(), String>,
    ) -> Result<EmbreeScene<'d>, String> {
        let quality = if let Still::OneStepHighQuality = self.still { Quality::High } else { Quality::Medium };
        let scene = device.scene(mode == Mode::Robust, quality)?;
        for (id, mesh) in meshes.iter().enumerate() {
            attach(&scene, id as u32, &Mesh { indices: &mesh.indices, steps: self.steps(mesh) })?;
        }
        Ok(scene)
    }

    /// The mesh's positions at evenly spaced times, as this configuration registers them.
    fn steps<'m>(&self, mesh: &'m TriangleMesh) -> Vec<Cow<'m, [Vec3]>> {
        let keys = positions(mesh);
        if is_still(mesh) {
            let count = if let Still::AsMoving = self.still { 1 + self.parts } else { 1 };
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
