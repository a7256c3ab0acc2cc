//! From the command line to a stage: objects, light and camera.

use crate::materials::Surface;
use crate::options::{Axis, Count, Options, Surround};
use crate::readers::{Model, Pose};
use crate::sampling::cos_sin_f64;
use crate::sky::Sky;
use crate::smooth::Normals;
use crate::stage::{Stage, Things};
use crate::{say, warn};
use mbkd::TriangleMesh;
use mbkd::glam::{Vec3, Vec3Swizzles};
use mbkd_scenes::{Camera, flake};
use std::sync::Arc;

/// The source of stages: a procedural scene, or a model that is posed for each shutter.
pub enum Source {
    /// One of the library's scenes; its shutter covers all its motion.
    Scene,
    /// A model from files, and the box that contains its motion.
    Model(Box<Model>, Bounds),
}

/// A box.
#[derive(Clone, Copy)]
pub struct Bounds {
    min: Vec3,
    max: Vec3,
}

/// The interval in which a shutter is open, in seconds of a clip.
#[derive(Clone, Copy)]
pub struct Window {
    /// Opening time.
    pub open: f64,
    /// Closing time.
    pub close: f64,
}

impl Source {
    /// Reads the files, if there are any, and finds the bounds of the model's motion.
    pub fn open(options: &Options) -> Result<Source, String> {
        if options.mesh.is_empty() {
            return Ok(Source::Scene);
        }
        let model = Model::open(&options.mesh).map_err(|e| e.to_string())?;
        if options.clip.is_some() && !model.has_clips() {
            return Err("--clip has no effect: only glTF files have clips".into());
        }
        let mut bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
        let looks = if options.frames.is_some() { 16 } else { 1 };
        for i in 0..looks {
            let pose = pose(options, &model, window(options, &model, i, looks)?)?;
            for p in pose.parts.iter().flat_map(|part| part.keys.iter().flatten()) {
                let p = upright(options.up, *p);
                bounds = Bounds { min: bounds.min.min(p), max: bounds.max.max(p) };
            }
        }
        Ok(Source::Model(Box::new(model), bounds))
    }

    /// The stage of frame `frame` of `frames` (0 of 1 for a single picture).
    pub fn stage(&self, options: &Options, frame: u32, frames: u32) -> Result<Stage, String> {
        let mut stage = match self {
            Source::Scene => scene(options)?,
            Source::Model(model, bounds) => {
                let window = window(options, model, frame, frames)?;
                let pose = pose(options, model, window)?;
                describe(options, model, window, &pose)?;
                posed(options, pose, *bounds)?
            }
        };
        adjust(&mut stage, options);
        Ok(stage)
    }

    /// Duration of a sequence of all frames, in seconds.
    pub fn duration(&self, options: &Options, frames: u32) -> Result<f64, String> {
        Ok(match self {
            Source::Scene => f64::from(frames) / 12.0,
            Source::Model(model, _) => {
                let span = model.span(options.clip.as_deref()).map_err(|e| e.to_string())?;
                span.map_or(1.0, |(first, last)| last - first)
            }
        })
    }
}

/// The default number of poses per shutter.
const KEYS: u32 = 5;

/// The shutter interval of a frame. A sequence divides its clip evenly and keeps the shutter open half of the time; a
/// single picture is taken in the middle of the clip for a 24th of a second.
fn window(options: &Options, model: &Model, frame: u32, frames: u32) -> Result<Option<Window>, String> {
    let span = model.span(options.clip.as_deref()).map_err(|e| e.to_string())?;
    let as_they_are = frames == 1 && model.is_list_of_keys() && options.time.is_none() && options.shutter.is_none();
    let Some((first, last)) = span.filter(|_| !as_they_are) else {
        let asked = [
            ("--time", options.time.is_some()),
            ("--shutter", options.shutter.is_some()),
            ("--keys", options.keys.is_some()),
            ("--frames", options.frames.is_some()),
        ];
        return match asked.into_iter().find(|(_, given)| *given) {
            Some((option, _)) if as_they_are => {
                Err(format!("{option} has no effect: the files are the keys of the shutter"))
            }
            Some((option, _)) => Err(format!("{option} has no effect: nothing in the file is animated")),
            None => Ok(None),
        };
    };
    let step = (last - first) / f64::from(frames);
    let (middle, length) = match frames {
        1 => (options.time.unwrap_or(0.5 * (first + last)), 1.0 / 24.0),
        _ => (first + step * (f64::from(frame) + 0.5), 0.5 * step),
    };
    let half = 0.5 * options.shutter.unwrap_or(length);
    if middle + half < first || middle - half > last {
        return Err(format!("the clip does not play at {middle} s: it lasts from {first:.4} s to {last:.4} s"));
    }
    Ok(Some(Window { open: middle - half, close: middle + half }))
}

