//! Metals and glossy surfaces: microfacets, as glTF 2.0 has them (appendix B of its specification).
//!
//! The picture: a surface is made of tiny mirrors whose slopes have the GGX distribution; roughness says how far they lean
//! (Walter et al., "Microfacet models for refraction through rough surfaces", 2007). A metal shows what they reflect in its
//! own colour. Another surface shows a little of that in white, and the rest comes back diffuse in its colour. Fresnel's term is Schlick's
//! approximation (1994). Directions are drawn from the mirrors that are seen (Heitz, "Sampling the GGX distribution of visible
//! normals", 2018).

use crate::sampling::{Sampler, cosine, disk, frame};
use mbkd::glam::{Vec2, Vec3};

/// The least lean of the mirrors: smoother ones show the disk of the sun as noise.
const SMOOTHEST: f32 = 0.03;

/// What a surface that is no metal reflects at right angles (a refractive index of 1.5).
const DIELECTRIC: f32 = 0.04;

/// A metallic or glossy surface at a point.
#[derive(Clone, Copy, Debug)]
pub struct Gloss {
    /// What the mirrors reflect at right angles.
    straight: Vec3,
    /// What comes back diffuse of the light that they let through.
    diffuse: Vec3,
    /// How far they lean: the square of the roughness.
    lean: f32,
}

impl Gloss {
    /// Of base colour, metallic part and roughness, all from 0 to 1.
    pub fn new(color: Vec3, metallic: f32, roughness: f32) -> Gloss {
        Gloss {
            straight: Vec3::splat(DIELECTRIC).lerp(color, metallic),
            diffuse: color * (1.0 - metallic),
            lean: (roughness * roughness).max(SMOOTHEST),
        }
    }

    /// The light towards the eye of light from a direction, relative to what a white diffuse surface would show. All are unit
    /// vectors, the light in front of the surface.
    pub fn reflects(&self, normal: Vec3, to_eye: Vec3, to_light: Vec3) -> Vec3 {
        let to_eye = in_front(to_eye, normal);
        let half = (to_eye + to_light).normalize_or(normal);
        let (eye, light, along) = (normal.dot(to_eye), normal.dot(to_light), normal.dot(half).clamp(0.0, 1.0));
        if light <= 0.0 {
            return Vec3::ZERO;
        }
        let square = self.lean * self.lean;
        let spread = along * along * (square - 1.0) + 1.0;
        let mirrors = square / (spread * spread) * self.seen(eye) * self.seen(light) / (4.0 * eye * light);
        self.mirrored(to_eye.dot(half)) * mirrors + self.diffuse * through(to_eye.dot(half))
    }

    /// A direction in which light comes that goes to the eye, and how much of it does; none where the drawn mirror is
    /// hidden or everything is absorbed.
    pub fn scatter(&self, normal: Vec3, to_eye: Vec3, sampler: &mut Sampler) -> Option<(Vec3, Vec3)> {
        let to_eye = in_front(to_eye, normal);
        let (glossy, matte) = (sum(self.mirrored(normal.dot(to_eye))), sum(self.diffuse));
        let share = glossy / (glossy + matte);
        // The same numbers for both, so that what follows does not depend on the choice.
        let (choice, place) = (sampler.unit(), sampler.square());
        if choice < share {
            let half = self.mirror(normal, to_eye, disk(place));
            let dir = half * (2.0 * to_eye.dot(half)) - to_eye;
            let light = normal.dot(dir);
            (light > 0.0).then(|| (dir, self.mirrored(to_eye.dot(half)) * (self.seen(light) / share)))
        } else if matte > 0.0 {
            let dir = cosine(normal, place);
            let half = (to_eye + dir).normalize_or(normal);
            Some((dir, self.diffuse * (through(to_eye.dot(half)) / (1.0 - share))))
        } else {
            None
        }
    }

