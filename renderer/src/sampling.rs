//! Sample points: well distributed over every pixel and its neighbours, and the same on every machine.
//!
//! Each pair of dimensions of a sample is a point of Sobol's sequence in the plane: 2^k samples of a pixel put one into
//! each of 2^k boxes of equal shape, whatever the shape. Owen's scrambling randomizes them and preserves that (Owen,
//! "Randomly permuted (t,m,s)-nets and (t,s)-sequences", 1995), by a hash whose bits depend on lower ones only (Laine
//! and Karras, "Stratified sampling for stochastic transparency", 2011). Pairs are combined by scrambling the order of
//! points too (Burley, "Practical hash-based Owen scrambling", 2020).
//!
//! Pixels with successive indices share one sequence: their samples together are as well distributed as those of one
//! pixel. With indices along a Z curve, an excess in one pixel is balanced by its neighbours, and noise is fine-grained
//! (Ahmed and Wonka, "Screen-space blue-noise diffusion of Monte Carlo sampling error via hierarchical ordering of
//! pixels", 2020).

use mbkd::glam::{Vec2, Vec3};
use mbkd_scenes::frame;

/// A stateless mix of two words (the finalizer of SplitMix64).
pub fn mix(a: u64, b: u64) -> u64 {
    let z = a.wrapping_add(b.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The random numbers of one sample of one pixel.
pub struct Sampler {
    /// The key that scrambles the sequence.
    seed: u64,
    /// Index in the sequence.
    index: u32,
    /// Dimensions used.
    used: u32,
}

impl Sampler {
    /// Sample `sample` of `samples` of the pixel with this index, under a seed.
    pub fn new(seed: u64, pixel: u64, sample: u32, samples: u32) -> Sampler {
        // Every pixel has a power of two of indices; those beyond 2^32 are in another sequence.
        let bits = 32 - samples.saturating_sub(1).leading_zeros();
        let (index, sequence) = ((pixel << bits) as u32 | sample, pixel >> (32 - bits));
        Sampler { seed: mix(mix(0x6d62_6b64, seed), sequence), index, used: 0 }
    }

    /// The next number in [0, 1).
    pub fn unit(&mut self) -> f32 {
        let pair = self.pair();
        self.used += 1;
        if self.used % 2 == 1 { pair.x } else { pair.y }
    }

    /// A point of the unit square.
    pub fn square(&mut self) -> Vec2 {
        self.used = self.used.next_multiple_of(2);
        let pair = self.pair();
        self.used += 2;
        pair
    }

    /// The point of the current pair of dimensions.
    fn pair(&self) -> Vec2 {
        let key = mix(self.seed, u64::from(self.used / 2));
        let index = scrambled(self.index.reverse_bits(), key as u32).reverse_bits();
        let keys = mix(key, 0);
        let unit = |bits: u32, key: u32| (scrambled(bits, key).reverse_bits() >> 8) as f32 / (1u32 << 24) as f32;
        Vec2::new(unit(index, (key >> 32) as u32 ^ keys as u32), unit(shifted(index), (keys >> 32) as u32))
    }

    /// A time in [0, 1): of 2^k samples, one in each of 2^k equal intervals.
    pub fn time(&mut self) -> f32 {
        self.unit()
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

/// Maps the unit square to the unit disk.
pub fn disk(square: Vec2) -> Vec2 {
    // Squares around the centre map to circles around it (Shirley and Chiu, 1997).
    let p = square * 2.0 - 1.0;
    let (radius, eighths) = if p.x.abs() > p.y.abs() {
        (p.x, if p.x == 0.0 { 0.0 } else { p.y / p.x })
    } else {
        (p.y, if p.y == 0.0 { 2.0 } else { 2.0 - p.x / p.y })
    };
    let (c, s) = cos_sin(eighths / 8.0);
    Vec2::new(c, s) * radius
}

/// Maps the unit square to directions about the unit normal `n`, with density proportional to the cosine.
pub fn cosine(n: Vec3, square: Vec2) -> Vec3 {
    let (u, v) = frame(n);
    let d = disk(square);
    u * d.x + v * d.y + n * (1.0 - d.length_squared()).max(0.0).sqrt()
}

/// Owen's scrambling of a number whose bits are in reverse order: every bit is flipped or not depending on the lower
/// ones.
fn scrambled(mut x: u32, key: u32) -> u32 {
    x = x.wrapping_add(key);
    for even in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6] {
        x ^= x.wrapping_mul(even);
    }
    x
}

/// The second dimension of Sobol's sequence at an index, bits in reverse order: the polynomial over GF(2) whose
/// coefficients are the bits of the index, at x + 1 instead of x. Halves are joined by (x + 1)^n = x^n + 1 for n = 16,
/// 8, 4, 2, 1.
fn shifted(mut x: u32) -> u32 {
    x ^= x >> 16;
    x ^= (x & 0xff00_ff00) >> 8;
    x ^= (x & 0xf0f0_f0f0) >> 4;
    x ^= (x & 0xcccc_cccc) >> 2;
    x ^ (x & 0xaaaa_aaaa) >> 1
}

/// The index of a pixel along a Z curve: the interleaved bits of column and row.
pub fn z_order(x: u32, y: u32) -> u64 {
    const MASKS: [u64; 5] =
        [0xffff_0000_ffff, 0xff_00ff_00ff_00ff, 0x0f0f_0f0f_0f0f_0f0f, 0x3333_3333_3333_3333, 0x5555_5555_5555_5555];
    let apart = |v: u32| (0..5).fold(u64::from(v), |v, i| (v | v << (16 >> i)) & MASKS[i]);
    apart(x) | apart(y) << 1
}

/// Cosine and sine of an angle in turns, from additions and products only: platform functions differ in the last bit,
/// and a seed should give the same file on all platforms.
pub fn cos_sin(turns: f32) -> (f32, f32) {
    let (c, s) = cos_sin_f64(f64::from(turns));
    (c as f32, s as f32)
}

/// [`cos_sin`] in double precision.
pub fn cos_sin_f64(turns: f64) -> (f64, f64) {
    let quarters = turns * 4.0;
    let nearest = quarters.round();
    let x = (quarters - nearest) * std::f64::consts::FRAC_PI_2;
    // Taylor series: the ninth term is negligible below pi/4.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The points of a pixel in a pair of dimensions.
    fn points(pixel: u64, samples: u32, pair: usize) -> Vec<Vec2> {
        let point = |sample: u32| {
            let mut sampler = Sampler::new(1, pixel, sample, samples);
            for _ in 0..pair {
                sampler.square();
            }
            sampler.square()
        };
        (0..samples).map(point).collect()
    }

    #[test]
    fn every_box_of_any_shape_gets_one_point() {
        // For one pixel, and for sixteen neighbours together.
        let neighbours = |pair: usize| (0..16).flat_map(|pixel| points(1_000_000 * 16 + pixel, 16, pair)).collect();
        for pair in 0..6 {
            for points in [points(99, 256, pair), neighbours(pair)] {
                for columns in (0..9).map(|power| 1 << power) {
                    let place = |p: &Vec2| {
                        (p.x * columns as f32) as usize * (256 / columns) + (p.y * (256 / columns) as f32) as usize
                    };
                    let mut boxes: Vec<usize> = points.iter().map(place).collect();
                    boxes.sort_unstable();
                    assert!(boxes.into_iter().eq(0..256), "pair {pair}, {columns} columns");
                }
            }
        }
    }

    #[test]
    fn pairs_pixels_and_seeds_are_uncorrelated() {
        // Correlations of independent numbers have a standard deviation of 1/64.
        let numbers = |seed: u64, pixel: u64, dimension: usize| -> Vec<f32> {
            let number = |sample: u32| {
                let mut sampler = Sampler::new(seed, pixel, sample, 4096);
                for _ in 0..dimension {
                    sampler.unit();
                }
                sampler.unit() - 0.5
            };
            (0..4096).map(number).collect()
        };
        let all = [(0, 0), (0, 1), (0, 1 << 40), (1, 0)]
            .into_iter()
            .flat_map(|(seed, pixel)| (0..12).map(move |dimension| numbers(seed, pixel, dimension)));
        let all: Vec<Vec<f32>> = all.collect();
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                let correlation = a.iter().zip(b).map(|(a, b)| 12.0 * a * b / 4096.0).sum::<f32>();
                assert!(correlation.abs() < 0.08, "{i}: {correlation}");
            }
        }
    }

    #[test]
    fn a_z_curve_interleaves_bits() {
        assert_eq!((z_order(1, 0), z_order(0, 1), z_order(5, 3)), (1, 2, 0b01_10_11));
        assert_eq!(z_order(u32::MAX, 0) | z_order(0, u32::MAX), u64::MAX);
    }

    #[test]
    fn times_of_a_power_of_two_of_samples_are_one_in_each_interval() {
        for samples in [1u32, 2, 16, 64] {
            let mut seen = vec![0; samples as usize];
            for sample in 0..samples {
                let time = Sampler::new(1, 99, sample, samples).time();
                assert!((0.0..1.0).contains(&time));
                seen[(time * samples as f32) as usize] += 1;
            }
            assert!(seen.iter().all(|&n| n == 1), "{samples}: {seen:?}");
        }
        // For other numbers, no two are in one of the intervals of the next power of two.
        let mut parts: Vec<usize> =
            (0..100).map(|sample| (Sampler::new(1, 99, sample, 100).time() * 128.0) as usize).collect();
        parts.sort_unstable();
        parts.dedup();
        assert_eq!(parts.len(), 100);
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
