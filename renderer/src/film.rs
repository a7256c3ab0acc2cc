//! The picture: sums of samples, tone mapping, and files.
//!
//! All operations up to the bytes of a PNG are additions, products, quotients and roots, which IEEE 754 specifies
//! exactly: the same seed gives the same file on every machine. Sums are whole numbers of a small unit, so that samples
//! may be taken in any order and on any number of machines.

use mbkd::glam::Vec3;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::LazyLock;

/// The unit of light in sums: a billionth of white.
const UNIT: f64 = 1.0 / (1u32 << 30) as f64;

/// Samples are clamped to this radiance. 65 536 samples of it fit into a sum.
const BRIGHTEST: f64 = 65_536.0;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Its first column.
    pub x: usize,
    /// Its first row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Sums of radiance per pixel, top row first.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Pixels across.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Sums over the samples taken so far, red, green and blue, in units.
    pub(crate) sums: Vec<[i64; 3]>,
    /// The number of samples of each pixel.
    pub(crate) samples: Vec<u32>,
}

/// A sample in units. NaN counts as black.
pub(crate) fn in_units(light: Vec3) -> [i64; 3] {
    light.to_array().map(|x| (f64::from(x).clamp(-BRIGHTEST, BRIGHTEST) / UNIT) as i64)
}

impl Film {
    /// A black film.
    pub fn new(width: usize, height: usize) -> Film {
        Film { width, height, sums: vec![[0; 3]; width * height], samples: vec![0; width * height] }
    }

    /// Adds so many samples of a pixel, whose sum is `light`.
    pub fn add(&mut self, pixel: usize, light: Vec3, samples: u32) {
        self.add_units(pixel, in_units(light), samples);
    }

    /// [`Film::add`] with a sum in units.
    pub(crate) fn add_units(&mut self, pixel: usize, sum: [i64; 3], samples: u32) {
        (0..3).for_each(|i| self.sums[pixel][i] += sum[i]);
        self.samples[pixel] += samples;
    }

    /// Gives pixels without a sample those of the first pixel of their square, `edge` pixels wide. Returns the number
    /// of pixels that still have none.
    pub(crate) fn fill_squares(&mut self, edge: usize) -> usize {
        for pixel in 0..self.samples.len() {
            let (x, y) = (pixel % self.width, pixel / self.width);
            let first = (y - y % edge) * self.width + x - x % edge;
            if self.samples[pixel] == 0 {
                (self.sums[pixel], self.samples[pixel]) = (self.sums[first], self.samples[first]);
            }
        }
        self.samples.iter().filter(|&&n| n == 0).count()
    }

    /// The mean radiance of each pixel.
    pub fn linear(&self) -> Vec<Vec3> {
        let mean = |(sum, &n): (&[i64; 3], &u32)| sum.map(|x| (x as f64 * UNIT / f64::from(n.max(1))) as f32);
        self.sums.iter().zip(&self.samples).map(|pixel| Vec3::from(mean(pixel))).collect()
    }

    /// The film seen through a filter wider than a pixel: in both directions an eighth of either neighbour and six
    /// eighths of the pixel itself, as in a quadratic B-spline. Lines are smoother, and pixels share samples:
    /// independent noise has a third of its variance. At the edge of the picture the pixel itself replaces missing
    /// neighbours.
    pub fn filtered(&self) -> Film {
        let blend = |before: Vec3, pixel: Vec3, after: Vec3| pixel * 0.75 + (before + after) * 0.125;
        let pixels = self.linear();
        let at = |x: usize, y: usize| pixels[y * self.width + x];
        let (last, bottom) = (self.width.saturating_sub(1), self.height.saturating_sub(1));
        let across = |x: usize, y: usize| blend(at(x.saturating_sub(1), y), at(x, y), at((x + 1).min(last), y));
        let rows: Vec<Vec3> = (0..pixels.len()).map(|i| across(i % self.width, i / self.width)).collect();
        let row = |x: usize, y: usize| rows[y * self.width + x];
        let down = |x: usize, y: usize| blend(row(x, y.saturating_sub(1)), row(x, y), row(x, (y + 1).min(bottom)));
        let mut film = Film::new(self.width, self.height);
        (0..pixels.len()).for_each(|i| film.add(i, down(i % self.width, i / self.width), 1));
        film
    }

    /// The picture as 8-bit sRGB.
    pub fn developed(&self, exposure: f32) -> Picture {
        let pixels = self.linear().into_iter().map(|c| tone_map(c * exposure).to_array().map(encode)).collect();
        Picture { width: self.width, height: self.height, pixels }
    }
}

/// A picture for display, 8-bit sRGB, top row first.
#[derive(Clone)]
pub struct Picture {
    /// Pixels across.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row.
    pub pixels: Vec<[u8; 3]>,
}

impl Picture {
    /// A picture of one colour.
    pub fn filled(width: usize, height: usize, color: [u8; 3]) -> Picture {
        Picture { width, height, pixels: vec![color; width * height] }
    }

