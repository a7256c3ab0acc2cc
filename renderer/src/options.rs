//! The command line.

use crate::film::Region;
use clap::{Parser, Subcommand, ValueEnum};
use mbkd::glam::Vec3;
use mbkd::{KdParams, Policy};
use mbkd_scenes::{CATALOGUE, Camera, View};
use std::path::PathBuf;

/// Renders moving geometry with motion blur, using a tree in which every ray has its own time.
///
/// Without arguments it renders a hall with a running figure to motion_blur.png, in less than a minute.
#[derive(Parser, Clone, Debug)]
#[command(name = "motion_blur", after_help = EXAMPLES, max_term_width = 100, args_conflicts_with_subcommands = true)]
pub struct Options {
    /// Other commands.
    #[command(subcommand)]
    pub command: Option<Command>,

    /// Scene to render: flake (spheres) or one of the scenes listed below
    #[arg(long, default_value = "hall", value_parser = scene_name, help_heading = "What to see", conflicts_with = "mesh")]
    pub scene: String,
    /// Approximate number of triangles (or spheres) of the scene; `full` is the size used by benchmarks
    #[arg(long, value_name = "N|full", value_parser = count, help_heading = "What to see", conflicts_with = "mesh")]
    pub triangles: Option<Count>,
    /// Files instead of a scene: .glb .gltf .obj .ply .mseq; several of equal topology are the keys of one shutter interval
    #[arg(long, num_args = 1.., value_name = "FILE", help_heading = "What to see")]
    pub mesh: Vec<PathBuf>,
    /// Up axis of the files
    #[arg(long, default_value = "y", requires = "mesh", conflicts_with = "scene", help_heading = "What to see")]
    pub up: Axis,
    /// Omit the floor below models from files
    #[arg(long, requires = "mesh", conflicts_with = "scene", help_heading = "What to see")]
    pub no_floor: bool,

    /// The animation of a glTF file, by name or number
    #[arg(long, requires = "mesh", conflicts_with = "scene", help_heading = "When (files with an animation)")]
    pub clip: Option<String>,
    /// Middle of the shutter, in seconds of the clip [default: the middle of the clip]
    #[arg(long, requires = "mesh", conflicts_with = "scene", value_name = "SECONDS", value_parser = finite, allow_hyphen_values = true, help_heading = "When (files with an animation)")]
    pub time: Option<f64>,
    /// Duration of the open shutter [default: 1/24 s; with --frames half a frame]
    #[arg(long, requires = "mesh", conflicts_with = "scene", value_name = "SECONDS", value_parser = positive, allow_hyphen_values = true, help_heading = "When (files with an animation)")]
    pub shutter: Option<f64>,
    /// Number of keys in the shutter interval at which poses are computed; motion is linear between them [default: 5]
    #[arg(long, requires = "mesh", conflicts_with = "scene", value_parser = clap::value_parser!(u32).range(1..=64), help_heading = "When (files with an animation)")]
    pub keys: Option<u32>,

