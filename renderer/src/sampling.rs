//! Sample points: evenly spread, different in every pixel, and the same on every machine.
//!
//! The samples of a pixel are points of an additive recurrence: sample `s` has `frac(shift + s * alpha)` in
//! each dimension, with the `alpha` of the generalized golden ratio (Roberts, "The Unreasonable Effectiveness
//! of Quasirandom Sequences", 2018) and a random shift per pixel. In 32-bit integers this is exact. Whatever
//! needs more dimensions than there are gets plain random numbers. Times are stratified: with `n` samples
//! each of `n` equal parts of the shutter gets one.

use mbkd::glam::{Vec2, Vec3};

/// Dimensions that come from the recurrence.
const DIMENSIONS: usize = 10;
/// 2^32 * g^-(i+1), where g = 1.0638... is the root of x^11 = x + 1.
const ALPHA: [u32; DIMENSIONS] = alphas();

const fn alphas() -> [u32; DIMENSIONS] {
    // Newton's method on x^11 - x - 1.
    let mut x = 1.07f64;
    let mut step = 0;
    while step < 30 {
        let x5 = x * x * x * x * x;
        let x10 = x5 * x5;
        x -= (x10 * x - x - 1.0) / (11.0 * x10 - 1.0);
        step += 1;
    }
    let mut alpha = [0u32; DIMENSIONS];
    let (mut i, mut power) = (0, 1.0);
    while i < DIMENSIONS {
        power /= x;
        alpha[i] = (power * 4294967296.0) as u32;
        i += 1;
    }
    alpha
}

/// A stateless mix of two words (the finalizer of SplitMix64).
pub fn mix(a: u64, b: u64) -> u64 {
    let z = a.wrapping_add(b.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The random numbers of one sample of one pixel.
pub struct Sampler {
    pixel: u64,
    sample: u32,
    samples: u32,
    used: usize,
    random: u64,
}

impl Sampler {
    /// Sample `sample` of `samples` of the pixel with this number, under a seed.
    pub fn new(seed: u64, pixel: u64, sample: u32, samples: u32) -> Sampler {
        let pixel = mix(mix(0x6d62_6b64, seed), pixel);
        Sampler { pixel, sample, samples, used: 0, random: mix(pixel, u64::from(sample) << 32) }
    }

    /// The next number in [0, 1).
    pub fn unit(&mut self) -> f32 {
        let bits = if self.used < DIMENSIONS {
            let shift = mix(self.pixel, self.used as u64) as u32;
            let bits = shift.wrapping_add(self.sample.wrapping_mul(ALPHA[self.used]));
            self.used += 1;
            bits
        } else {
            self.random = mix(self.random, 0);
            self.random as u32
        };
        (bits >> 8) as f32 / (1u32 << 24) as f32
    }

    /// A point of the unit square.
    pub fn square(&mut self) -> Vec2 {
        Vec2::new(self.unit(), self.unit())
    }

    /// A time in the stratum of this sample, in [0, 1).
    ///
    /// Strata are visited in the order of a stride near the golden section, so that the first few
    /// samples of a picture that is interrupted cover the shutter too.
    pub fn time(&mut self) -> f32 {
        let n = u64::from(self.samples);
        let stratum = u64::from(self.sample) * stride(n) % n;
        // Below 1 for certain: sums of multiples of 2^-24 near 1 may round up.
        ((stratum as f32 + self.unit()) / self.samples as f32).min(1.0 - f32::EPSILON)
    }

    /// A point of the unit disk.
    pub fn disk(&mut self) -> Vec2 {
        disk(self.square())
    }

    /// A direction about the unit normal `n`, with density proportional to the cosine.
    pub fn cosine(&mut self, n: Vec3) -> Vec3 {
        cosine(n, self.square())
    }
}

/// The point of the unit disk that a point of the unit square goes to.
pub fn disk(square: Vec2) -> Vec2 {
    // Squares around the centre go to circles around it (Shirley and Chiu, 1997).
    let p = square * 2.0 - 1.0;
    let (radius, eighths) = if p.x.abs() > p.y.abs() {
        (p.x, if p.x == 0.0 { 0.0 } else { p.y / p.x })
    } else {
        (p.y, if p.y == 0.0 { 2.0 } else { 2.0 - p.x / p.y })
    };
    let (c, s) = cos_sin(eighths / 8.0);
    Vec2::new(c, s) * radius
}

/// The direction about the unit normal `n` that a point of the unit square goes to.
pub fn cosine(n: Vec3, square: Vec2) -> Vec3 {
    let (u, v) = frame(n);
    let d = disk(square);
    u * d.x + v * d.y + n * (1.0 - d.length_squared()).max(0.0).sqrt()
}

/// A number near 0.618 n without a common divisor with n.
fn stride(n: u64) -> u64 {
    let mut stride = (n * 309 / 500).max(1);
    let divisor = |mut a: u64, mut b: u64| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    while divisor(stride, n) != 1 {
        stride += 1;
    }
    stride
}

/// Cosine and sine of an angle in turns, from additions and products alone: the platform's differ in the
/// last bit from one to the next, and a seed should give the same file on all of them.
pub fn cos_sin(turns: f32) -> (f32, f32) {
    let (c, s) = cos_sin_f64(f64::from(turns));
    (c as f32, s as f32)
}

/// The same in double precision.
pub fn cos_sin_f64(turns: f64) -> (f64, f64) {
    let quarters = turns * 4.0;
    let nearest = quarters.round();
    let x = (quarters - nearest) * std::f64::consts::FRAC_PI_2;
    // Taylor series: by the ninth term nothing is left below pi/4.
    let (mut c, mut s, mut term) = (0.0, 0.0, 1.0);
    for i in 0..18 {
        match i % 4 {
            0 => c += term,
            1 => s += term,
            2 => c -= term,
            _ => s -= term,
        }
        term = term * x / f64::from(i + 1);
    }
    match nearest.rem_euclid(4.0) as u8 {
        0 => (c, s),
        1 => (-s, c),
        2 => (-c, -s),
        _ => (s, -c),
    }
}

/// Two unit vectors at right angles to a unit vector and each other.
pub fn frame(n: Vec3) -> (Vec3, Vec3) {
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stratum_of_the_shutter_gets_one_time() {
        for samples in [1u32, 2, 7, 16, 100] {
            let mut seen = vec![0; samples as usize];
            for sample in 0..samples {
                let time = Sampler::new(1, 99, sample, samples).time();
                assert!((0.0..1.0).contains(&time));
                seen[(time * samples as f32) as usize] += 1;
            }
            assert!(seen.iter().all(|&n| n == 1), "{samples}: {seen:?}");
        }
    }

    #[test]
    fn directions_are_unit_and_weighted_by_the_cosine() {
        let n = Vec3::new(0.36, -0.48, -0.8);
        let mut mean = 0.0;
        for pixel in 0..4000 {
            let d = Sampler::new(7, pixel, 0, 1).cosine(n);
            assert!((d.length() - 1.0).abs() < 1e-5 && d.dot(n) >= -1e-6);
            mean += d.dot(n) / 4000.0;
        }
        // The mean cosine of a cosine-weighted direction is 2/3.
        assert!((mean - 2.0 / 3.0).abs() < 0.01, "{mean}");
    }

    #[test]
    fn series_agree_with_the_platform() {
        for i in -500..500 {
            let turns = f64::from(i) / 123.0;
            let (c, s) = cos_sin_f64(turns);
            let angle = turns * std::f64::consts::TAU;
            assert!((c - angle.cos()).abs() < 1e-13 && (s - angle.sin()).abs() < 1e-13);
        }
    }
}
