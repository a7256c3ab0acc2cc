//! The loop over tiles: parallel, interruptible, and with the same result for any number of threads.
//!
//! A pixel's samples depend only on its position, the seed and their numbers, and their sum is the same in any order.
//! Several passes over the picture take a part of the samples each, so that an interrupted picture is complete and
//! merely noisier; the first takes one sample of one pixel in sixteen, so that there is a preview at once.

use crate::film::{Film, Region, in_units};
use crate::integrator::{Paths, camera_ray, radiance};
use crate::sampling::{Sampler, z_order};
use crate::stage::Stage;
use crate::world::World;
use indicatif::ProgressBar;
use mbkd::Counters;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Edge of a tile in pixels.
const TILE: usize = 16;
/// Passes over the picture after the first sample.
const PASSES: u32 = 4;
/// Edge of the squares of which the first pass takes one pixel.
pub const SQUARE: usize = 4;

/// How to render a picture.
#[derive(Clone, Copy, Debug)]
pub struct Job {
    /// Pixels across.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples per pixel.
    pub samples: u32,
    /// Diffuse bounces after the first surface; 0 is ambient occlusion.
    pub bounces: u32,
    /// Whether light from mirrors stays sharp on other surfaces, at the price of specks.
    pub caustics: bool,
    /// The seed of the noise.
    pub seed: u64,
    /// The part of the shutter that is open.
    pub shutter: (f32, f32),
    /// The samples to take: from the first number to before the second.
    pub taken: (u32, u32),
    /// The pixels to render.
    pub region: Region,
}

/// Pixels and samples that are rendered together.
struct Pass {
    samples: Range<u32>,
    /// Whether the pass takes the first pixels of squares, or the others; `None` for all.
    firsts: Option<bool>,
}

impl Pass {
    fn takes(&self, x: usize, y: usize) -> bool {
        self.firsts.is_none_or(|firsts| firsts == (x.is_multiple_of(SQUARE) && y.is_multiple_of(SQUARE)))
    }
}

/// The cost of a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    /// Rays traced, of all kinds.
    pub rays: u64,
    /// Rays that were counted (those of every pixel's first sample).
    pub counted_rays: u64,
    /// The counters of those rays.
    pub counters: Counters,
}

impl Cost {
    fn add(&mut self, other: &Cost) {
        self.rays += other.rays;
        self.counted_rays += other.counted_rays;
        self.counters = self.counters + other.counters;
    }
}

impl Job {
    /// A whole picture with one bounce, over the whole shutter.
    pub fn new(width: usize, height: usize, samples: u32) -> Job {
        let region = Region { x: 0, y: 0, width, height };
        Job {
            width,
            height,
            samples,
            bounces: 1,
            caustics: false,
            seed: 0,
            shutter: (0.0, 1.0),
            taken: (0, samples),
            region,
        }
    }

    /// Number of steps that `render` reports to the progress bar.
    pub fn steps(&self) -> u64 {
        (self.tiles() * self.passes().len()) as u64
    }

    fn passes(&self) -> Vec<Pass> {
        let (begin, end) = self.taken;
        let rest = end.saturating_sub(begin + 1);
        let parts = PASSES.min(rest);
        let at = |part: u32| begin + 1 + (u64::from(rest) * u64::from(part) / u64::from(parts.max(1))) as u32;
        let first = |firsts: bool| Pass { samples: begin..end.min(begin + 1), firsts: Some(firsts) };
        let others = (0..parts).map(|part| Pass { samples: at(part)..at(part + 1), firsts: None });
        [first(true), first(false)].into_iter().chain(others).collect()
    }

    fn tiles(&self) -> usize {
        self.region.width.div_ceil(TILE) * self.region.height.div_ceil(TILE)
    }

    /// The columns and rows of the region that a tile covers.
    fn tile(&self, tile: usize) -> (Range<usize>, Range<usize>) {
        let across = self.region.width.div_ceil(TILE);
        let (x, y) = (tile % across * TILE, tile / across * TILE);
        (x..(x + TILE).min(self.region.width), y..(y + TILE).min(self.region.height))
    }

    /// The ray of one sample of a pixel, with the sampler for its further random numbers.
    pub fn ray(&self, stage: &Stage, x: usize, y: usize, sample: u32) -> (mbkd::Ray, Sampler) {
        let mut sampler = Sampler::new(self.seed, z_order(x as u32, y as u32), sample, self.samples);
        let time = sampler.time();
        let time = self.shutter.0 + (self.shutter.1 - self.shutter.0) * time;
        let place = sampler.square();
        let (u, v) = ((x as f32 + place.x) / self.width as f32, (y as f32 + place.y) / self.height as f32);
        let aspect = self.width as f32 / self.height as f32;
        (camera_ray(stage, u, v, aspect, time, &mut sampler), sampler)
    }
}

/// Renders until done or until `stop` is set; returns the film of the region with the samples taken so far.
pub fn render(world: &World, stage: &Stage, job: &Job, stop: &AtomicBool, bar: &ProgressBar) -> (Film, Cost) {
    let region = job.region;
    let film = Mutex::new((Film::new(region.width, region.height), Cost::default()));
    for pass in job.passes() {
        (0..job.tiles()).into_par_iter().for_each(|tile| {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            let (columns, rows) = job.tile(tile);
            let mut cost = Cost::default();
            let mut sums = Vec::with_capacity(TILE * TILE);
            for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))).filter(|&(x, y)| pass.takes(x, y)) {
                let at = (region.x + x, region.y + y);
                sums.push((y * region.width + x, pixel(world, stage, job, at, pass.samples.clone(), &mut cost)));
            }
            let (film, total) = &mut *film.lock().unwrap_or_else(|e| e.into_inner());
            for (at, sum) in sums {
                film.add_units(at, sum, pass.samples.len() as u32);
            }
            total.add(&cost);
            bar.inc(1);
        });
    }
    film.into_inner().unwrap_or_else(|e| e.into_inner())
}

/// The sum of some samples of a pixel, in the film's units.
fn pixel(
    world: &World,
    stage: &Stage,
    job: &Job,
    (x, y): (usize, usize),
    samples: Range<u32>,
    cost: &mut Cost,
) -> [i64; 3] {
    let mut sum = [0; 3];
    let paths = Paths { bounces: job.bounces, caustics: job.caustics };
    for sample in samples {
        let (ray, mut sampler) = job.ray(stage, x, y, sample);
        let (light, rays) = if sample == 0 {
            let traced = radiance(world, stage, ray, paths, &mut sampler, &mut cost.counters);
            cost.counted_rays += u64::from(traced.1);
            traced
        } else {
            radiance(world, stage, ray, paths, &mut sampler, &mut ())
        };
        let light = in_units(light);
        (0..3).for_each(|i| sum[i] += light[i]);
        cost.rays += u64::from(rays);
    }
    sum
}
