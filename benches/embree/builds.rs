//! Build times and memory: in each round ours, then every Embree configuration, each tree dropped at once.

use crate::configs::{self, Config};
use crate::ffi::Embree;
use crate::options::{Mode, Only, Options};
use crate::ours::{self, Ours};
use mbkd_evidence::timing::{median, seconds, wall_seconds};
use mbkd_scenes::Scene;
use rayon::ThreadPool;
use std::sync::Arc;

/// Builds of one scene with one number of threads. Seconds are medians.
pub struct Builds {
    pub scene: String,
    pub threads: usize,
    /// NaN if our side is not measured.
    pub ours: f64,
    pub our_bytes: f64,
    pub theirs: Vec<Theirs>,
}

/// One Embree configuration.
#[derive(Default)]
pub struct Theirs {
    pub config: String,
    pub seconds: f64,
    /// Tree, vertex and index buffers.
    pub bytes: usize,
    /// The buffers alone.
    pub buffers: usize,
}

/// Processor time for one thread, wall-clock time for several.
fn now(threads: usize) -> f64 {
    if threads == 1 { seconds() } else { wall_seconds() }
}

/// Measures the builds of a scene.
pub fn measure(options: &Options, embree: Option<&Embree>, scene: &Scene, threads: usize) -> Result<Builds, String> {
    let mut ours = OurBuilds { pool: ours::pool(threads)?, seconds: Vec::new(), bytes: f64::NAN };
    let mut theirs: Vec<(Config, Theirs, Vec<f64>)> = Vec::new();
    if embree.is_some() {
        // The configurations of the fast mode include those of the robust one.
        let wanted = configs::all(&scene.meshes, Mode::Fast).into_iter().filter(|config| options.wants(&config.name()));
        theirs.extend(wanted.map(|config| (config, Theirs { config: config.name(), ..Theirs::default() }, Vec::new())));
    }
    for _ in 0..options.build_runs {
        ours.build(options, scene, threads)?;
        for (config, figures, seconds) in &mut theirs {
            let Some(embree) = embree else { continue };
            let device = embree.device(&config.settings(threads, None))?;
            let tree = config.scene(&device, &scene.meshes, Mode::Robust)?;
            figures.buffers = device.bytes();
            let start = now(threads);
            tree.commit()?;
            seconds.push(now(threads) - start);
            figures.bytes = device.bytes();
        }
    }
    Ok(Builds {
        scene: scene.name.clone(),
        threads,
        ours: median(ours.seconds),
        our_bytes: ours.bytes,
        theirs: theirs
            .into_iter()
            .map(|(_, figures, seconds)| Theirs { seconds: median(seconds), ..figures })
            .collect(),
    })
}

/// Our builds so far.
struct OurBuilds {
    /// Created before any build, as Embree's threads are.
    pool: Arc<ThreadPool>,
    seconds: Vec<f64>,
    bytes: f64,
}

impl OurBuilds {
    fn build(&mut self, options: &Options, scene: &Scene, threads: usize) -> Result<(), String> {
        if options.only != Some(Only::Embree) {
            let start = now(threads);
            let tree = Ours::build(&scene.meshes, &self.pool)?;
            self.seconds.push(now(threads) - start);
            self.bytes = tree.bytes() as f64;
        }
        Ok(())
    }
}