/// Prints the shutter interval, and a warning if nothing moves in it.
fn describe(options: &Options, model: &Model, window: Option<Window>, pose: &Pose) -> Result<(), String> {
    let clip = options.clip.as_deref();
    let span = model.span(clip).map_err(|e| e.to_string())?;
    let Some(Window { open, close }) = window else {
        if model.is_list_of_keys() {
            say(&format!("the shutter is open over all {} files", model.frame_times().len()));
        }
        return Ok(());
    };
    let name =
        model.clip_name(clip).map_err(|e| e.to_string())?.map(|name| format!("clip {name}")).unwrap_or("clip".into());
    let (first, last) = span.unwrap_or_default();
    say(&format!(
        "{name} plays from {first:.4} s to {last:.4} s: the shutter is open from {open:.4} s to {close:.4} s, {} keys",
        options.keys.unwrap_or(KEYS)
    ));
    let still = |keys: &Vec<Vec<Vec3>>| keys.windows(2).all(|pair| pair[0] == pair[1]);
    let view =
        |camera: &Camera| camera.keys.windows(2).all(|pair| format!("{:?}", pair[0]) == format!("{:?}", pair[1]));
    if pose.parts.iter().all(|part| still(&part.keys)) && pose.camera.as_ref().is_none_or(view) {
        warn("nothing moves while the shutter is open");
    }
    Ok(())
}

/// The model's keys in a window; all frames if there is no window.
fn pose(options: &Options, model: &Model, window: Option<Window>) -> Result<Pose, String> {
    let clip = options.clip.as_deref();
    let times: Vec<f64> = match window {
        Some(Window { open, close }) => {
            let keys = options.keys.unwrap_or(KEYS);
            let step = (close - open) / f64::from(keys.max(2) - 1);
            (0..keys).map(|key| open + step * f64::from(key)).collect()
        }
        None => model.frame_times(),
    };
    model.pose(clip, &times).map_err(|e| e.to_string())
}

/// Turns a file's axes so that y points up.
fn upright(up: Axis, p: Vec3) -> Vec3 {
    match up {
        Axis::X => p.zxy(),
        Axis::Y => p,
        Axis::Z => p.yzx(),
    }
}

/// A posed model on a floor, in even light.
fn posed(options: &Options, pose: Pose, bounds: Bounds) -> Result<Stage, String> {
    let (mut meshes, mut surfaces) = (Vec::new(), Vec::new());
    for part in pose.parts {
        let keys: Vec<Vec<Vec3>> =
            part.keys.into_iter().map(|key| key.into_iter().map(|p| upright(options.up, p)).collect()).collect();
        let still = keys.windows(2).all(|pair| pair[0] == pair[1]);
        let keys = if still { keys.into_iter().take(1).collect() } else { keys };
        let normals = Some(Arc::new(Normals::new(&part.indices, &keys)));
        surfaces.push(Surface { normals, ..part.surface });
        meshes.push(TriangleMesh::new(part.indices, keys));
    }
    if !options.no_floor {
        meshes.push(floor(bounds));
        surfaces.push(Surface::plain(Vec3::new(0.30, 0.29, 0.28)));
    }
    let aspect = options.width as f32 / options.height as f32;
    let own = pose.camera.filter(|_| matches!(options.up, Axis::Y));
    if own.is_some() && (options.azimuth.is_some() || options.elevation.is_some()) {
        return Err("the file has a camera of its own: --azimuth and --elevation have no effect".into());
    }
    let (azimuth, elevation) = (options.azimuth.unwrap_or(30.0), options.elevation.unwrap_or(12.0));
    let camera = own.unwrap_or_else(|| frame_box(bounds, azimuth, elevation, aspect));
    let name = options.mesh[0].file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let sky = Sky::studio(Vec3::new(-0.55, 0.75, 0.55));
    Ok(Stage { name, things: Things::meshes(meshes, surfaces), camera, aperture: 0.0, focus: None, sky })
}

