//! From the command line to a stage: which things, in what light, seen from where.

use crate::materials::Surface;
use crate::options::{Count, Options};
use crate::sampling::cos_sin_f64;
use crate::sky::Sky;
use crate::stage::{Stage, Things};
use mbkd::glam::Vec3;
use mbkd::scene::{Camera, Look, flake};

/// The stage that the options describe.
pub fn stage(options: &Options) -> Result<Stage, String> {
    let mut stage = scene(options)?;
    adjust(&mut stage, options);
    Ok(stage)
}

/// A procedural scene.
fn scene(options: &Options) -> Result<Stage, String> {
    let name = options.scene.as_str();
    let size = |small: usize, full: usize| match options.triangles {
        None => small.min(full),
        Some(Count::Full) => full,
        Some(Count::About(n)) => n,
    };
    let (things, camera) = if name == "flake" {
        let (spheres, camera) = flake(size(66_430, 66_430));
        (Things::Spheres(spheres), camera)
    } else {
        let recipe = mbkd::scene::find(name).ok_or_else(|| format!("there is no scene `{name}`"))?;
        let small = if name == "hairball" { 700_000 } else { 300_000 };
        let scene = (recipe.make)(size(small, recipe.full));
        let surfaces = scene.looks.iter().map(|look: &Look| Surface::of(look)).collect();
        (Things::Meshes(scene.meshes, surfaces), scene.camera)
    };
    let sky = match name {
        "hall" | "camera" => Sky::afternoon(Vec3::new(-0.55, 0.62, 0.22)),
        "coherent" => Sky::night(Vec3::new(-0.75, 0.45, 0.55)),
        "tornado" => Sky::afternoon(Vec3::new(-0.7, 0.6, 0.5)),
        _ => Sky::studio(Vec3::new(-0.5, 0.75, 0.6)),
    };
    Ok(Stage { name: name.into(), things, camera, aperture: 0.0, focus: None, sky })
}

/// What the command line says about camera and light.
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

/// A camera that looks at a box from a direction (degrees around the vertical and above the horizon), from as
/// far as needed to see all of it.
pub fn frame_box(min: Vec3, max: Vec3, azimuth: f32, elevation: f32, aspect: f32) -> Camera {
    let turn = |degrees: f32| cos_sin_f64(f64::from(degrees) / 360.0);
    let ((ca, sa), (ce, se)) = (turn(azimuth), turn(elevation));
    let towards = Vec3::new((sa * ce) as f32, se as f32, (ca * ce) as f32);
    let height = picture_height(32f64.to_radians());
    let target = (min + max) * 0.5;
    let mut view = mbkd::scene::View::new(target + towards, target, height);
    if ce.abs() < 1e-3 {
        view.up = Vec3::NEG_Z;
    }
    let [right, up, forward] = view.axes(aspect);
    let mut distance: f32 = 1e-6;
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 1 { max[axis] } else { min[axis] };
        let p = Vec3::new(pick(0), pick(1), pick(2)) - target;
        // How far away the eye must be for this corner to lie just inside, with a margin of an eighth.
        for edge in [right, up] {
            let reach = p.dot(edge.normalize_or_zero()).abs() * 1.125 / edge.length().max(1e-6);
            distance = distance.max(reach - p.dot(forward));
        }
    }
    view.position = target + towards * distance;
    Camera::fixed(view)
}
