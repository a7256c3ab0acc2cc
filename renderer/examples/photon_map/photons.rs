//! Photons from the lamp into the room.
//!
//! Two kinds of paths, each traced on its own so that both are well sampled: those whose first surface is the glass
//! (they make the caustic), aimed at the sphere where it is at the photon's time; and the others, which make the
//! indirect light. A photon is stored at each matte surface it comes to, but for light that comes straight from the
//! lamp, which is sampled instead.

use crate::room::{EMITTED, Room, Surface, lamp_area, lamp_point, lifted, through_glass};
use mbkd::Ray;
use mbkd::glam::Vec3;
use mbkd::point::Photon;
use mbkd_renderer::sampling::{Sampler, cos_sin, frame};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Photons of one pass.
pub struct Photons {
    /// Those that came through the glass to the first matte surface.
    pub caustic: Vec<Photon<Vec3>>,
    /// All others.
    pub indirect: Vec<Photon<Vec3>>,
}

/// How many paths of either kind are begun in a pass.
#[derive(Clone, Copy, Debug)]
pub struct Paths {
    /// Aimed at the glass.
    pub glass: usize,
    /// In all directions.
    pub others: usize,
}

/// When photons leave the lamp.
#[derive(Clone, Copy, Debug)]
pub enum Times {
    /// Evenly over the shutter.
    Spread,
    /// All at this time.
    At(f32),
}

/// Surfaces after which a path ends in any case.
const LONGEST: usize = 12;

/// Traces the photons of a pass.
pub fn trace(room: &Room, paths: Paths, times: Times, seed: u64) -> Photons {
    let runs = 1024;
    let each = |kind: usize, count: usize| -> Vec<Vec<(bool, Photon<Vec3>)>> {
        (0..count.div_ceil(runs))
            .into_par_iter()
            .map(|run| {
                let mut stored = Vec::new();
                for i in run * runs..((run + 1) * runs).min(count) {
                    // A sequence over all photons of the pass: each is a sample of one and the same pixel.
                    let mut sampler = Sampler::new(seed, kind as u64, i as u32, count as u32);
                    one(room, kind == 0, count, times, &mut sampler, &mut stored);
                }
                stored
            })
            .collect()
    };
    let mut photons = Photons { caustic: Vec::new(), indirect: Vec::new() };
    for (caustic, photon) in each(0, paths.glass).into_iter().chain(each(1, paths.others)).flatten() {
        if caustic { photons.caustic.push(photon) } else { photons.indirect.push(photon) }
    }
    photons
}

/// One path; `stored` gets its photons, and whether they came through glass alone.
fn one(
    room: &Room,
    aimed: bool,
    count: usize,
    times: Times,
    sampler: &mut Sampler,
    stored: &mut Vec<(bool, Photon<Vec3>)>,
) {
    let time = match times {
        Times::Spread => sampler.unit(),
        Times::At(time) => {
            sampler.unit();
            time
        }
    };
    let from = lamp_point(sampler.square());
    let (mut dir, mut flux);
    if aimed {
        let (center, radius) = room.glass(time);
        let axis = center - from;
        let least = (1.0 - (radius * radius / axis.length_squared()).min(1.0)).sqrt();
        let place = sampler.square();
        let cosine = 1.0 - place.x * (1.0 - least);
        let (c, s) = cos_sin(place.y);
        let (u, v) = frame(axis.normalize());
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        dir = axis.normalize() * cosine + (u * c + v * s) * sine;
        flux = EMITTED * (lamp_area() * (-dir.y).max(0.0) * 2.0 * PI * (1.0 - least) / count as f32);
    } else {
        dir = sampler.cosine(Vec3::NEG_Y);
        flux = EMITTED * (lamp_area() * PI / count as f32);
    }
    let mut at = from - Vec3::Y * 1e-3;
    let (mut through_glass_only, mut first) = (true, true);
    for _ in 0..LONGEST {
        let Some(spot) = room.closest(&Ray::new(at, dir).at_time(time)) else { return };
        if first && aimed != (spot.surface == Surface::Glass) {
            return;
        }
        match spot.surface {
            Surface::Lamp => return,
            Surface::Glass => {
                dir = through_glass(dir, spot.normal, sampler.unit());
                at = lifted(spot.position, dir);
            }
            Surface::Matte(color) => {
                let normal = if spot.normal.dot(dir) > 0.0 { -spot.normal } else { spot.normal };
                if !first {
                    let photon = Photon::at_time(spot.position, normal, flux, time);
                    stored.push((aimed && through_glass_only, photon));
                }
                through_glass_only = false;
                let survives = color.max_element();
                if sampler.unit() >= survives {
                    return;
                }
                flux *= color / survives;
                dir = sampler.cosine(normal);
                at = lifted(spot.position, normal);
            }
        }
        first = false;
    }
}
