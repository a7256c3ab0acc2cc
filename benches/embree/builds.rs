//! Build times and memory: ours and every Embree configuration in turns, each tree dropped again.

use crate::clock;
use crate::configs;
use crate::ffi::Embree;
use crate::options::{Only, Options};
use crate::ours::Ours;
use crate::timing::median;
use mbkd::scene::Scene;
use std::sync::OnceLock;
use std::time::Instant;

/// Builds of one scene with one number of threads. Seconds are medians.
pub struct Builds {
    pub scene: String,
    pub threads: usize,
    /// NaN where our side is left out.
    pub ours: f64,
    pub our_bytes: f64,
    pub theirs: Vec<Theirs>,
}

/// One Embree configuration.
pub struct Theirs {
    pub config: &'static str,
    pub seconds: f64,
    /// Tree, vertex and index buffers.
    pub bytes: usize,
    /// The buffers alone.
    pub buffers: usize,
}

/// Processor time for one thread, the time that passes for several.
fn now(threads: usize) -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    if threads == 1 { clock::seconds() } else { START.get_or_init(Instant::now).elapsed().as_secs_f64() }
}

/// Measures the builds of a scene.
pub fn measure(options: &Options, embree: Option<&Embree>, scene: &Scene, threads: usize) -> Result<Builds, String> {
    let meshes = &scene.meshes;
    let configs: Vec<_> = configs::all(meshes).into_iter().filter(|c| options.wants(c.name)).collect();
    let mut our_seconds = Vec::new();
    let mut our_bytes = f64::NAN;
    let mut build_ours = || -> Result<(), String> {
        if options.only != Some(Only::Embree) {
            let start = now(threads);
            let ours = Ours::build(meshes, threads)?;
            our_seconds.push(now(threads) - start);
            our_bytes = ours.bytes() as f64;
        }
        Ok(())
    };
    let mut theirs: Vec<_> = configs.iter().map(|c| (c, Vec::new(), 0, 0)).collect();
    for _ in 0..options.build_runs.max(1) {
        for (config, seconds, bytes, buffers) in &mut theirs {
            build_ours()?;
            let Some(embree) = embree else { continue };
            let device = embree.device(&config.settings(threads, None))?;
            let tree = config.scene(&device, meshes, true)?;
            *buffers = device.bytes();
            let start = now(threads);
            tree.commit()?;
            seconds.push(now(threads) - start);
            *bytes = device.bytes();
        }
    }
    let theirs = if embree.is_none() { Vec::new() } else { theirs };
    Ok(Builds {
        scene: scene.name.clone(),
        threads,
        ours: median(our_seconds.into_iter()),
        our_bytes,
        theirs: theirs
            .into_iter()
            .map(|(config, seconds, bytes, buffers)| Theirs {
                config: config.name,
                seconds: median(seconds.into_iter()),
                bytes,
                buffers,
            })
            .collect(),
    })
}
