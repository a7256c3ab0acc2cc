//! Metals and glossy surfaces: microfacets, as defined by glTF 2.0 (appendix B of its specification).
//!
//! The picture: a surface is made of tiny mirrors ([`Mirrors`]); roughness determines how far they tilt. A metal tints
//! their reflection by its colour. Another surface shows a little of it in white, and reflects the rest diffusely in
//! its colour. Fresnel's term is Schlick's approximation (1994). Light between mirrors is not simulated: a single
//! reflection is scaled up by the lost energy (Turquin, "Practical multiple scattering compensation for microfacet
//! models", 2019), in full for white metals.

use crate::microfacets::Mirrors;
use crate::sampling::{Sampler, cosine, disk};
use mbkd::glam::Vec3;
use std::f32::consts::PI;

/// Reflectance of non-metals at normal incidence (a refractive index of 1.5).
const DIELECTRIC: f32 = 0.04;

/// A metallic or glossy surface at a point.
#[derive(Clone, Copy, Debug)]
pub struct Gloss {
    /// Reflectance of the mirrors at normal incidence.
    straight: Vec3,
    /// Diffuse reflectance for the light that the mirrors transmit.
    diffuse: Vec3,
    mirrors: Mirrors,
}

/// A sampled direction of incoming light.
#[derive(Clone, Copy, Debug)]
pub struct Scattered {
    /// Direction, of length 1.
    pub dir: Vec3,
    /// The reflected share of its light, divided by the density of the direction.
    pub share: Vec3,
    /// The spread of such directions: the tilt of the mirrors; 1 for diffuse reflection.
    pub spread: f32,
}

impl Gloss {
    /// From base colour, metallic part and roughness, all from 0 to 1.
    pub fn new(color: Vec3, metallic: f32, roughness: f32) -> Gloss {
        Gloss {
            straight: Vec3::splat(DIELECTRIC).lerp(color, metallic),
            diffuse: color * (1.0 - metallic),
            mirrors: Mirrors::new(roughness),
        }
    }

    /// The same surface with mirrors that tilt at least this far.
    pub fn leaning(self, least: f32) -> Gloss {
        Gloss { mirrors: self.mirrors.leaning(least), ..self }
    }

    /// The light reflected to the eye from a direction, relative to that of a white diffuse surface. All are unit
    /// vectors, with the light in front of the surface.
    pub fn reflects(&self, normal: Vec3, to_eye: Vec3, to_light: Vec3) -> Vec3 {
        let to_eye = in_front(to_eye, normal);
        let half = (to_eye + to_light).normalize_or(normal);
        let (eye, light, along) = (normal.dot(to_eye), normal.dot(to_light), normal.dot(half).clamp(0.0, 1.0));
        if light <= 0.0 {
            return Vec3::ZERO;
        }
        let mirrors = self.mirrored(to_eye.dot(half)) * self.mirrors.reflect(eye, light, along);
        mirrors * self.gain(eye) + self.diffuse * through(to_eye.dot(half))
    }

    /// Samples a direction of incoming light; `None` if the sampled mirror is hidden or everything is absorbed.
    pub fn scatter(&self, normal: Vec3, to_eye: Vec3, sampler: &mut Sampler) -> Option<Scattered> {
        let to_eye = in_front(to_eye, normal);
        let eye = normal.dot(to_eye);
        let part = self.part(eye);
        // The same numbers for both lobes, so that later numbers do not depend on the choice.
        let (choice, place) = (sampler.unit(), sampler.square());
        if choice < part {
            let half = self.mirrors.drawn(normal, to_eye, disk(place));
            let dir = half * (2.0 * to_eye.dot(half)) - to_eye;
            let light = normal.dot(dir);
            let share = self.mirrored(to_eye.dot(half)) * self.gain(eye) * (self.mirrors.seen(light) / part);
            (light > 0.0).then_some(Scattered { dir, share, spread: self.mirrors.lean() })
        } else if self.diffuse != Vec3::ZERO {
            let dir = cosine(normal, place);
            let half = (to_eye + dir).normalize_or(normal);
            let share = self.diffuse * (through(to_eye.dot(half)) / (1.0 - part));
            Some(Scattered { dir, share, spread: 1.0 })
        } else {
            None
        }
    }

    /// The density with which `scatter` samples a direction, per steradian. All are unit vectors.
    pub fn density(&self, normal: Vec3, to_eye: Vec3, to_light: Vec3) -> f32 {
        let to_eye = in_front(to_eye, normal);
        let half = (to_eye + to_light).normalize_or(normal);
        let (eye, light, along) = (normal.dot(to_eye), normal.dot(to_light), normal.dot(half).clamp(0.0, 1.0));
        let part = self.part(eye);
        if light > 0.0 { part * self.mirrors.density(eye, along) + (1.0 - part) * light / PI } else { 0.0 }
    }

    /// The probability of sampling the mirrors, for an eye at an angle of this cosine.
    fn part(&self, eye: f32) -> f32 {
        let (glossy, matte) = (sum(self.mirrored(eye)), sum(self.diffuse));
        glossy / (glossy + matte).max(f32::MIN_POSITIVE)
    }

    /// Reflectance of mirrors at an angle of incidence of this cosine.
    fn mirrored(&self, cosine: f32) -> Vec3 {
        self.straight + (Vec3::ONE - self.straight) * fifth(1.0 - cosine)
    }

