//! The loop over tiles: parallel, interruptible, and with the same result for any number of threads.
//!
//! A pixel's samples depend on its number and the seed alone, and are added in order by whoever works on its
//! tile. Several passes over the picture take a part of the samples each, so that an interrupted picture is
//! complete and merely noisier.

use crate::film::Film;
use crate::integrator::{camera_ray, radiance};
use crate::sampling::Sampler;
use crate::stage::Stage;
use crate::world::World;
use indicatif::ProgressBar;
use mbkd::Counters;
use mbkd::glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Edge of a tile in pixels.
const TILE: usize = 16;
/// Passes over the picture.
const PASSES: u32 = 4;

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
    /// Another seed, other noise.
    pub seed: u64,
    /// The part of the shutter that is open.
    pub shutter: (f32, f32),
}

/// What a picture cost.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    /// Rays traced, of all kinds.
    pub rays: u64,
    /// Rays that were counted (those of every pixel's first sample).
    pub counted_rays: u64,
    /// What those did.
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
    /// Number of steps that `render` reports to the progress bar.
    pub fn steps(&self) -> u64 {
        (self.tiles() as u64) * u64::from(PASSES.min(self.samples))
    }

    fn tiles(&self) -> usize {
        self.width.div_ceil(TILE) * self.height.div_ceil(TILE)
    }

    /// The pixels of a tile: columns and rows.
    fn tile(&self, tile: usize) -> (Range<usize>, Range<usize>) {
        let across = self.width.div_ceil(TILE);
        let (x, y) = (tile % across * TILE, tile / across * TILE);
        (x..(x + TILE).min(self.width), y..(y + TILE).min(self.height))
    }

    /// The ray of one sample of a pixel, with what is left of its random numbers.
    pub fn ray(&self, stage: &Stage, x: usize, y: usize, sample: u32) -> (mbkd::Ray, Sampler) {
        let pixel = (y * self.width + x) as u64;
        let mut sampler = Sampler::new(self.seed, pixel, sample, self.samples);
        let time = sampler.time();
        let time = self.shutter.0 + (self.shutter.1 - self.shutter.0) * time;
        let place = sampler.square();
        let (u, v) = ((x as f32 + place.x) / self.width as f32, (y as f32 + place.y) / self.height as f32);
        let aspect = self.width as f32 / self.height as f32;
        (camera_ray(stage, u, v, aspect, time, &mut sampler), sampler)
    }
}

/// Renders until done or until `stop` is set; what is done by then is in the film.
pub fn render(world: &World, stage: &Stage, job: &Job, stop: &AtomicBool, bar: &ProgressBar) -> (Film, Cost) {
    let film = Mutex::new((Film::new(job.width, job.height), Cost::default()));
    let passes = PASSES.min(job.samples);
    for pass in 0..passes {
        let samples = job.samples * pass / passes..job.samples * (pass + 1) / passes;
        (0..job.tiles()).into_par_iter().for_each(|tile| {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            let (columns, rows) = job.tile(tile);
            let mut cost = Cost::default();
            let mut sums = Vec::with_capacity(TILE * TILE);
            for y in rows.clone() {
                for x in columns.clone() {
                    sums.push(pixel(world, stage, job, (x, y), samples.clone(), &mut cost));
                }
            }
            let mut sums = sums.into_iter();
            let (film, total) = &mut *film.lock().unwrap_or_else(|e| e.into_inner());
            for y in rows {
                for x in columns.clone() {
                    let at = y * job.width + x;
                    film.sums[at] += sums.next().unwrap_or(Vec3::ZERO);
                    film.samples[at] += samples.len() as u32;
                }
            }
            total.add(&cost);
            bar.inc(1);
        });
    }
    film.into_inner().unwrap_or_else(|e| e.into_inner())
}

/// The sum of some samples of a pixel.
fn pixel(
    world: &World,
    stage: &Stage,
    job: &Job,
    (x, y): (usize, usize),
    samples: Range<u32>,
    cost: &mut Cost,
) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for sample in samples {
        let (ray, mut sampler) = job.ray(stage, x, y, sample);
        let (light, rays) = if sample == 0 {
            let traced = radiance(world, stage, ray, job.bounces, &mut sampler, &mut cost.counters);
            cost.counted_rays += u64::from(traced.1);
            traced
        } else {
            radiance(world, stage, ray, job.bounces, &mut sampler, &mut ())
        };
        sum += light;
        cost.rays += u64::from(rays);
    }
    sum
}