/// Two triangles under a box, extending far beyond its sides.
fn floor(bounds: Bounds) -> TriangleMesh {
    let middle = (bounds.min + bounds.max) * 0.5;
    let reach = 60.0 * (bounds.max - bounds.min).max_element().max(1e-6);
    let corner = |x: f32, z: f32| Vec3::new(middle.x + reach * x, bounds.min.y, middle.z + reach * z);
    let corners = vec![corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
    TriangleMesh::fixed(vec![[0, 1, 2], [0, 2, 3]], corners)
}

/// A procedural scene at its full size, at about the requested size, or small enough to be rendered quickly.
fn scene(options: &Options) -> Result<Stage, String> {
    let full = || mbkd_scenes::find(&options.scene).map_or(FLAKE, |recipe| recipe.full);
    let size = options.triangles.map(|count| match count {
        Count::Full => full(),
        Count::About(n) => n,
    });
    scene_of(&options.scene, size)
}

/// Spheres of the whole flake.
const FLAKE: usize = 66_430;

/// The scene with that name, with suitable light.
pub fn scene_of(name: &str, size: Option<usize>) -> Result<Stage, String> {
    let (things, camera) = if name == "flake" {
        let (spheres, camera) = flake(size.unwrap_or(FLAKE));
        (Things { spheres, ..Things::default() }, camera)
    } else {
        let recipe = mbkd_scenes::find(name).ok_or_else(|| format!("there is no scene `{name}`"))?;
        let scene = (recipe.make)(size.unwrap_or(recipe.full.min(700_000)));
        let surfaces = scene.looks.iter().map(Surface::of).collect();
        (Things::meshes(scene.meshes, surfaces), scene.camera)
    };
    let sky = match name {
        "hall" | "camera" => Sky::afternoon(Vec3::new(-0.55, 0.62, 0.22)),
        "coherent" => Sky::night(Vec3::new(-0.75, 0.45, 0.55)),
        "tornado" => Sky::afternoon(Vec3::new(-0.7, 0.6, 0.5)),
        _ => Sky::studio(Vec3::new(-0.5, 0.75, 0.6)),
    };
    Ok(Stage { name: name.into(), things, camera, aperture: 0.0, focus: None, sky })
}

/// Applies the options for camera and light.
fn adjust(stage: &mut Stage, options: &Options) {
    if let Some(keys) = &options.camera_keys {
        let view = stage.camera.view(0.0);
        stage.camera = keys.camera(view.up, view.height);
    }
    if let Some(degrees) = options.fov {
        for view in &mut stage.camera.keys {
            view.height = picture_height(f64::from(degrees).to_radians());
        }
    }
    stage.aperture = options.aperture.max(0.0);
    stage.focus = options.focus.filter(|f| *f > 0.0);
    if let Some(surround) = options.sky {
        let sky = match surround {
            Surround::Studio => Sky::studio,
            Surround::Afternoon => Sky::afternoon,
            Surround::Air => Sky::air,
            Surround::Night => Sky::night,
        };
        stage.sky = sky(stage.sky.to_sun);
    }
    if let Some(sun) = options.sun {
        stage.sky.to_sun = sun.normalize_or(Vec3::Y);
    }
    if let Some(radius) = options.sun_radius {
        stage.sky.sun_radius = radius.clamp(0.0, 10.0);
    }
    stage.sky.exposure *= options.exposure;
}

/// Height of the picture at distance 1 for a vertical angle in radians.
pub fn picture_height(angle: f64) -> f32 {
    let (c, s) = cos_sin_f64(angle / (2.0 * std::f64::consts::TAU));
    (2.0 * s / c.max(1e-6)) as f32
}

/// A camera that looks at a box from a direction (degrees around the vertical and above the horizon), from the least
/// distance at which all of it is visible.
fn frame_box(Bounds { min, max }: Bounds, azimuth: f32, elevation: f32, aspect: f32) -> Camera {
    let turn = |degrees: f32| cos_sin_f64(f64::from(degrees) / 360.0);
    let ((ca, sa), (ce, se)) = (turn(azimuth), turn(elevation));
    let towards = Vec3::new((sa * ce) as f32, se as f32, (ca * ce) as f32);
    let height = picture_height(32f64.to_radians());
    let target = (min + max) * 0.5;
    let mut view = mbkd_scenes::View::new(target + towards, target, height);
    if ce.abs() < 1e-3 {
        view.up = Vec3::NEG_Z;
    }
    let [right, up, forward] = view.axes(aspect);
    let mut distance: f32 = 1e-6;
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 1 { max[axis] } else { min[axis] };
        let p = Vec3::new(pick(0), pick(1), pick(2)) - target;
        // The distance of the eye at which this corner is just inside the picture, with a small margin.
        for edge in [right, up] {
            let reach = p.dot(edge.normalize_or_zero()).abs() * 1.05 / edge.length().max(1e-6);
            distance = distance.max(reach - p.dot(forward));
        }
    }
    view.position = target + towards * distance;
    Camera::fixed(view)
}