    /// What mirrors reflect that are met at an angle of this cosine.
    fn mirrored(&self, cosine: f32) -> Vec3 {
        self.straight + (Vec3::ONE - self.straight) * fifth(1.0 - cosine)
    }

    /// The share of the mirrors that is not hidden by others, seen at an angle of this cosine (Smith).
    fn seen(&self, cosine: f32) -> f32 {
        let square = self.lean * self.lean;
        2.0 * cosine / (cosine + (square + (1.0 - square) * cosine * cosine).sqrt())
    }

    /// The normal of a mirror that the eye sees, by a point of the unit disk.
    fn mirror(&self, normal: Vec3, to_eye: Vec3, disk: Vec2) -> Vec3 {
        let (u, v) = frame(normal);
        // As if the surface were stretched until mirrors lie on a hemisphere.
        let eye = Vec3::new(self.lean * u.dot(to_eye), self.lean * v.dot(to_eye), normal.dot(to_eye)).normalize();
        let across = Vec3::new(-eye.y, eye.x, 0.0).normalize_or(Vec3::X);
        let up = eye.cross(across);
        let s = 0.5 * (1.0 + eye.z);
        let y = (1.0 - s) * (1.0 - disk.x * disk.x).max(0.0).sqrt() + s * disk.y;
        let z = (1.0 - disk.x * disk.x - y * y).max(0.0).sqrt();
        let mirror = across * disk.x + up * y + eye * z;
        (u * (self.lean * mirror.x) + v * (self.lean * mirror.y) + normal * mirror.z.max(0.0)).normalize_or(normal)
    }
}

/// What a surface that is no metal lets through at an angle of this cosine.
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

/// The direction to the eye, in front of a surface whose shading normal leans away from it.
fn in_front(to_eye: Vec3, normal: Vec3) -> Vec3 {
    const LEAST: f32 = 0.01;
    let cosine = to_eye.dot(normal);
    if cosine >= LEAST { to_eye } else { (to_eye + normal * (LEAST - cosine)).normalize_or(normal) }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn directions_are_drawn_as_light_is_reflected() {
        let (u, _) = frame(NORMAL);
        // Any function of the direction has the same mean from drawn directions as from even ones.
        let seen = |dir: Vec3| 1.0 + 2.0 * dir.dot(u) + dir.dot(NORMAL);
        for (gloss, eye) in cases() {
            let (mut drawn, mut even) = (Vec3::ZERO, Vec3::ZERO);
            const SAMPLES: u32 = 1 << 16;
            for sample in 0..SAMPLES {
                let mut sampler = Sampler::new(5, 0, sample, SAMPLES);
                if let Some((dir, share)) = gloss.scatter(NORMAL, eye, &mut sampler) {
                    assert!((dir.length() - 1.0).abs() < 1e-4 && dir.dot(NORMAL) >= -1e-5);
                    drawn += share * (seen(dir) / SAMPLES as f32);
                }
                let dir = sampler.cosine(NORMAL);
                even += gloss.reflects(NORMAL, eye, dir) * (seen(dir) / SAMPLES as f32);
            }
            assert!((drawn - even).abs().max_element() < 0.02, "{gloss:?}: {drawn} and {even}");
        }
    }

    #[test]
    fn light_goes_both_ways_alike_and_none_is_made() {
        for (gloss, eye) in cases() {
            let mut most = Vec3::ZERO;
            for sample in 0..4096 {
                let mut sampler = Sampler::new(2, 0, sample, 4096);
                let light = sampler.cosine(NORMAL);
                let [there, back] = [gloss.reflects(NORMAL, eye, light), gloss.reflects(NORMAL, light, eye)];
                let near = light.dot(NORMAL) < 0.02 || (there - back).abs().max_element() <= 1e-3 * there.max_element();
                assert!(near, "{gloss:?}: {there} and {back}");
                most += there / 4096.0;
            }
            assert!(most.max_element() < 1.01, "{gloss:?} reflects {most}");
        }
    }
}
