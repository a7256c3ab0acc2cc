//! Parts of a picture, for render farms: some samples, or a tile, of a picture as an EXR file, and merging such files.
//!
//! A part is a picture like any other EXR, with two additions: the exact sums of its samples, and a description of the
//! whole picture. Sums are whole numbers, so parts merge to exactly the bits of the picture that is rendered in one go.

use crate::exr::{Channel, Exr, Region, colors};
use crate::film::Film;
use crate::render::Job;
use std::path::Path;

/// The description of the whole picture, equal in all of its parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Whole {
    /// Pixels across and rows.
    pub size: [usize; 2],
    /// Samples per pixel.
    pub samples: u32,
    /// Exposure, for the bytes of a PNG.
    pub exposure: f32,
    /// All other options that determine the picture, as text.
    pub about: String,
}

/// A part of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The whole picture.
    pub whole: Whole,
    /// Its samples: from the first number to before the second.
    pub taken: (u32, u32),
    /// Its region.
    pub region: Region,
    /// The sums.
    pub film: Film,
}

/// Channels of a sum: name, index of the colour channel, and shift of the half.
const HALVES: [(&str, usize, u32); 6] = [
    ("sum.B.high", 2, 32),
    ("sum.B.low", 2, 0),
    ("sum.G.high", 1, 32),
    ("sum.G.low", 1, 0),
    ("sum.R.high", 0, 32),
    ("sum.R.low", 0, 0),
];

impl Part {
    /// The part of the picture described by `about` that a job rendered.
    pub fn new(job: &Job, film: Film, exposure: f32, about: String) -> Part {
        let whole = Whole { size: [job.width, job.height], samples: job.samples, exposure, about };
        Part { whole, taken: job.taken, region: job.region, film }
    }

    /// Writes the part as an EXR file.
    pub fn save(&self, path: &Path) -> Result<(), String> {
        let half = |(name, color, shift): (&str, usize, u32)| {
            let words = self.film.sums.iter().map(|sum| (sum[color] as u64 >> shift) as u32);
            (name.to_string(), Channel::Whole(words.collect()))
        };
        let mut channels = colors(&self.film.linear());
        channels.extend(HALVES.map(half));
        let text = |name: &str, value: &str| (name.to_string(), "string".to_string(), value.as_bytes().to_vec());
        let number = |name: &str, kind: &str, value: [u8; 4]| (name.to_string(), kind.to_string(), value.to_vec());
        let attributes = vec![
            text("mbkd.about", &self.whole.about),
            number("mbkd.exposure", "float", self.whole.exposure.to_le_bytes()),
            number("mbkd.samples", "int", self.whole.samples.to_le_bytes()),
            number("mbkd.first", "int", self.taken.0.to_le_bytes()),
            number("mbkd.end", "int", self.taken.1.to_le_bytes()),
        ];
        let file = Exr { display: self.whole.size, window: self.region, channels, attributes }.file();
        std::fs::write(path, file).map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Reads a part.
    pub fn open(path: &Path) -> Result<Part, String> {
        let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
        Exr::parse(&bytes).and_then(|file| Part::of(&file)).map_err(|e| format!("{}: {e}", path.display()))
    }

    fn of(file: &Exr) -> Result<Part, String> {
        let missing = || "this is a whole picture; parts are written with --samples or --tile".to_string();
        let number = |name: &str| file.attribute(name).and_then(|v| <[u8; 4]>::try_from(v).ok()).ok_or_else(missing);
        let whole = Whole {
            size: file.display,
            samples: u32::from_le_bytes(number("mbkd.samples")?),
            exposure: f32::from_le_bytes(number("mbkd.exposure")?),
            about: String::from_utf8_lossy(file.attribute("mbkd.about").ok_or_else(missing)?).into_owned(),
        };
        let taken = (u32::from_le_bytes(number("mbkd.first")?), u32::from_le_bytes(number("mbkd.end")?));
        if taken.0 >= taken.1 || taken.1 > whole.samples {
            return Err(format!("invalid sample range {}..{} of {}", taken.0, taken.1, whole.samples));
        }
        let mut film = Film::new(file.window.width, file.window.height);
        for (name, color, shift) in HALVES {
            for (sum, &word) in film.sums.iter_mut().zip(file.whole(name).ok_or_else(missing)?) {
                sum[color] |= ((u64::from(word)) << shift) as i64;
            }
        }
        film.samples.fill(taken.1 - taken.0);
        Ok(Part { whole, taken, region: file.window, film })
    }
}

/// Merges parts into a picture; each has a name for messages. The parts must cover every sample of every pixel exactly
/// once.
pub fn merge(parts: &[(String, Part)]) -> Result<(Film, Whole), String> {
    let Some((first, Part { whole, .. })) = parts.first() else { return Err("there are no parts".into()) };
    if let Some((name, _)) = parts.iter().find(|(_, part)| part.whole != *whole) {
        return Err(format!("{first} and {name} are not parts of the same picture"));
    }
    let [width, height] = whole.size;
    // Before memory is taken for the whole picture, whose size anybody may have written into a small file.
    let found: usize = parts.iter().map(|(_, part)| part.region.width * part.region.height).sum();
    if found < width * height {
        return Err(format!(
            "parts are missing: they have {found} pixels together, and the picture {}",
            width * height
        ));
    }
    let mut film = Film::new(width, height);
    for (number, (name, part)) in parts.iter().enumerate() {
        if let Some((other, _)) = parts[..number].iter().find(|(_, other)| overlap(other, part)) {
            return Err(format!("{other} and {name} have the same samples of some pixels"));
        }
        let Region { x, y, width: columns, .. } = part.region;
        for (i, (sum, samples)) in part.film.sums.iter().zip(&part.film.samples).enumerate() {
            film.add_units((y + i / columns) * width + x + i % columns, *sum, *samples);
        }
    }
    // No pixel has a sample twice, so a pixel with the full number of samples is complete.
    match film.samples.iter().position(|&n| n != whole.samples) {
        None => Ok((film, whole.clone())),
        Some(at) => {
            let pixels = film.samples.iter().filter(|&&n| n != whole.samples).count();
            let (x, y, found) = (at % width, at / width, film.samples[at]);
            Err(format!(
                "parts are missing: {pixels} pixels, the first in column {x} and row {y}, have {found} of {} samples or \
                 another number",
                whole.samples
            ))
        }
    }
}

fn overlap(a: &Part, b: &Part) -> bool {
    let apart = |a: (usize, usize), b: (usize, usize)| a.0 + a.1 <= b.0 || b.0 + b.1 <= a.0;
    let samples = a.taken.1 > b.taken.0 && b.taken.1 > a.taken.0;
    let (a, b) = (a.region, b.region);
    samples && !apart((a.x, a.width), (b.x, b.width)) && !apart((a.y, a.height), (b.y, b.height))
}