    /// Eye and target at the camera's keys: x,y,z:x,y,z[;x,y,z:x,y,z...]; with several keys the camera moves during the shutter
    #[arg(long, value_name = "KEYS", value_parser = camera_keys, help_heading = "Camera", allow_hyphen_values = true)]
    pub camera_keys: Option<CameraKeys>,
    /// Vertical field of view in degrees
    #[arg(long, value_name = "DEGREES", value_parser = angle, help_heading = "Camera")]
    pub fov: Option<f32>,
    /// For files: azimuth of the camera in degrees [default: 30]
    #[arg(long, requires = "mesh", conflicts_with_all = ["scene", "camera_keys"], value_parser = degrees, value_name = "DEGREES", allow_hyphen_values = true, help_heading = "Camera")]
    pub azimuth: Option<f32>,
    /// For files: elevation of the camera in degrees above the horizon [default: 12]
    #[arg(long, requires = "mesh", conflicts_with_all = ["scene", "camera_keys"], value_parser = degrees, value_name = "DEGREES", allow_hyphen_values = true, help_heading = "Camera")]
    pub elevation: Option<f32>,
    /// Lens radius in scene units; 0 is a pinhole
    #[arg(long, default_value_t = 0.0, value_parser = not_negative, allow_hyphen_values = true, help_heading = "Camera")]
    pub aperture: f32,
    /// Focus distance [default: the distance of the target]
    #[arg(long, requires = "aperture", value_parser = above_zero, allow_hyphen_values = true, help_heading = "Camera")]
    pub focus: Option<f32>,
    /// Sky and environment light [default: that of the scene; a studio for files]
    #[arg(long, help_heading = "Light")]
    pub sky: Option<Surround>,
    /// Direction towards the sun
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, help_heading = "Light", allow_hyphen_values = true)]
    pub sun: Option<Vec3>,
    /// Tangent of the sun's angular radius: larger is softer
    #[arg(long, value_parser = not_negative, allow_hyphen_values = true, help_heading = "Light")]
    pub sun_radius: Option<f32>,
    /// Exposure relative to that of the scene
    #[arg(long, default_value_t = 1.0, value_parser = above_zero, allow_hyphen_values = true, help_heading = "Light")]
    pub exposure: f32,
    /// Diffuse bounces after the first surface; 0 is ambient occlusion
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=64), help_heading = "Light")]
    pub bounces: u32,
    /// Render sharp caustics from metals, with the bright specks (fireflies) that they cause
    #[arg(long, help_heading = "Light")]
    pub caustics: bool,

    /// Width in pixels
    #[arg(long, default_value_t = 960, value_parser = clap::value_parser!(u32).range(1..=16384), help_heading = "Picture")]
    pub width: u32,
    /// Height in pixels
    #[arg(long, default_value_t = 540, value_parser = clap::value_parser!(u32).range(1..=16384), help_heading = "Picture")]
    pub height: u32,
    /// Samples per pixel
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65536), help_heading = "Picture")]
    pub spp: u32,
    /// Random seed; the same seed gives the same file
    #[arg(long, default_value_t = 0, help_heading = "Picture")]
    pub seed: u64,
    /// Output file: .png, or linear light as .exr or .pfm; may be given several times
    #[arg(short, long, value_name = "FILE", help_heading = "Picture")]
    pub output: Vec<PathBuf>,
    /// Render a sequence of this many frames: numbered PNGs and one animated GIF
    #[arg(long, conflicts_with_all = ["time", "heatmap", "compare"], value_name = "N", value_parser = clap::value_parser!(u32).range(1..=9999), help_heading = "Picture")]
    pub frames: Option<u32>,
    /// Draw a heat map of the cost of camera rays instead of a picture
    #[arg(long, help_heading = "Picture", conflicts_with_all = LIGHT)]
    pub heatmap: Option<Heat>,
    /// Draw heat maps of these policies (names as for --policy) side by side, on one scale; without --heatmap, of steps
    #[arg(long, conflicts_with_all = LIGHT, conflicts_with = "policy", value_name = "POLICY,POLICY", value_delimiter = ',', value_parser = policy, num_args = 1.., help_heading = "Picture")]
    pub compare: Vec<Policy>,

    /// Render only this frame of --frames, counted from 0
    #[arg(long, requires = "frames", value_name = "K", help_heading = "Farms")]
    pub frame: Option<u32>,
    /// Render only the samples A to B-1 of --spp, to an .exr for merging
    #[arg(long, value_name = "A..B", value_parser = range, conflicts_with_all = ["heatmap", "compare"], help_heading = "Farms")]
    pub samples: Option<(u32, u32)>,
    /// Render only these pixels (column, row, columns, rows), to an .exr for merging
    #[arg(long, value_name = "X,Y,W,H", value_parser = tile, conflicts_with_all = ["heatmap", "compare"], help_heading = "Farms")]
    pub tile: Option<Region>,
    /// Print commands that render the work in parts, one per line, instead of rendering: the frames of --frames, or N parts
    /// of a picture [default: 4] followed by the merge command
    #[arg(long, num_args = 0..=1, default_missing_value = "4", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536), conflicts_with_all = ["heatmap", "compare", "frame", "samples", "tile"], help_heading = "Farms")]
    pub list_commands: Option<u32>,

    /// Kind of tree: wide (default), paper-kd (the paper's) or classic-kd
    #[arg(long, value_parser = policy, help_heading = "Engine")]
    pub policy: Option<Policy>,
    /// Number of threads [default: all]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024), help_heading = "Engine")]
    pub threads: Option<u32>,
}

/// Options without effect on heat maps.
const LIGHT: [&str; 7] = ["sky", "sun", "sun_radius", "exposure", "bounces", "caustics", "frames"];

