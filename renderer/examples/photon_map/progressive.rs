//! Stochastic progressive photon mapping with the inverse gather (Hachisuka and Jensen, 2009).
//!
//! Each round sends one ray through every pixel, at a time of its own. The visible points are kept for several passes
//! of photons; between these their radii shrink and the tree is refitted.

use crate::photons::{Times, trace};
use crate::picture::{Pictures, Settings, camera_ray, look};
use crate::room::Room;
use crate::sequence::Sample;
use mbkd::glam::Vec3;
use mbkd::point::{GatherParams, Kernel, PhotonTime, VisiblePoint, VisiblePoints};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Passes of photons per round.
const PASSES: u64 = 3;
/// The share of new photons that is kept: the smaller it is, the faster radii shrink.
const ALPHA: f32 = 2.0 / 3.0;

/// Radius and half window of the first round.
const FIRST: (f32, f32) = (0.09, 0.015);

/// The accumulated state of a pixel.
#[derive(Clone, Copy, Debug)]
struct Gathering {
    /// Radius of its points.
    radius: f32,
    /// Photons counted, after reduction.
    photons: f32,
    /// Flux within the radius, times reflectance.
    flux: Vec3,
    /// Number and flux of the photons of this pass.
    new: (u32, Vec3),
}

/// The state of all pixels.
pub struct Progressive {
    pixels: Vec<Gathering>,
    direct: Vec<Vec3>,
    rounds: u32,
    photon_passes: u64,
}

impl Progressive {
    /// An empty state.
    pub fn new(settings: &Settings) -> Progressive {
        let fresh = Gathering { radius: FIRST.0, photons: 0.0, flux: Vec3::ZERO, new: (0, Vec3::ZERO) };
        let pixels = settings.width * settings.height;
        Progressive { pixels: vec![fresh; pixels], direct: vec![Vec3::ZERO; pixels], rounds: 0, photon_passes: 0 }
    }

    /// One round.
    pub fn round(&mut self, room: &Room, settings: &Settings) {
        let window = FIRST.1 / (1.0 + self.rounds as f32).powf(1.0 / 6.0);
        let rounds = self.rounds;
        let seen: Vec<_> = (0..self.pixels.len())
            .into_par_iter()
            .map(|pixel| {
                let sample = Sample::new(settings.seed, pixel, rounds);
                let time = sample.time(0);
                let seen = look(room, camera_ray(room, settings, pixel, sample.place(), time), &mut sample.more());
                let direct = match &seen.spot {
                    Some((spot, color, _)) => room.direct(spot, *color, time, sample.lamp()),
                    None => seen.light,
                };
                (time, direct, seen.spot)
            })
            .collect();
        // Visible points, and the pixels they belong to.
        let (mut points, mut owners) = (Vec::new(), Vec::new());
        for (pixel, (time, direct, spot)) in seen.iter().enumerate() {
            self.direct[pixel] += *direct;
            if let Some((spot, color, _)) = spot {
                points.push(VisiblePoint { position: spot.position, time: *time, radius: self.pixels[pixel].radius });
                owners.push((pixel, spot.normal, *color, *time));
            }
        }
        let params = GatherParams { window, ..GatherParams::default() };
        let mut tree = VisiblePoints::build(&points, &params).expect("what is seen is finite and in the shutter");
        let mut states: Vec<_> = owners.iter().map(|&(pixel, ..)| self.pixels[pixel]).collect();
        // Paired with their index, so that photons can be tested against the normal of the point.
        let mut waiting: Vec<(usize, &mut Gathering)> = states.iter_mut().enumerate().collect();
        for _ in 0..PASSES {
            let photons = trace(room, settings.paths, Times::Spread, settings.seed ^ (self.photon_passes << 24));
            let all: Vec<_> = photons.caustic.into_iter().chain(photons.indirect).collect();
            let at = |photon: &mbkd::point::Photon<Vec3>| match photon.time {
                PhotonTime::At(time) | PhotonTime::Carried { time, .. } => (photon.position, time),
                PhotonTime::During(active) => (photon.position, active.begin()),
            };
            let deposit = |(point, state): &mut (usize, &mut Gathering), photon: &mbkd::point::Photon<Vec3>, _: f32| {
                let (_, normal, color, time) = owners[*point];
                if photon.normal.dot(normal) > 0.8 {
                    let seconds = Kernel::Box.over_time(time.into(), window.into(), 0.0, 1.0) as f32;
                    state.new.0 += 1;
                    state.new.1 += photon.flux * color / (PI * seconds);
                }
            };
            tree.scatter(&all, at, window, &mut waiting, deposit)
                .expect("traced photons are finite and in the shutter");
            self.photon_passes += 1;
            for (_, state) in &mut waiting {
                let (count, flux) = std::mem::take(&mut state.new);
                if count > 0 {
                    let kept = state.photons + ALPHA * count as f32;
                    let share = kept / (state.photons + count as f32);
                    state.radius *= share.sqrt();
                    state.flux = (state.flux + flux) * share;
                    state.photons = kept;
                }
            }
            let radii: Vec<f32> = waiting.iter().map(|(_, state)| state.radius).collect();
            tree.set_radii(&radii).expect("radii only shrink");
        }
        for (&(pixel, ..), state) in owners.iter().zip(&states) {
            self.pixels[pixel] = *state;
        }
        self.rounds += 1;
    }

    /// The picture so far.
    pub fn picture(&self, settings: &Settings) -> Pictures {
        let mut pictures = Pictures::new(settings);
        for (pixel, state) in self.pixels.iter().enumerate() {
            let area = PI * state.radius * state.radius * self.photon_passes.max(1) as f32;
            pictures.all.add(pixel, self.direct[pixel] / self.rounds.max(1) as f32 + state.flux / area, 1);
        }
        pictures.passes = self.rounds;
        pictures
    }
}
