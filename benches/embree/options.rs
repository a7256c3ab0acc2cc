//! The command line.

use clap::{Parser, ValueEnum};
use mbkd_evidence::scene_rays::Kind;

/// Times mbkd's ray queries against Embree's motion blur in one process: the same rays in the same order, in
/// alternation, medians. Without Embree it times mbkd alone.
///
/// Times are processor times of the process. For figures to publish give it an idle core (`taskset -c 1`); only ratios
/// carry over to other machines.
#[derive(Parser)]
#[command(name = "embree", bin_name = "cargo bench --bench embree --")]
pub struct Options {
    /// Scenes, all by default.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "hairball,tornado,hall,coherent,needles,debris,building,visited,distant,crowd"
    )]
    pub scenes: Vec<String>,
    /// Share of each scene's full number of triangles.
    #[arg(long, default_value_t = 1.0)]
    pub scale: f32,
    /// Kinds of rays.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "primary,bounce,ao")]
    pub kinds: Vec<Kind>,
    /// Width and height of the picture in pixels, one primary ray each; rounded up to tiles of 8.
    #[arg(long, default_value_t = 192, value_parser = clap::value_parser!(u32).range(1..=8192))]
    pub side: u32,
    /// Timed rounds, each ours then theirs; for publishable figures 9, with `--side 512`.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    pub runs: u32,
    /// Embree with its robust scene flag (like our watertight test), and without.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "robust,fast")]
    pub modes: Vec<Mode>,
    /// Instruction sets: all of the CPU, or both sides restricted to AVX2.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "native")]
    pub isa: Vec<Isa>,
    /// Only Embree configurations whose name contains one of these.
    #[arg(long, value_delimiter = ',')]
    pub configs: Vec<String>,
    /// Scenes whose rays are also traced in batches.
    #[arg(long, value_delimiter = ',', default_value = "hairball")]
    pub batch: Vec<String>,
    /// Timed builds of each side.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub build_runs: u32,
    /// Also build with all cores.
    #[arg(long)]
    pub parallel_build: bool,
    /// Measure one side only.
    #[arg(long, value_enum)]
    pub only: Option<Only>,
    /// Number of moving instances of each scene, instead of the scenes themselves.
    #[arg(long)]
    pub instances: Option<u32>,
    /// Number of spheres, instead of the scenes.
    #[arg(long)]
    pub spheres: Option<usize>,
    /// Closest points in the scenes, instead of rays.
    #[arg(long)]
    pub closest_points: bool,
    /// Hits with a filter and all hits, instead of plain queries.
    #[arg(long)]
    pub forms: bool,
    /// Closest and any hits with a mask that hides every other mesh, instead of plain queries.
    #[arg(long)]
    pub masks: bool,
    /// Number of boxes as custom primitives, instead of the scenes.
    #[arg(long)]
    pub boxes: Option<usize>,
    /// Embree's library file; by default the system's, 4.x before 3.x.
    #[arg(long)]
    pub embree: Option<String>,
    /// Also print every Embree configuration, not only the best.
    #[arg(long)]
    pub details: bool,
}

impl Options {
    /// Whether an Embree configuration of this name is selected.
    pub fn wants(&self, config: &str) -> bool {
        self.configs.is_empty() || self.configs.iter().any(|part| config.contains(part.as_str()))
    }
}

/// Embree's triangle test.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Mode {
    Robust,
    Fast,
}

/// Instruction set of both sides.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Isa {
    Native,
    Avx2,
}

/// One of the two sides.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Only {
    Ours,
    Embree,
}