/// Commands other than rendering.
#[derive(Subcommand, Clone, Debug)]
pub enum Command {
    /// Merge parts rendered with --samples or --tile into the same file as a single run
    Merge {
        /// All parts of one picture
        #[arg(required = true, value_name = "PART.exr")]
        parts: Vec<PathBuf>,
        /// Output file: .png, or linear light as .exr or .pfm; may be given several times
        #[arg(short, long, value_name = "FILE")]
        output: Vec<PathBuf>,
    },
}

const EXAMPLES: &str = "\
Scenes:
  hall      static columns and a running figure (the default)
  camera    the same hall, static, with a moving camera
  hairball  hair, each strand moving independently
  tornado   loose triangles in random motion
  flake     a recursive flake of moving spheres
  hand      a closing hand
  coherent  one flying rock
  needles, needles30, debris: stress tests
  mixed     the hall, the rock and a tornado combined
  building, visited, distant, crowd: rooms and figures

Examples:
  motion_blur --scene tornado --spp 64 -o tornado.png
  motion_blur --mesh run_20.obj run_21.obj --up x
  motion_blur --mesh robot.glb --clip Robot_Running --time 0.4 --shutter 0.05
  motion_blur --scene hall --heatmap tests --compare paper-kd,classic-kd
  motion_blur --mesh renderer/models/biplane.glb --no-floor --sky air --frames 18 -o biplane.png
  motion_blur --scene hairball --spp 256 --list-commands 8 -o hair.png
  motion_blur --spp 256 --samples 0..64 --tile 0,0,480,540 -o part.exr
  motion_blur merge part*.exr -o whole.png";

/// Kinds of heat maps.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Heat {
    /// Nodes and leaves visited per camera ray
    Steps,
    /// Primitives tested per camera ray
    Tests,
    /// References skipped because their time interval excludes the ray's time
    TimeSkips,
}

/// Skies that can be selected.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Surround {
    /// A uniform grey background and a white key light
    Studio,
    /// A warm sun and a blue sky over brown ground
    Afternoon,
    /// The same, high above the ground: blue all around, with haze below
    Air,
    /// One hard light and a faint glow
    Night,
}

/// An axis of a file.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Axis {
    /// The x axis
    X,
    /// The y axis
    Y,
    /// The z axis
    Z,
}

/// The size of a scene.
#[derive(Clone, Copy, Debug)]
pub enum Count {
    /// An approximate number.
    About(usize),
    /// The size used by benchmarks.
    Full,
}

/// Eye and target at each key of the camera.
#[derive(Clone, Debug)]
pub struct CameraKeys(pub Vec<(Vec3, Vec3)>);

impl CameraKeys {
    /// The camera, with this up axis and picture height at distance 1.
    pub fn camera(&self, up: Vec3, height: f32) -> Camera {
        Camera { keys: self.0.iter().map(|&(position, target)| View { position, target, up, height }).collect() }
    }
}

/// The policies that can be selected by name.
pub fn policies() -> [(&'static str, Policy); 3] {
    [
        ("wide", Policy::default()),
        ("paper-kd", Policy::Kd(KdParams::paper())),
        ("classic-kd", Policy::Kd(KdParams::classic())),
    ]
}

/// A policy's name on the command line.
pub fn policy_name(policy: Policy) -> &'static str {
    policies().into_iter().find(|(_, p)| *p == policy).map_or("?", |(name, _)| name)
}

fn policy(text: &str) -> Result<Policy, String> {
    let known = || policies().map(|(name, _)| name).join(", ");
    policies()
        .into_iter()
        .find(|(name, _)| *name == text)
        .map(|(_, p)| p)
        .ok_or_else(|| format!("known policies are {}", known()))
}

fn scene_name(text: &str) -> Result<String, String> {
    let known = || CATALOGUE.iter().map(|r| r.name).chain(["flake"]).collect::<Vec<_>>().join(", ");
    if text == "flake" || mbkd_scenes::find(text).is_some() {
        Ok(text.into())
    } else {
        Err(format!("known scenes are {}", known()))
    }
}

fn count(text: &str) -> Result<Count, String> {
    if text == "full" {
        return Ok(Count::Full);
    }
    match text.replace('_', "").parse::<usize>() {
        Ok(n) if n <= 100_000_000 => Ok(Count::About(n)),
        _ => Err("expected a number up to 100000000, or `full`".into()),
    }
}

fn range(text: &str) -> Result<(u32, u32), String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    ends.filter(|(a, b)| a < b).ok_or_else(|| "expected two numbers A..B, the first less than the second".into())
}

