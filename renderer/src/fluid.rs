//! Pictures of a fluid made of drops in a tank, for programs that simulate one: see the example `particles`.

use crate::animation::Animation;
use crate::film::Picture;
use crate::font;
use crate::materials::Surface;
use crate::render::{Job, render};
use crate::sky::Sky;
use crate::stage::{Stage, Things};
use crate::world::World;
use indicatif::ProgressBar;
use mbkd::glam::Vec3;
use mbkd::{BuildParams, TriangleMesh};
use mbkd_scenes::{Camera, FlakeSphere, View};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// A drop at the middle of the shutter interval.
#[derive(Clone, Copy, Debug)]
pub struct Drop {
    /// Its center.
    pub at: Vec3,
    /// Its displacement while the shutter is open.
    pub way: Vec3,
    /// Its colour, linear.
    pub color: Vec3,
}

/// A tank that stands on a table, and boxes in it; y is up.
#[derive(Clone, Debug)]
pub struct Tank {
    /// Lower and upper corner of the inside.
    pub inside: [Vec3; 2],
    /// Lower and upper corners of solid boxes.
    pub solids: Vec<[Vec3; 2]>,
}

/// The size and quality of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Shot {
    /// Pixels across.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples per pixel.
    pub samples: u32,
}

/// Renders drops with this radius.
pub fn expose(drops: &[Drop], radius: f32, tank: &Tank, shot: Shot) -> Result<Photo, String> {
    let sphere = |(number, drop): (usize, &Drop)| FlakeSphere {
        centers: [drop.at - drop.way * 0.5, drop.at, drop.at + drop.way * 0.5],
        radius,
        level: number as u32,
    };
    let spheres = drops.iter().enumerate().map(sphere).collect();
    let (meshes, surfaces) = furniture(tank);
    let things = Things { meshes, surfaces, spheres, colors: drops.iter().map(|drop| drop.color).collect() };
    let stage = Stage {
        name: "fluid".into(),
        things,
        camera: camera(tank),
        aperture: 0.0,
        focus: None,
        sky: Sky { sun_radius: 0.08, exposure: 0.72, ..Sky::studio(Vec3::new(-0.5, 1.0, 0.65)) },
    };
    let job = Job { seed: 1, ..Job::new(shot.width, shot.height, shot.samples) };
    let world = World::build(&stage.things, &BuildParams::default()).map_err(|e| e.to_string())?;
    let (film, _) = render(&world, &stage, &job, &AtomicBool::new(false), &ProgressBar::hidden());
    Ok(Photo(film.developed(stage.sky.exposure)))
}

/// A rendered picture.
#[derive(Clone)]
pub struct Photo(Picture);

impl Photo {
    /// Writes a PNG.
    pub fn save(&self, path: &Path) -> Result<(), String> {
        self.0.save(path)
    }

    /// Writes a line into the lower left corner.
    pub fn caption(&mut self, line: &str) {
        let scale = (self.0.height / 180).max(1);
        let y = self.0.height.saturating_sub((font::HEIGHT + 5) * scale);
        font::write(&mut self.0, line, 5 * scale, y, scale, [40, 44, 52]);
    }
}

/// Pictures side by side in rows of `across`, all of the size of the first.
pub fn strip(photos: &[Photo], across: usize) -> Option<Photo> {
    const GAP: usize = 4;
    let Photo(first) = photos.first()?;
    let across = across.clamp(1, photos.len());
    let (width, height) = (first.width + GAP, first.height + GAP);
    let rows = photos.len().div_ceil(across);
    let mut strip = Picture::filled(across * width - GAP, rows * height - GAP, [255; 3]);
    for (i, Photo(photo)) in photos.iter().enumerate() {
        strip.paste(photo, i % across * width, i / across * height);
    }
    Some(Photo(strip))
}

/// Writes an animated GIF.
pub fn gif(photos: &[Photo], path: PathBuf, seconds_per_frame: f64) -> Result<(), String> {
    let mut animation = Animation::begin(path, seconds_per_frame);
    photos.iter().try_for_each(|Photo(photo)| animation.add(photo))?;
    animation.end()
}

/// From the front, slightly above and from the right.
fn camera(tank: &Tank) -> Camera {
    let [low, high] = tank.inside;
    let (size, middle) = (high - low, (low + high) * 0.5);
    let target = Vec3::new(middle.x, low.y + 0.36 * size.y, middle.z);
    let far = 1.02 * size.x.max(1.6 * size.y) + 0.5 * size.z;
    Camera::fixed(View::new(target + Vec3::new(0.30, 0.42, 0.95).normalize() * (1.14 * far), target, 0.62))
}

/// The table, the floor and the far walls of the tank, and the obstacles in it.
fn furniture(tank: &Tank) -> (Vec<TriangleMesh>, Vec<Surface>) {
    let [low, high] = tank.inside;
    let size = high - low;
    let wall = 0.012 * size.max_element();
    let table = low.y - wall;
    let far = 40.0 * size.max_element();
    let mut boxes = vec![
        ([Vec3::new(-far, table - 1.0, -far), Vec3::new(far, table, far)], Vec3::new(0.46, 0.45, 0.43)),
        ([Vec3::new(low.x - wall, table, low.z - wall), Vec3::new(high.x + wall, low.y, high.z + wall)], FRAME),
        ([Vec3::new(low.x - wall, low.y, low.z - wall), Vec3::new(high.x + wall, high.y, low.z)], WALL),
        ([Vec3::new(low.x - wall, low.y, low.z), Vec3::new(low.x, high.y, high.z)], WALL),
    ];
    boxes.extend(tank.solids.iter().map(|&solid| (solid, Vec3::new(0.72, 0.36, 0.12))));
    boxes.into_iter().map(|([low, high], color)| (solid_box(low, high), Surface::plain(color))).unzip()
}

const WALL: Vec3 = Vec3::new(0.40, 0.43, 0.47);
const FRAME: Vec3 = Vec3::new(0.30, 0.31, 0.33);

fn solid_box(low: Vec3, high: Vec3) -> TriangleMesh {
    let corner = |i: usize| Vec3::select(mbkd::glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0), high, low);
    let faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let indices = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriangleMesh::new(indices, vec![(0..8).map(corner).collect::<Vec<Vec3>>()])
}
