//! Tracing photons from the lamp into the room.
//!
//! There are two kinds of paths, each traced separately so that both are well sampled: those whose first surface is the
//! glass (they make the caustic), aimed at the sphere at its position at the photon's time; and the others, which make
//! the indirect light. A photon is stored at each matte surface that a path reaches, except for light directly from the
//! lamp, which is sampled instead.
//!
//! A caustic moves with the glass. The velocity of a path's photon is found by tracing the same path, with the same
//! random numbers, a little later: a finite difference in time of the derivative in L. Schjøth, J. R. Frisvad, K.
//! Erleben and J. Sporring, "Temporal Photon Differentials" (2010). Such a photon is valid for a wide time window. If
//! the later path takes another route (at the rim of the glass, or of a wall), there is no velocity, and the photon is
//! static.

use crate::room::{EMITTED, Room, Surface, lamp_area, lamp_point, lifted, through_glass};
use mbkd::Ray;
use mbkd::glam::Vec3;
use mbkd::point::{Photon, PhotonTime};
use mbkd_renderer::sampling::{Sampler, cos_sin, mix};
use mbkd_scenes::frame;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Photons of one pass.
pub struct Photons {
    /// Those that reached their first matte surface through glass.
    pub caustic: Vec<Photon<Vec3>>,
    /// All others.
    pub indirect: Vec<Photon<Vec3>>,
}

/// The number of paths of each kind per pass.
#[derive(Clone, Copy, Debug)]
pub struct Paths {
    /// Aimed at the glass.
    pub glass: usize,
    /// In all directions.
    pub others: usize,
}

/// The times at which photons leave the lamp.
#[derive(Clone, Copy, Debug)]
pub enum Times {
    /// Uniform over the shutter.
    Spread,
    /// Uniform over the shutter, and photons of the caustic have velocities.
    Carried,
    /// All at this time.
    At(f32),
}

/// The greatest number of surfaces of a path.
const LONGEST: usize = 12;

/// The time step, as a part of the shutter, after which a path is traced again to find its velocity.
const STEP: f32 = 1.0 / 64.0;

/// Traces the photons of a pass.
pub fn trace(room: &Room, paths: Paths, times: Times, seed: u64) -> Photons {
    let runs = 1024;
    let power = EMITTED * (lamp_area() * PI / paths.others.max(1) as f32);
    let each = |aimed: bool, count: usize| -> Vec<Vec<(bool, Photon<Vec3>)>> {
        let source = Source { aimed, count, seed, power };
        (0..count.div_ceil(runs))
            .into_par_iter()
            .map(|run| {
                let (mut stored, mut arrivals, mut later) = (Vec::new(), Vec::new(), Vec::new());
                for i in run * runs..((run + 1) * runs).min(count) {
                    let time = if let Times::At(time) = times { time } else { source.sampler(i).unit() };
                    arrivals.clear();
                    follow(room, &source, i, time, &mut arrivals);
                    later.clear();
                    let step = if time < 0.5 { STEP } else { -STEP };
                    if matches!(times, Times::Carried) && arrivals.iter().any(|a| a.caustic) {
                        follow(room, &source, i, time + step, &mut later);
                    }
                    stored.extend(arrivals.iter().enumerate().map(|(n, a)| {
                        let velocity = if a.caustic { a.velocity(later.get(n), step) } else { None };
                        (a.caustic, a.photon(time, velocity))
                    }));
                }
                stored
            })
            .collect()
    };
    let mut photons = Photons { caustic: Vec::new(), indirect: Vec::new() };
    for (caustic, photon) in each(true, paths.glass).into_iter().chain(each(false, paths.others)).flatten() {
        if caustic { photons.caustic.push(photon) } else { photons.indirect.push(photon) }
    }
    photons
}

/// The source of the paths of one kind.
struct Source {
    aimed: bool,
    count: usize,
    seed: u64,
    /// Flux of a photon that is not aimed.
    power: Vec3,
}