fn tile(text: &str) -> Result<Region, String> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, width @ 1..=16384, height @ 1..=16384]) => Ok(Region { x, y, width, height }),
        _ => Err("expected column, row, columns and rows: X,Y,W,H".into()),
    }
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(|| "expected a finite number".into())
}

fn positive(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|x| *x > 0.0).ok_or_else(|| "expected a number greater than 0".into())
}

fn angle(text: &str) -> Result<f32, String> {
    text.parse::<f32>()
        .ok()
        .filter(|x| *x > 0.0 && *x < 180.0)
        .ok_or_else(|| "expected degrees between 0 and 180".into())
}

fn degrees(text: &str) -> Result<f32, String> {
    text.parse::<f32>().ok().filter(|x| x.is_finite()).ok_or_else(|| "expected a finite number of degrees".into())
}

fn not_negative(text: &str) -> Result<f32, String> {
    let number = text.parse::<f32>().ok().filter(|x| (0.0..f32::INFINITY).contains(x));
    number.ok_or_else(|| "expected a finite number, 0 or more".into())
}

fn above_zero(text: &str) -> Result<f32, String> {
    not_negative(text).ok().filter(|x| *x > 0.0).ok_or_else(|| "expected a finite number greater than 0".into())
}

fn direction(text: &str) -> Result<Vec3, String> {
    let direction = vector(text)?;
    if direction == Vec3::ZERO { Err(format!("`{text}` is not a direction")) } else { Ok(direction) }
}

fn vector(text: &str) -> Result<Vec3, String> {
    let numbers: Vec<f32> = text.split(',').map_while(|x| x.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if text.split(',').count() == 3 && Vec3::new(x, y, z).is_finite() => Ok(Vec3::new(x, y, z)),
        _ => Err(format!("`{text}` is not three numbers x,y,z")),
    }
}

fn camera_keys(text: &str) -> Result<CameraKeys, String> {
    let key = |part: &str| {
        let (eye, target) = part.split_once(':').ok_or_else(|| format!("`{part}` is not eye:target"))?;
        let (eye, target) = (vector(eye)?, vector(target)?);
        if eye == target { Err("eye and target are the same point".into()) } else { Ok((eye, target)) }
    };
    text.split(';').map(key).collect::<Result<Vec<_>, String>>().map(CameraKeys)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent_and_errors_name_the_option() {
        Options::command().debug_assert();
        let parse = |line: &str| Options::try_parse_from(line.split(' ')).map_err(|e| e.to_string());
        assert!(parse("x").is_ok());
        let keys = parse("x --camera-keys -1,0,0:0,0,0;1,2,3:0,1,0").unwrap().camera_keys.unwrap();
        assert_eq!(keys.0[1], (Vec3::new(1.0, 2.0, 3.0), Vec3::Y));
        for (line, word) in [
            ("x --scene teapot", "tornado"),
            ("x --policy magic", "paper-kd"),
            ("x --spp 0", "--spp"),
            ("x --camera-keys 1,2:3", "x,y,z"),
            ("x --sun 1,2,nan", "x,y,z"),
            ("x --mesh a.glb --shutter -1", "--shutter"),
            ("x --sun 0,0,0", "--sun"),
            ("x --sky green", "studio"),
            ("x --sky air --heatmap steps", "--heatmap"),
            ("x --exposure -1", "--exposure"),
            ("x --focus 3", "--aperture"),
            ("x --time 0.5", "--mesh"),
            ("x --scene hall --azimuth 10", "--scene"),
            ("x --mesh a.obj --triangles 100", "--triangles"),
            ("x --frames 3 --heatmap steps", "--heatmap"),
            ("x --scene hall --mesh a.obj", "--mesh"),
            ("x --heatmap steps --exposure 2", "--exposure"),
            ("x --compare paper-kd,wide --bounces 2", "--bounces"),
            ("x --compare paper-kd,wide --policy wide", "--policy"),
            ("x --mesh a.obj --camera-keys 1,2,3:0,0,0 --azimuth 3", "--azimuth"),
            ("x --frame 3", "--frames"),
            ("x --samples 4..4", "A..B"),
            ("x --tile 0,0,0,5", "X,Y,W,H"),
            ("x --list-commands --samples 0..1", "--samples"),
            ("x merge", "PART.exr"),
        ] {
            let error = parse(line).unwrap_err();
            assert!(error.contains(word), "{line}: {error}");
        }
    }
}
