//! The tiny mirrors of a metal or a coat: their tilt, visibility and reflection.
//!
//! Their slopes have the GGX distribution (Walter et al., "Microfacet models for refraction through rough surfaces",
//! 2007). Directions are sampled from the visible mirrors (Heitz, "Sampling the GGX distribution of visible normals",
//! 2018).

use crate::sampling::disk;
use mbkd::glam::{Vec2, Vec3};
use mbkd_scenes::frame;
use std::f32::consts::PI;
use std::sync::LazyLock;

/// The least tilt: smoother mirrors show the disk of the sun as noise.
const SMOOTHEST: f32 = 0.03;

/// The mirrors of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Mirrors {
    /// Their tilt: the square of the roughness.
    lean: f32,
}

impl Mirrors {
    /// Mirrors of a roughness from 0 to 1.
    pub fn new(roughness: f32) -> Mirrors {
        Mirrors { lean: (roughness * roughness).max(SMOOTHEST) }
    }

    /// Their tilt, at most 1.
    pub fn lean(self) -> f32 {
        self.lean
    }

    /// The same mirrors with at least this tilt.
    pub fn leaning(self, least: f32) -> Mirrors {
        Mirrors { lean: self.lean.max(least) }
    }

    /// The light from one direction reflected to another by perfect mirrors, relative to a white diffuse surface, given
    /// the cosines of the two directions and of the half vector with the normal.
    pub fn reflect(self, eye: f32, light: f32, along: f32) -> f32 {
        self.leaned(along) * self.seen(eye) * self.seen(light) / (4.0 * eye * light)
    }

    /// The density of mirrors with a normal of this cosine, relative to a uniform distribution.
    fn leaned(self, along: f32) -> f32 {
        let square = self.lean * self.lean;
        let spread = along * along * (square - 1.0) + 1.0;
        square / (spread * spread)
    }

    /// The share of the mirrors that is not hidden by others, at an angle of this cosine (Smith).
    pub fn seen(self, cosine: f32) -> f32 {
        let square = self.lean * self.lean;
        2.0 * cosine / (cosine + (square + (1.0 - square) * cosine * cosine).sqrt())
    }

    /// The normal of a visible mirror, sampled by a point of the unit disk.
    pub fn drawn(self, normal: Vec3, to_eye: Vec3, disk: Vec2) -> Vec3 {
        let (u, v) = frame(normal);
        // Stretch the surface until the mirrors form a hemisphere.
        let eye = Vec3::new(self.lean * u.dot(to_eye), self.lean * v.dot(to_eye), normal.dot(to_eye)).normalize();
        let across = Vec3::new(-eye.y, eye.x, 0.0).normalize_or(Vec3::X);
        let up = eye.cross(across);
        let s = 0.5 * (1.0 + eye.z);
        let y = (1.0 - s) * (1.0 - disk.x * disk.x).max(0.0).sqrt() + s * disk.y;
        let z = (1.0 - disk.x * disk.x - y * y).max(0.0).sqrt();
        let mirror = across * disk.x + up * y + eye * z;
        (u * (self.lean * mirror.x) + v * (self.lean * mirror.y) + normal * mirror.z.max(0.0)).normalize_or(normal)
    }

    /// The density of directions reflected by [`Mirrors::drawn`] mirrors, per steradian, given the cosines of the eye
    /// and of the half vector with the normal.
    pub fn density(self, eye: f32, along: f32) -> f32 {
        self.leaned(along) * self.seen(eye) / (4.0 * eye * PI)
    }

    /// The share of the light of a white surround that a single reflection by perfect mirrors sends to an eye at an
    /// angle of this cosine. The rest hits other mirrors.
    pub fn once(self, cosine: f32) -> f32 {
        let last = (ONCE.len() - 1) as f32;
        let place = |x: f32| {
            let at = (x.clamp(0.0, 1.0) * last).min(last - 1e-3);
            (at as usize, at - at.floor())
        };
        let ((row, r), (column, c)) = (place(self.lean.sqrt()), place(cosine.max(0.0).sqrt()));
        let along = |row: usize| ONCE[row][column] * (1.0 - c) + ONCE[row][column + 1] * c;
        along(row) * (1.0 - r) + along(row + 1) * r
    }
}

/// [`Mirrors::once`] by roughness and root of the cosine, evenly from 0 to 1.
static ONCE: LazyLock<[[f32; 33]; 33]> = LazyLock::new(|| {
    const POINTS: u32 = 512;
    let at = |i: usize| i as f32 / 32.0;
    let mean = |row: usize, column: usize| {
        let (mirrors, cosine) = (Mirrors::new(at(row)), (at(column) * at(column)).max(1e-4));
        let eye = Vec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
        // Hammersley's points of the square.
        let point =
            |i: u32| Vec2::new((i as f32 + 0.5) / POINTS as f32, (i.reverse_bits() >> 8) as f32 / (1 << 24) as f32);
        let share = |i: u32| {
            let half = mirrors.drawn(Vec3::Z, eye, disk(point(i)));
            let light = half.z * 2.0 * eye.dot(half) - eye.z;
            if light > 0.0 { mirrors.seen(light) } else { 0.0 }
        };
        (0..POINTS).map(share).sum::<f32>() / POINTS as f32
    };
    std::array::from_fn(|row| std::array::from_fn(|column| mean(row, column)))
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_energy_of_one_reflection_has_its_known_values() {
        // The roughest, seen from straight above: 1 - ln 2. Smooth ones reflect everything.
        assert!((Mirrors::new(1.0).once(1.0) - (1.0 - core::f32::consts::LN_2)).abs() < 2e-3);
        assert!(Mirrors::new(0.0).once(1.0) > 0.998);
        for (roughness, cosine) in [(0.3, 0.9), (0.7, 0.5), (1.0, 0.05)] {
            let (smoother, rougher) = (Mirrors::new(roughness - 0.1), Mirrors::new(roughness));
            assert!((0.2..1.0).contains(&rougher.once(cosine)) && smoother.once(cosine) > rougher.once(cosine));
        }
    }
}
