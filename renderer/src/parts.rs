//! Parts of a picture, for render farms: some samples, or a tile, of a picture as an EXR file, and merging such files.
//!
//! A part is a picture like any other EXR, with two additions: the exact sums of its samples, and a description of the
//! whole picture. Sums are whole numbers, so parts merge to exactly the bits of the picture that is rendered in one go.

use crate::film::{Film, Region};
use crate::render::Job;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, ReadChannels, ReadLayers, Text, Vec2, WritableImage, read,
};
use std::io::Cursor;
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

/// Names of attributes.
const ABOUT: &str = "mbkd.about";
const EXPOSURE: &str = "mbkd.exposure";
const SAMPLES: &str = "mbkd.samples";
const FIRST: &str = "mbkd.first";
const END: &str = "mbkd.end";

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

    /// Writes the part as an EXR file. Fails if the description is not Latin text.
    pub fn save(&self, path: &Path) -> Result<(), String> {
        let linear = self.film.linear();
        let mean = |(name, color): (&str, usize)| {
            AnyChannel::new(name, FlatSamples::F32(linear.iter().map(|pixel| pixel[color]).collect()))
        };
        let half = |(name, color, shift): (&str, usize, u32)| {
            let words = self.film.sums.iter().map(|sum| (sum[color] as u64 >> shift) as u32);
            AnyChannel::new(name, FlatSamples::U32(words.collect()))
        };
        let means = [("R", 0), ("G", 1), ("B", 2)].map(mean);
        let channels = AnyChannels::sort(means.into_iter().chain(HALVES.map(half)).collect());
        let about = Text::new_or_none(&self.whole.about).ok_or("the description has letters that EXR cannot hold")?;
        let Region { x, y, width, height } = self.region;
        let mut attributes = LayerAttributes { layer_position: Vec2(x as i32, y as i32), ..Default::default() };
        attributes.other.extend([
            (Text::from(ABOUT), AttributeValue::Text(about)),
            (Text::from(EXPOSURE), AttributeValue::F32(self.whole.exposure)),
            (Text::from(SAMPLES), AttributeValue::I32(self.whole.samples as i32)),
            (Text::from(FIRST), AttributeValue::I32(self.taken.0 as i32)),
            (Text::from(END), AttributeValue::I32(self.taken.1 as i32)),
        ]);
        let layer = Layer::new((width, height), attributes, Encoding::SMALL_LOSSLESS, channels);
        let display = IntegerBounds::from_dimensions((self.whole.size[0], self.whole.size[1]));
        let image = Image::new(ImageAttributes::new(display), layer);
        image.write().to_file(path).map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Reads a part.
    pub fn open(path: &Path) -> Result<Part, String> {
        let read = || Part::read(&std::fs::read(path).map_err(|e| e.to_string())?);
        read().map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Reads the bytes of a file.
    fn read(bytes: &[u8]) -> Result<Part, String> {
        let layers = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
        let image = layers.all_attributes().from_buffered(Cursor::new(bytes)).map_err(|e| e.to_string())?;
        let (display, layer) = (image.attributes.display_window, image.layer_data);
        let Vec2(width, height) = layer.size;
        let missing = || "this is a whole picture; parts are written with --samples or --tile".to_string();
        let attribute = |name: &str| layer.attributes.other.get(&Text::from(name)).ok_or_else(missing);
        let number = |name: &str| match attribute(name)? {
            &AttributeValue::I32(number) => u32::try_from(number).map_err(|_| format!("{name} is {number}")),
            _ => Err(missing()),
        };
        let (AttributeValue::Text(about), &AttributeValue::F32(exposure)) = (attribute(ABOUT)?, attribute(EXPOSURE)?)
        else {
            return Err(missing());
        };
        let size = [display.size.0, display.size.1];
        let whole = Whole { size, samples: number(SAMPLES)?, exposure, about: about.to_string() };
        let taken = (number(FIRST)?, number(END)?);
        if taken.0 >= taken.1 || taken.1 > whole.samples {
            return Err(format!("invalid sample range {}..{} of {}", taken.0, taken.1, whole.samples));
        }
        let inside = |at: i32, count: usize, all: usize| {
            let at = usize::try_from(at).ok().filter(|at| at.checked_add(count).is_some_and(|end| end <= all));
            at.ok_or("its window is not inside of the picture")
        };
        let Vec2(x, y) = layer.attributes.layer_position;
        let region = Region { x: inside(x, width, size[0])?, y: inside(y, height, size[1])?, width, height };
        let mut film = Film::new(width, height);
        for (name, color, shift) in HALVES {
            let channel = layer.channel_data.list.iter().find(|channel| channel.name.eq(name)).ok_or_else(missing)?;
            let FlatSamples::U32(words) = &channel.sample_data else { return Err(missing()) };
            for (sum, &word) in film.sums.iter_mut().zip(words) {
                sum[color] |= (u64::from(word) << shift) as i64;
            }
        }
        film.samples.fill(taken.1 - taken.0);
        Ok(Part { whole, taken, region, film })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_broken_file_is_an_error() {
        let mut film = Film::new(3, 2);
        (0..6).for_each(|i| film.add_units(i, [i as i64 - 3, 1 << 40, -(1 << 33)], 2));
        let whole = Whole { size: [7, 5], samples: 4, exposure: 0.5, about: "about".into() };
        let part = Part { whole, taken: (1, 3), region: Region { x: 2, y: 1, width: 3, height: 2 }, film };
        let path = std::env::temp_dir().join(format!("mbkd_part_{}.exr", std::process::id()));
        part.save(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(Part::read(&bytes).unwrap(), part);
        for end in 0..bytes.len() {
            assert!(Part::read(&bytes[..end]).is_err(), "the first {end} bytes");
        }
        for at in 0..bytes.len() {
            for value in [0, 1, 0x7f, 0xff] {
                let mut broken = bytes.clone();
                broken[at] = value;
                // An error or another part, but no panic.
                let _ = Part::read(&broken);
            }
        }
    }
}