impl Source {
    /// One sequence over all photons of the pass: each is a sample of one and the same pixel.
    fn sampler(&self, path: usize) -> Sampler {
        Sampler::new(self.seed, u64::from(!self.aimed), path as u32, self.count as u32)
    }
}

/// A path at a matte surface.
struct Arrival {
    position: Vec3,
    normal: Vec3,
    flux: Vec3,
    /// Whether it passed through glass only.
    caustic: bool,
    /// A hash of all surfaces it met and of its choices there.
    way: u64,
}

impl Arrival {
    /// Its velocity, given the same path's arrival at a time `step` later; `None` if that one took another route.
    fn velocity(&self, later: Option<&Arrival>, step: f32) -> Option<Vec3> {
        let later = later.filter(|later| later.way == self.way)?;
        Some((later.position - self.position) / step)
    }

    fn photon(&self, time: f32, velocity: Option<Vec3>) -> Photon<Vec3> {
        let time = match velocity {
            Some(velocity) => PhotonTime::Carried { time, velocity },
            None => PhotonTime::At(time),
        };
        Photon { position: self.position, normal: self.normal, flux: self.flux, time }
    }
}

/// Traces a path at a time: with the same random numbers for every time.
fn follow(room: &Room, source: &Source, path: usize, time: f32, arrivals: &mut Vec<Arrival>) {
    let (aimed, count) = (source.aimed, source.count);
    let mut sampler = source.sampler(path);
    sampler.unit();
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
    let (mut caustic, mut first, mut way) = (aimed, true, 0);
    for _ in 0..LONGEST {
        let Some(spot) = room.closest(&Ray::new(at, dir).at_time(time)) else { return };
        if first && aimed != (spot.surface == Surface::Glass) {
            return;
        }
        way = mix(way, spot.body.into());
        match spot.surface {
            Surface::Lamp => return,
            Surface::Glass => {
                let enters = dir.dot(spot.normal) < 0.0;
                dir = through_glass(dir, spot.normal, sampler.unit());
                way = mix(way, u64::from(enters == (dir.dot(spot.normal) < 0.0)));
                at = lifted(spot.position, dir);
            }
            Surface::Matte(color) => {
                let normal = if spot.normal.dot(dir) > 0.0 { -spot.normal } else { spot.normal };
                if !first {
                    arrivals.push(Arrival { position: spot.position, normal, flux, caustic, way });
                }
                // Photons of the caustic are many and weak. Russian roulette continues few of them, as strong as all
                // others.
                let few = if caustic { (flux / source.power).max_element().min(1.0) } else { 1.0 };
                let survives = color.max_element() * few;
                if sampler.unit() >= survives {
                    return;
                }
                flux *= color / survives;
                caustic = false;
                dir = sampler.cosine(normal);
                at = lifted(spot.position, normal);
            }
        }
        first = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photons_of_the_caustic_move_with_their_paths() {
        let room = Room::new(1.0).unwrap();
        let source = Source { aimed: true, count: 4000, seed: 3, power: Vec3::ONE };
        let first = |path: usize, time: f32| -> Option<Arrival> {
            let mut arrivals = Vec::new();
            follow(&room, &source, path, time, &mut arrivals);
            arrivals.into_iter().next()
        };
        let (time, wide) = (0.4, 0.1);
        let (mut paths, mut moving, mut near) = (0, 0, 0);
        for path in 0..source.count {
            let Some(now) = first(path, time) else { continue };
            paths += 1;
            let Some(velocity) = now.velocity(first(path, time + STEP).as_ref(), STEP) else { continue };
            moving += 1;
            let Some(then) = first(path, time + wide) else { continue };
            near += u32::from((now.position + velocity * wide).distance(then.position) < 0.02);
        }
        // The sphere moves 0.15 in this time, the caustic 0.23.
        assert!(paths > 3900 && moving > paths * 99 / 100 && near > moving * 95 / 100, "{paths} {moving} {near}");
    }
}