    /// Copies `other` with its upper left corner at (x, y), clipped to this picture.
    pub fn paste(&mut self, other: &Picture, x: usize, y: usize) {
        let count = other.width.min(self.width.saturating_sub(x));
        if count == 0 {
            return;
        }
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = row * other.width;
            let to = (y + row) * self.width + x;
            self.pixels[to..to + count].copy_from_slice(&other.pixels[from..from + count]);
        }
    }

    /// Writes a PNG.
    pub fn save(&self, path: &Path) -> Result<(), String> {
        let write = || -> Result<(), png::EncodingError> {
            let file = BufWriter::new(File::create(path)?);
            let mut encoder = png::Encoder::new(file, self.width as u32, self.height as u32);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            let mut writer = encoder.write_header()?;
            writer.write_image_data(self.pixels.as_flattened())?;
            writer.finish()
        };
        write().map_err(|e| format!("{}: {e}", path.display()))
    }
}

/// Writes linear radiance, without exposure and tone mapping, as .pfm or .exr.
pub fn save_linear(film: &Film, path: &Path) -> Result<(), String> {
    let linear = film.linear();
    let written = match path.extension() {
        Some(kind) if kind.eq_ignore_ascii_case("exr") => {
            let pixel = |x: usize, y: usize| linear[y * film.width + x].into();
            exr::prelude::write_rgb_file::<f32, f32, f32>(path, film.width, film.height, pixel)
                .map_err(|e| e.to_string())
        }
        _ => std::fs::write(path, pfm(film.width, film.height, &linear)).map_err(|e| e.to_string()),
    };
    written.map_err(|e| format!("{}: {e}", path.display()))
}

/// A portable float map: a negative scale means little-endian; rows run from the bottom.
fn pfm(width: usize, height: usize, pixels: &[Vec3]) -> Vec<u8> {
    let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    for row in pixels.chunks(width).rev() {
        bytes.extend(row.iter().flat_map(|c| c.to_array()).flat_map(f32::to_le_bytes));
    }
    bytes
}

/// The filmic curve of Narkowicz ("ACES Filmic Tone Mapping Curve", 2015): bright light keeps its colour for long and
/// then fades smoothly to white.
fn tone_map(c: Vec3) -> Vec3 {
    let c = c.max(Vec3::ZERO) * 0.8;
    let mapped = c * (c * 2.51 + 0.03) / (c * (c * 2.43 + 0.59) + 0.14);
    mapped.clamp(Vec3::ZERO, Vec3::ONE)
}

/// Linear values of the 256 bytes of sRGB.
static DECODED: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| {
        let x = byte as f64 / 255.0;
        if x <= 0.04045 {
            return (x / 12.92) as f32;
        }
        // y^2.4 = y^2 * (y^2)^(1/5); the fifth root by Newton's method.
        let y = (x + 0.055) / 1.055;
        let square = y * y;
        let mut root = 1.0;
        for _ in 0..60 {
            let r4 = root * root * root * root;
            root -= (r4 * root - square) / (5.0 * r4);
        }
        (square * root) as f32
    })
});

/// The linear value of an sRGB byte.
pub fn decode(byte: u8) -> f32 {
    DECODED[usize::from(byte)]
}

/// The sRGB byte nearest to a linear value; NaN is black.
pub fn encode(linear: f32) -> u8 {
    // Thresholds half-way between neighbours.
    let table = &*DECODED;
    let (mut low, mut high) = (0usize, 255usize);
    while low < high {
        let middle = (low + high) / 2;
        if linear > 0.5 * (table[middle] + table[middle + 1]) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    low as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_round_trip_through_linear_light() {
        for byte in 0..=255u8 {
            let x = f64::from(byte) / 255.0;
            let expected = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
            assert!((f64::from(decode(byte)) - expected).abs() < 1e-7, "{byte}");
            assert_eq!(encode(decode(byte)), byte);
        }
        assert_eq!((encode(-1.0), encode(f32::NAN), encode(9.0)), (0, 0, 255));
    }

    #[test]
    fn filtering_spreads_light_and_keeps_all_of_it() {
        let light = Vec3::new(64.0, 32.0, 0.5);
        for (x, y) in [(2, 2), (0, 0), (4, 3)] {
            let mut film = Film::new(5, 4);
            (0..20).for_each(|pixel| film.add(pixel, Vec3::ZERO, 2));
            film.add(y * 5 + x, light * 4.0, 2);
            let filtered = film.filtered().linear();
            assert_eq!(filtered.iter().sum::<Vec3>(), light);
            assert_eq!(filtered[7], if x == 2 { light * (6.0 / 64.0) } else { Vec3::ZERO });
        }
        let mut even = Film::new(3, 1);
        (0..3).for_each(|pixel| even.add(pixel, light * 3.0, 3));
        assert_eq!(even.filtered().linear(), vec![light; 3]);
        assert!(Film::new(0, 0).filtered().linear().is_empty());
    }

    #[test]
    fn pasting_clips_to_the_picture() {
        let mut picture = Picture::filled(4, 3, [0; 3]);
        picture.paste(&Picture::filled(3, 3, [9; 3]), 2, 1);
        let nines = picture.pixels.iter().filter(|p| **p == [9; 3]).count();
        assert_eq!(nines, 4);
        picture.paste(&Picture::filled(3, 3, [9; 3]), 7, 7);
    }
}
