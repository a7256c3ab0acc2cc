//! Light from outside: a sky with a gradient from horizon to zenith, and a sun with soft shadows.

use crate::sampling::Sampler;
use mbkd::glam::Vec3;
use mbkd_scenes::frame;

/// The sky and its sun, in linear light.
#[derive(Clone, Copy, Debug)]
pub struct Sky {
    /// Radiance straight up.
    pub zenith: Vec3,
    /// Radiance at the horizon.
    pub horizon: Vec3,
    /// Radiance straight down, where nothing occludes it.
    pub below: Vec3,
    /// The radiance that the sun adds to a white surface facing it.
    pub sun: Vec3,
    /// Towards the sun, of length 1.
    pub to_sun: Vec3,
    /// Tangent of the sun's angular radius; the true sun has 0.0047, larger ones cast softer shadows.
    pub sun_radius: f32,
    /// The factor of radiance before tone mapping.
    pub exposure: f32,
}

impl Sky {
    /// An afternoon: a warm sun from the left and a blue sky.
    pub fn afternoon(to_sun: Vec3) -> Sky {
        Sky {
            zenith: Vec3::new(0.30, 0.47, 0.85),
            horizon: Vec3::new(0.85, 0.90, 0.95),
            below: Vec3::new(0.30, 0.27, 0.24),
            sun: Vec3::new(3.0, 2.62, 2.1),
            to_sun: to_sun.normalize_or(Vec3::Y),
            sun_radius: 0.02,
            exposure: 0.55,
        }
    }

    /// The same sky from high above the ground: blue all around, fading to haze below.
    pub fn air(to_sun: Vec3) -> Sky {
        Sky {
            zenith: Vec3::new(0.10, 0.36, 1.10),
            horizon: Vec3::new(0.38, 0.78, 1.40),
            below: Vec3::new(0.95, 1.25, 1.60),
            ..Sky::afternoon(to_sun)
        }
    }

    /// A studio: an even grey surround and a white key light.
    pub fn studio(to_sun: Vec3) -> Sky {
        Sky {
            zenith: Vec3::new(0.72, 0.76, 0.82),
            horizon: Vec3::new(0.52, 0.54, 0.58),
            below: Vec3::new(0.36, 0.36, 0.37),
            sun: Vec3::new(2.1, 2.0, 1.85),
            to_sun: to_sun.normalize_or(Vec3::Y),
            sun_radius: 0.06,
            exposure: 0.6,
        }
    }

    /// Space: one hard light and a faint glow.
    pub fn night(to_sun: Vec3) -> Sky {
        Sky {
            zenith: Vec3::new(0.020, 0.030, 0.065),
            horizon: Vec3::new(0.045, 0.055, 0.09),
            below: Vec3::new(0.015, 0.020, 0.04),
            sun: Vec3::new(3.4, 3.1, 2.7),
            to_sun: to_sun.normalize_or(Vec3::Y),
            sun_radius: 0.01,
            exposure: 0.62,
        }
    }

    /// Radiance from a direction of any length, without the sun.
    pub fn radiance(&self, dir: Vec3) -> Vec3 {
        let up = dir.normalize_or(Vec3::Y).y;
        if up >= 0.0 {
            // Rapidly blue above the horizon, then slowly: the square root of the height.
            self.horizon.lerp(self.zenith, up.sqrt())
        } else {
            self.horizon.lerp(self.below, (-4.0 * up).min(1.0))
        }
    }

    /// A direction to a point of the sun's disk.
    pub fn towards_sun(&self, sampler: &mut Sampler) -> Vec3 {
        let (u, v) = frame(self.to_sun);
        let d = sampler.disk() * self.sun_radius;
        (self.to_sun + u * d.x + v * d.y).normalize()
    }
}
