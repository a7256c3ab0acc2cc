//! Passes over the picture: photons, maps, and samples of every pixel, by three methods for time.

use crate::photons::{Paths, Photons, Times, trace};
use crate::room::{EMITTED, Room, Spot, Surface, lifted, through_glass};
use crate::sequence::{Sample, time_of_pass};
use mbkd::Ray;
use mbkd::glam::{Vec2, Vec3};
use mbkd::point::{GatherParams, GatherQuery, Kernel, NeighborBuffer, PhotonMap, PointStructure};
use mbkd_renderer::film::Film;
use mbkd_renderer::sampling::Sampler;
use rayon::prelude::*;
use std::f32::consts::PI;
use std::time::{Duration, Instant};

/// The greatest radiance of the lamp as seen by the camera: it is white in the picture anyway, and its few samples at
/// edges and in the glass would cause more noise than the methods differ by. The reference has the same limit.
const WHITE: Vec3 = Vec3::splat(4.0);

/// Rows of pixels per task.
const BAND: usize = 8;

/// How the times of photons are treated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Photons are gathered in a window around the time of the camera ray; those of the caustic move with it.
    RayTime,
    /// Each pass has one time for all photons and all rays.
    OneTime,
    /// Photons of all times are gathered.
    Ignored,
}

/// The extent of a gather.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Radius of the disc.
    pub radius: f32,
    /// Half width of the window.
    pub window: f32,
    /// The number of photons that is enough: the disc is smaller where there are more.
    pub photons: usize,
}

/// Sizes of pictures, gathers and passes.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Pixels across.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Paths per pass.
    pub paths: Paths,
    /// Gathers of the caustic, for one sample per pixel.
    pub caustic: Reach,
    /// Gathers of indirect light.
    pub indirect: Reach,
    /// Whether discs and windows shrink with the number of samples.
    pub shrinks: bool,
    /// Samples per pixel and pass.
    pub samples: u32,
    /// The seed of the noise.
    pub seed: u64,
}

impl Settings {
    /// The extents of the gathers of a pass. With n samples per pixel radius and window are n to the power of -1/6 of
    /// those with one: error by noise and error by blur then both converge to zero (Knaus and Zwicker, "Progressive
    /// Photon Mapping: A Probabilistic Approach", 2011, with their parameter at 2/3).
    fn reaches(&self, method: Method, pass: u32) -> [Reach; 2] {
        let samples = ((pass + 1) * self.samples) as f32;
        let share = if self.shrinks { samples.powf(-1.0 / 6.0) } else { 1.0 };
        [self.caustic, self.indirect].map(|reach| Reach {
            radius: reach.radius * share,
            window: if method == Method::RayTime { reach.window * share } else { f32::INFINITY },
            ..reach
        })
    }
}

/// A picture in progress: all light, and the caustic alone.
#[derive(Clone)]
pub struct Pictures {
    /// Everything.
    pub all: Film,
    /// The caustic as the camera sees it without glass in between.
    pub caustic: Film,
    /// The number of passes so far.
    pub passes: u32,
    /// The time they took.
    pub spent: Duration,
}

impl Pictures {
    /// Black.
    pub fn new(settings: &Settings) -> Pictures {
        let film = Film::new(settings.width, settings.height);
        Pictures { all: film.clone(), caustic: film, passes: 0, spent: Duration::ZERO }
    }
}

/// The result of a camera ray: light on its path, and the first matte surface with its visible share.
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
pub fn camera_ray(room: &Room, settings: &Settings, pixel: usize, place: Vec2, time: f32) -> Ray {
    let (x, y) = (pixel % settings.width, pixel / settings.width);
    let (u, v) = ((x as f32 + place.x) / settings.width as f32, (y as f32 + place.y) / settings.height as f32);
    room.camera.ray(u, v, settings.width as f32 / settings.height as f32, time)
}

/// Renders one pass.
pub fn pass(room: &Room, settings: &Settings, method: Method, pictures: &mut Pictures) {
    let begin = Instant::now();
    let number = pictures.passes;
    let seed = settings.seed.wrapping_add(u64::from(number) << 20);
    let one_time = (method == Method::OneTime).then(|| time_of_pass(number));
    let times = match one_time {
        Some(time) => Times::At(time),
        None if method == Method::RayTime => Times::Carried,
        None => Times::Spread,
    };
    let photons = trace(room, settings.paths, times, seed);
    let reaches = settings.reaches(method, number);
    let maps = [(&photons.caustic, reaches[0]), (&photons.indirect, reaches[1])].map(|(photons, reach)| {
        // A linear structure: photons with velocities move linearly.
        let structure = PointStructure::Linear;
        let params = GatherParams { window: reach.window.min(1.0), structure, ..GatherParams::default() };
        PhotonMap::build(photons, &params).expect("traced photons are finite and in the shutter")
    });
    drop::<Photons>(photons);
    let samples = settings.samples;
    let pixels: Vec<usize> = (0..settings.width * settings.height).collect();
    let bands: Vec<Vec<[Vec3; 2]>> = pixels
        .par_chunks(BAND * settings.width)
        .map(|band| {
            let mut scratch = NeighborBuffer::new();
            let mut sums = vec![[Vec3::ZERO; 2]; band.len()];
            // All pixels at about the same time, then at another: their windows then share the same photons.
            for sample in 0..samples {
                for (sum, &pixel) in sums.iter_mut().zip(band) {
                    let sample = Sample::new(settings.seed, pixel, number * samples + sample);
                    let time = one_time.unwrap_or_else(|| sample.time(samples.ilog2()));
                    let light = radiance(room, settings, &reaches, &maps, (pixel, time), &sample, &mut scratch);
                    *sum = std::array::from_fn(|i| sum[i] + light[i]);
                }
            }
            sums
        })
        .collect();
    for (pixel, [all, caustic]) in bands.into_iter().flatten().enumerate() {
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
    reaches: &[Reach; 2],
    maps: &[PhotonMap<Vec3>; 2],
    (pixel, time): (usize, f32),
    sample: &Sample,
    scratch: &mut NeighborBuffer,
) -> [Vec3; 2] {
    let seen = look(room, camera_ray(room, settings, pixel, sample.place(), time), &mut sample.more());
    let Some((spot, color, behind_glass)) = seen.spot else { return [seen.light, Vec3::ZERO] };
    let direct = room.direct(&spot, color, time, sample.lamp());
    let gathered = reaches.map(|Reach { radius, window, photons }| {
        let query = GatherQuery::new(spot.position, spot.normal, time).nearest(photons).radius(radius).window(window);
        query.cosine(0.8).kernels(Kernel::Epanechnikov, Kernel::Box)
    });
    let light = |i: usize, scratch: &mut NeighborBuffer| {
        // The area is zero only if all photons coincide, which does not happen here and would contribute no light.
        maps[i].gather(&gathered[i], scratch).map_or(Vec3::ZERO, |found| found.density) * color / PI
    };
    let caustic = light(0, scratch);
    [direct + caustic + light(1, scratch), if behind_glass { Vec3::ZERO } else { caustic }]
}
