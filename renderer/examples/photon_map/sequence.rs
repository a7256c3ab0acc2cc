//! Samples of a pixel: a time, a position in the pixel and a point of the lamp, well distributed in all of these
//! together.
//!
//! The points are those of I. M. Sobol' (1967), with the direction numbers of S. Joe and F. Y. Kuo, "Constructing Sobol
//! sequences with better two-dimensional projections" (2008). Each pixel has its own scrambling (A. B. Owen, "Randomly
//! permuted (t,m,s)-nets and (t,s)-sequences", 1995). [`Sampler`] distributes each pair of numbers separately; here the
//! first digits of times can be the same in all pixels, so that a pass sweeps the shutter with all of them together.

use mbkd::glam::Vec2;
use mbkd_renderer::sampling::{Sampler, mix};

/// Bits of a coordinate that are well distributed; further ones are random. Samples beyond two to this power repeat.
const BITS: usize = 16;
/// Time, lamp, pixel.
const DIMENSIONS: usize = 5;

/// Degree, inner coefficients of the primitive polynomial, and first direction numbers, of dimensions after the first.
const POLYNOMIALS: [(usize, u32, [u32; 3]); DIMENSIONS - 1] =
    [(1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1]), (3, 2, [1, 1, 1])];

/// Direction numbers, the first in the highest bit.
const DIRECTIONS: [[u32; BITS]; DIMENSIONS] = directions();

const fn directions() -> [[u32; BITS]; DIMENSIONS] {
    let mut all = [[0; BITS]; DIMENSIONS];
    let mut bit = 0;
    while bit < BITS {
        all[0][bit] = 1 << (31 - bit);
        bit += 1;
    }
    let mut dimension = 1;
    while dimension < DIMENSIONS {
        let (degree, inner, first) = POLYNOMIALS[dimension - 1];
        let mut bit = 0;
        while bit < BITS {
            all[dimension][bit] = if bit < degree {
                first[bit] << (31 - bit)
            } else {
                let mut number = all[dimension][bit - degree] ^ (all[dimension][bit - degree] >> degree);
                let mut term = 1;
                while term < degree {
                    if inner >> (degree - 1 - term) & 1 == 1 {
                        number ^= all[dimension][bit - term];
                    }
                    term += 1;
                }
                number
            };
            bit += 1;
        }
        dimension += 1;
    }
    all
}

/// One sample of a pixel.
pub struct Sample {
    pixel: u64,
    number: u32,
}

impl Sample {
    /// Sample `number` of the pixel with this index, under a seed.
    pub fn new(seed: u64, pixel: usize, number: u32) -> Sample {
        Sample { pixel: mix(seed, pixel as u64), number }
    }

    /// Its time, in [0, 1). The first `shared` binary digits are the same in all pixels.
    pub fn time(&self, shared: u32) -> f32 {
        to_unit(permuted(sobol(0, self.number), mix(self.pixel, 0), shared))
    }

    /// Its point of the lamp, in the unit square.
    pub fn lamp(&self) -> Vec2 {
        Vec2::new(self.coordinate(1), self.coordinate(2))
    }

    /// Its position in the pixel, in the unit square.
    pub fn place(&self) -> Vec2 {
        Vec2::new(self.coordinate(3), self.coordinate(4))
    }

    /// Further random numbers.
    pub fn more(&self) -> Sampler {
        Sampler::new(self.pixel, 0, self.number, 1 << 20)
    }

    fn coordinate(&self, dimension: usize) -> f32 {
        to_unit(permuted(sobol(dimension, self.number), mix(self.pixel, dimension as u64), 0))
    }
}

/// A time for a pass, for a uniform distribution with any number of passes: multiples of the golden ratio.
pub fn time_of_pass(pass: u32) -> f32 {
    to_unit(0x8000_0000u32.wrapping_add(pass.wrapping_mul(0x9e37_79b9)))
}

fn sobol(dimension: usize, mut number: u32) -> u32 {
    let (mut bits, mut digit) = (0, 0);
    while number != 0 && digit < BITS {
        if number & 1 == 1 {
            bits ^= DIRECTIONS[dimension][digit];
        }
        (number, digit) = (number >> 1, digit + 1);
    }
    bits
}

/// Owen scrambling: exchanges the halves of the unit interval or not, the halves of each half, and so on, from the
/// digit `first` on.
fn permuted(bits: u32, order: u64, first: u32) -> u32 {
    let mut result = bits;
    for bit in first..BITS as u32 {
        // The higher bits decide.
        let above = u64::from((bits >> 1).checked_shr(31 - bit).unwrap_or(0)) | 1 << bit;
        result ^= ((mix(order, above) >> 32) as u32 & 1) << (31 - bit);
    }
    result ^ (mix(order, u64::from(bits)) as u32 >> BITS)
}

fn to_unit(bits: u32) -> f32 {
    (bits >> 8) as f32 / (1u32 << 24) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_interval_gets_its_sample() {
        for pixel in 0..20 {
            for dimension in 0..DIMENSIONS {
                for count in [1u32, 2, 8, 64, 256] {
                    let mut seen = vec![0; count as usize];
                    for number in 0..count {
                        let at = Sample::new(5, pixel, number).coordinate(dimension);
                        seen[(at * count as f32) as usize] += 1;
                    }
                    assert!(seen.iter().all(|&n| n == 1), "dimension {dimension}, {count}: {seen:?}");
                }
            }
            // The squares of the lamp and of the pixel, in cells of a 64th.
            let cell = |at: Vec2| (at.x * 4.0) as usize * 4 + (at.y * 4.0) as usize;
            let mut cells = [0; 16];
            (0..64).for_each(|number| cells[cell(Sample::new(5, pixel, number).lamp())] += 1);
            assert!(cells.iter().all(|&n| n == 4), "{cells:?}");
        }
    }

    #[test]
    fn pixels_differ_and_shared_times_do_not() {
        let times: Vec<f32> = (0..100).map(|pixel| Sample::new(5, pixel, 6).time(0)).collect();
        let early = times.iter().filter(|&&time| time < 0.5).count();
        assert!((30..70).contains(&early), "{early}");
        assert!((0..100).all(|pixel| (Sample::new(5, pixel, 6).time(3) * 8.0) as u32 == 3));
    }
}