    /// The ratio of all reflections to a single one, for an eye at an angle of this cosine.
    fn gain(&self, cosine: f32) -> Vec3 {
        let once = self.mirrors.once(cosine);
        Vec3::ONE + self.straight * ((1.0 - once) / once)
    }
}

/// The share of light that a non-metal transmits at an angle of this cosine.
fn through(cosine: f32) -> f32 {
    (1.0 - DIELECTRIC) * (1.0 - fifth(1.0 - cosine))
}

fn fifth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * x * x
}

fn sum(color: Vec3) -> f32 {
    color.x + color.y + color.z
}

/// The direction to the eye, moved in front of a surface whose shading normal faces away from it.
fn in_front(to_eye: Vec3, normal: Vec3) -> Vec3 {
    const LEAST: f32 = 0.01;
    let cosine = to_eye.dot(normal);
    if cosine >= LEAST { to_eye } else { (to_eye + normal * (LEAST - cosine)).normalize_or(normal) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mbkd_scenes::frame;

    const NORMAL: Vec3 = Vec3::new(0.36, -0.48, 0.8);

    /// Surfaces, and a direction to the eye at a small and a large angle.
    fn cases() -> impl Iterator<Item = (Gloss, Vec3)> {
        let (u, _) = frame(NORMAL);
        let color = Vec3::new(0.9, 0.5, 0.1);
        let surfaces = [(0.0, 0.3), (0.0, 1.0), (1.0, 0.4), (1.0, 1.0), (0.5, 0.6)];
        let eyes = [0.3, 1.5].map(|slope| (NORMAL + u * slope).normalize());
        surfaces.into_iter().flat_map(move |(m, r)| eyes.map(|eye| (Gloss::new(color, m, r), eye)))
    }

    #[test]
    fn sampled_directions_have_the_distribution_of_reflected_light() {
        let (u, _) = frame(NORMAL);
        // Any function of the direction has the same mean over sampled directions as over uniform ones.
        let seen = |dir: Vec3| 1.0 + 2.0 * dir.dot(u) + dir.dot(NORMAL);
        for (gloss, eye) in cases() {
            let (mut drawn, mut even) = (Vec3::ZERO, Vec3::ZERO);
            let (mut often, mut likely) = (0.0, 0.0);
            const SAMPLES: u32 = 1 << 16;
            for sample in 0..SAMPLES {
                let mut sampler = Sampler::new(5, 0, sample, SAMPLES);
                if let Some(Scattered { dir, share, .. }) = gloss.scatter(NORMAL, eye, &mut sampler) {
                    assert!((dir.length() - 1.0).abs() < 1e-4 && dir.dot(NORMAL) >= -1e-5);
                    drawn += share * (seen(dir) / SAMPLES as f32);
                    often += seen(dir) / SAMPLES as f32;
                }
                let dir = sampler.cosine(NORMAL);
                even += gloss.reflects(NORMAL, eye, dir) * (seen(dir) / SAMPLES as f32);
                likely += gloss.density(NORMAL, eye, dir) * PI / dir.dot(NORMAL).max(1e-6) * seen(dir) / SAMPLES as f32;
            }
            assert!((drawn - even).abs().max_element() < 0.02, "{gloss:?}: {drawn} and {even}");
            assert!((often - likely).abs() < 0.02, "{gloss:?}: {often} and {likely}");
        }
    }

    #[test]
    fn reflection_is_reciprocal_without_compensation_and_creates_no_energy() {
        for (gloss, eye) in cases() {
            let mut most = Vec3::ZERO;
            for sample in 0..4096 {
                let mut sampler = Sampler::new(2, 0, sample, 4096);
                let light = sampler.cosine(NORMAL);
                // The compensation depends on the eye alone: without it reflection is reciprocal.
                let once = |to_eye: Vec3, to_light: Vec3| {
                    let diffuse = gloss.diffuse * through(to_eye.dot((to_eye + to_light).normalize()));
                    (gloss.reflects(NORMAL, to_eye, to_light) - diffuse) / gloss.gain(NORMAL.dot(to_eye))
                };
                let [there, back] = [once(eye, light), once(light, eye)];
                let near =
                    light.dot(NORMAL) < 0.02 || (there - back).abs().max_element() <= 1e-3 * there.max_element() + 1e-5;
                assert!(near, "{gloss:?}: {there} and {back}");
                most += gloss.reflects(NORMAL, eye, light) / 4096.0;
            }
            assert!(most.max_element() < 1.01, "{gloss:?} reflects {most}");
        }
    }

    #[test]
    fn in_a_white_furnace_a_white_metal_is_white() {
        let (u, _) = frame(NORMAL);
        for (roughness, slope) in (0..=10).flat_map(|r| [0.0, 0.5, 1.5, 5.0].map(|slope| (0.1 * r as f32, slope))) {
            let (gloss, eye) = (Gloss::new(Vec3::ONE, 1.0, roughness), (NORMAL + u * slope).normalize());
            const SAMPLES: u32 = 1 << 13;
            let share = |sample: u32| {
                gloss.scatter(NORMAL, eye, &mut Sampler::new(9, 0, sample, SAMPLES)).map_or(0.0, |s| s.share.x)
            };
            let mean = (0..SAMPLES).map(share).sum::<f32>() / SAMPLES as f32;
            assert!((mean - 1.0).abs() < 0.01, "roughness {roughness}, slope {slope}: {mean}");
        }
    }
}
