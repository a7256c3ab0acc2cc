//! Passes over the picture: photons, maps, and a sample of every pixel. Three ways to treat time.

use crate::photons::{Paths, Photons, Times, trace};
use crate::room::{EMITTED, Room, Spot, Surface, lifted, through_glass};
use mbkd::Ray;
use mbkd::glam::Vec3;
use mbkd::point::{GatherParams, GatherQuery, GatherScratch, Kernel, PhotonMap};
use mbkd_renderer::film::Film;
use mbkd_renderer::sampling::Sampler;
use rayon::prelude::*;
use std::f32::consts::PI;
use std::time::{Duration, Instant};

/// What a camera sees of the lamp, at most: it is white in the picture anyway, and its few samples at edges and in the
/// glass would make more noise than all that is compared here. The reference has the same limit.
const WHITE: Vec3 = Vec3::splat(4.0);

/// What is done about the times of photons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Photons are gathered through a window around the time of the camera's ray.
    RayTime,
    /// Each pass has one time for all photons and all rays.
    OneTime,
    /// Photons of all times are gathered.
    Ignored,
}

/// Sizes of gathers and passes.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Pixels across.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Paths per pass.
    pub paths: Paths,
    /// Radius and half window of gathers of the caustic.
    pub caustic: (f32, f32),
    /// The same of indirect light.
    pub indirect: (f32, f32),
    /// Samples per pixel and pass where rays may have times of their own.
    pub samples: u32,
    /// Other noise.
    pub seed: u64,
}

/// A picture in the making: all light, and the caustic alone.
#[derive(Clone)]
pub struct Pictures {
    /// Everything.
    pub all: Film,
    /// The caustic as the camera sees it without glass between.
    pub caustic: Film,
    /// Passes so far.
    pub passes: u32,
    /// What they took.
    pub spent: Duration,
}

impl Pictures {
    /// Black.
    pub fn new(settings: &Settings) -> Pictures {
        let film = Film::new(settings.width, settings.height);
        Pictures { all: film.clone(), caustic: film, passes: 0, spent: Duration::ZERO }
    }
}

/// What a camera ray comes to: light on the way, and the first matte surface with the share of it that is seen.
pub struct Seen {
    /// Light of the lamp.
    pub light: Vec3,
    /// The surface, its colour, and whether there was glass before.
    pub spot: Option<(Spot, Vec3, bool)>,
}

/// Follows a camera ray through glass.
pub fn look(room: &Room, mut ray: Ray, sampler: &mut Sampler) -> Seen {
    ray.dir = ray.dir.normalize();
    for depth in 0..10 {
        let Some(spot) = room.closest(&ray) else { break };
        match spot.surface {
            Surface::Lamp => return Seen { light: EMITTED.min(WHITE), spot: None },
            Surface::Matte(color) => {
                let normal = if spot.normal.dot(ray.dir) > 0.0 { -spot.normal } else { spot.normal };
                return Seen { light: Vec3::ZERO, spot: Some((Spot { normal, ..spot }, color, depth > 0)) };
            }
            Surface::Glass => {
                let dir = through_glass(ray.dir, spot.normal, sampler.unit());
                ray = Ray::new(lifted(spot.position, dir), dir).at_time(ray.time);
            }
        }
    }
    Seen { light: Vec3::ZERO, spot: None }
}

/// The camera ray of a sample of a pixel.
pub fn camera_ray(room: &Room, settings: &Settings, pixel: usize, time: f32, sampler: &mut Sampler) -> Ray {
    let (x, y) = (pixel % settings.width, pixel / settings.width);
    let place = sampler.square();
    let (u, v) = ((x as f32 + place.x) / settings.width as f32, (y as f32 + place.y) / settings.height as f32);
    room.camera.ray(u, v, settings.width as f32 / settings.height as f32, time)
}

/// A time for pass `pass` that fills the shutter evenly, however many passes there will be (van der Corput).
pub fn time_of_pass(pass: u32) -> f32 {
    pass.wrapping_add(1).reverse_bits() as f32 / (1u64 << 32) as f32 * (1.0 - f32::EPSILON)
}

/// One pass.
pub fn pass(room: &Room, settings: &Settings, method: Method, pictures: &mut Pictures) {
    let begin = Instant::now();
    let number = pictures.passes;
    let seed = settings.seed.wrapping_add(u64::from(number) << 20);
    let one_time = (method == Method::OneTime).then(|| time_of_pass(number));
    let photons = trace(room, settings.paths, one_time.map_or(Times::Spread, Times::At), seed);
    let maps =
        [(&photons.caustic, settings.caustic), (&photons.indirect, settings.indirect)].map(|(photons, (_, w))| {
            let params =
                GatherParams { window: if method == Method::RayTime { w } else { 1.0 }, ..GatherParams::default() };
            PhotonMap::build(photons, &params).expect("traced photons are finite and in the shutter")
        });
    drop::<Photons>(photons);
    let samples = if method == Method::OneTime { 1 } else { settings.samples };
    let pixels: Vec<usize> = (0..settings.width * settings.height).collect();
    let rows: Vec<Vec<[Vec3; 2]>> = pixels
        .par_chunks(settings.width)
        .map(|row| {
            let mut scratch = GatherScratch::new();
            row.iter()
                .map(|&pixel| {
                    let mut sum = [Vec3::ZERO; 2];
                    for sample in 0..samples {
                        // As many samples as there may ever be: the sequence goes on from pass to pass.
                        let mut sampler = Sampler::new(settings.seed, pixel as u64, number * samples + sample, 1 << 20);
                        let own = sampler.unit();
                        let time = one_time.unwrap_or(own);
                        let light = radiance(room, settings, method, &maps, (pixel, time), &mut sampler, &mut scratch);
                        sum = [sum[0] + light[0], sum[1] + light[1]];
                    }
                    sum
                })
                .collect()
        })
        .collect();
    for (pixel, [all, caustic]) in rows.into_iter().flatten().enumerate() {
        for (film, light) in [(&mut pictures.all, all), (&mut pictures.caustic, caustic)] {
            film.add(pixel, light, samples);
        }
    }
    pictures.passes += 1;
    pictures.spent += begin.elapsed();
}

/// All light along a camera ray, and that of the caustic.
fn radiance(
    room: &Room,
    settings: &Settings,
    method: Method,
    maps: &[PhotonMap<Vec3>; 2],
    (pixel, time): (usize, f32),
    sampler: &mut Sampler,
    scratch: &mut GatherScratch,
) -> [Vec3; 2] {
    let seen = look(room, camera_ray(room, settings, pixel, time, sampler), sampler);
    let Some((spot, color, behind_glass)) = seen.spot else { return [seen.light, Vec3::ZERO] };
    let direct = room.direct(&spot, color, time, sampler.square());
    let gathered = [settings.caustic, settings.indirect].map(|(radius, window)| {
        let window = if method == Method::RayTime { window } else { f32::INFINITY };
        let query = GatherQuery::new(spot.position, spot.normal, time).nearest(80).radius(radius).window(window);
        query.cosine(0.8).thickness(0.25 * radius).kernels(Kernel::Epanechnikov, Kernel::Box)
    });
    let light = |i: usize, scratch: &mut GatherScratch| {
        // No area: all photons in one place, which does not happen here and would be no light.
        maps[i].gather(&gathered[i], scratch).map_or(Vec3::ZERO, |found| found.density) * color / PI
    };
    let caustic = light(0, scratch);
    [direct + caustic + light(1, scratch), if behind_glass { Vec3::ZERO } else { caustic }]
}
