//! The pictures of all methods on one sheet, with their errors relative to a reference.

use crate::picture::Pictures;
use mbkd::glam::Vec3;
use mbkd_renderer::film::{Film, Picture};
use mbkd_renderer::font;

/// Exposure of all pictures.
pub const EXPOSURE: f32 = 1.25;

/// The relative mean squared error over the whole picture and over the caustic.
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    /// Over all pixels.
    pub all: f64,
    /// Over the pixels in which the reference's caustic is bright, for all light.
    pub caustic: f64,
}

/// The pixels of the caustic: where the reference has at least a twentieth of the brightest percent of it.
fn in_caustic(caustic: &[Vec3]) -> Vec<bool> {
    let bright = |c: &Vec3| c.element_sum();
    let mut sorted: Vec<f32> = caustic.iter().map(bright).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let high = sorted[sorted.len() - 1 - sorted.len() / 100];
    caustic.iter().map(|c| bright(c) > 0.05 * high).collect()
}

/// Errors of a picture: the mean of (x − reference)² / (reference² + 0.01), over channels and pixels.
pub fn errors(picture: &Pictures, all: &[Vec3], caustic: &[Vec3]) -> Errors {
    let squares: Vec<f64> = picture
        .all
        .linear()
        .iter()
        .zip(all)
        .map(|(x, reference)| {
            let square = (*x - *reference) * (*x - *reference) / (*reference * *reference + 0.01);
            f64::from(square.element_sum() / 3.0)
        })
        .collect();
    let of_caustic: Vec<f64> =
        squares.iter().zip(in_caustic(caustic)).filter(|(_, bright)| *bright).map(|(square, _)| *square).collect();
    let mean = |squares: &[f64]| squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    Errors { all: mean(&squares), caustic: mean(&of_caustic) }
}

/// A detail of a picture, enlarged.
fn enlarged(picture: &Picture, (x, y): (usize, usize), (width, height): (usize, usize), by: usize) -> Picture {
    let mut large = Picture::filled(width * by, height * by, [0; 3]);
    for (i, pixel) in large.pixels.iter_mut().enumerate() {
        let (column, row) = (i % (width * by) / by, i / (width * by) / by);
        *pixel =
            picture.pixels[(y + row).min(picture.height - 1) * picture.width + (x + column).min(picture.width - 1)];
    }
    large
}

/// The sheet: each picture with an enlarged detail below, and lines of text under that.
pub fn draw(panels: &[(&Film, Vec<String>)]) -> Picture {
    let (width, height) = (panels[0].0.width, panels[0].0.height);
    let gap = 8;
    // Small letters below narrow pictures.
    let letters = panels.iter().flat_map(|panel| &panel.1).map(String::len).max().unwrap_or(0);
    let scale = if letters * font::ADVANCE * 2 <= width { 2 } else { 1 };
    // The floor under the glass sphere.
    let (part_width, part_height) = (width / 2, height / 4);
    let corner = (width / 4, height * 3 / 4);
    let line = (font::HEIGHT + 4) * scale;
    let lines = panels.iter().map(|panel| panel.1.len()).max().unwrap_or(0);
    let total = (gap + (width + gap) * panels.len(), gap * 3 + height + part_height * 2 + lines * line + gap);
    let mut sheet = Picture::filled(total.0, total.1, [16; 3]);
    for (i, (film, text)) in panels.iter().enumerate() {
        let left = gap + i * (width + gap);
        let picture = film.developed(EXPOSURE);
        sheet.paste(&picture, left, gap);
        sheet.paste(&enlarged(&picture, corner, (part_width, part_height), 2), left, gap * 2 + height);
        for (number, words) in text.iter().enumerate() {
            let top = gap * 3 + height + part_height * 2 + number * line;
            font::write(&mut sheet, words, left, top, scale, [225; 3]);
        }
    }
    sheet
}
