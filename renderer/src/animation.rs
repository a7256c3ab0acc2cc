//! A sequence: numbered PNGs and one animated GIF, each frame with its own shutter.
//!
//! A frame of a GIF has 256 colours. Pixels that are equal to those of the frame before are transparent, and frames
//! share a palette while it fits: static regions neither take space nor flicker, and uncovered regions look as before.

use crate::film::Picture;
use color_quant::NeuQuant;
use gif::{Encoder, Frame, Repeat};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A GIF being written.
pub struct Animation {
    path: PathBuf,
    /// Created with the first frame, whose size all frames have.
    encoder: Option<Encoder<BufWriter<File>>>,
    /// The previous frame and its palette.
    last: Option<(Picture, Palette)>,
    seconds_per_frame: f64,
}

impl Animation {
    /// Starts a GIF that loops forever.
    pub fn begin(path: PathBuf, seconds_per_frame: f64) -> Animation {
        Animation { path, encoder: None, last: None, seconds_per_frame }
    }

    /// Ends the file, if it has a frame. (Were it only dropped, an error of the last bytes would be lost.)
    pub fn end(self) -> Result<(), String> {
        let Animation { path, encoder, .. } = self;
        let Some(encoder) = encoder else { return Ok(()) };
        let fail = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
        encoder.into_inner().map_err(|e| fail(&e))?.flush().map_err(|e| fail(&e))
    }

    /// Adds a frame.
    pub fn add(&mut self, picture: &Picture) -> Result<(), String> {
        let fail = |e: &dyn std::fmt::Display| format!("{}: {e}", self.path.display());
        let side = |pixels: usize| u16::try_from(pixels).map_err(|e| fail(&e));
        let (width, height) = (side(picture.width)?, side(picture.height)?);
        let last = self.last.take();
        let palette = match &last {
            Some((_, palette)) if palette.serves(picture) => palette.clone(),
            _ => Palette::of(picture),
        };
        let indices = changes(picture, last.as_ref().map(|last| &last.0), &palette);
        let mut frame = Frame::from_palette_pixels(width, height, indices, palette.padded(), Some(AS_IT_IS));
        self.last = Some((picture.clone(), palette));
        // In hundredths of a second. Viewers slow down animations with more than 50 frames a second.
        frame.delay = (100.0 * self.seconds_per_frame.clamp(0.02, 10.0)).round() as u16;
        if self.encoder.is_none() {
            let file = BufWriter::new(File::create(&self.path).map_err(|e| fail(&e))?);
            let mut encoder = Encoder::new(file, width, height, &[]).map_err(|e| fail(&e))?;
            encoder.set_repeat(Repeat::Infinite).map_err(|e| fail(&e))?;
            self.encoder = Some(encoder);
        }
        match &mut self.encoder {
            Some(encoder) => encoder.write_frame(&frame).map_err(|e| format!("{}: {e}", self.path.display())),
            None => Ok(()),
        }
    }
}

/// The transparent colour index; those of a palette are smaller.
const AS_IT_IS: u8 = 255;

/// A colour index for each pixel that has changed; transparent for the others.
fn changes(picture: &Picture, last: Option<&Picture>, palette: &Palette) -> Vec<u8> {
    let stays = |at: usize, pixel: [u8; 3]| last.is_some_and(|last| last.pixels[at] == pixel);
    let index = |(at, &pixel): (usize, &[u8; 3])| if stays(at, pixel) { AS_IT_IS } else { palette.nearest(pixel).0 };
    picture.pixels.iter().enumerate().map(index).collect()
}

/// Colours chosen for a picture.
#[derive(Clone)]
struct Palette {
    colors: Vec<[u8; 3]>,
    /// Sum of the squared distances of the picture's pixels from their palette colours.
    error: u64,
}

impl Palette {
    /// A palette for a picture: its own colours, if they are few.
    fn of(picture: &Picture) -> Palette {
        let most = usize::from(AS_IT_IS);
        let mut own = BTreeSet::new();
        let few = picture.pixels.iter().all(|pixel| {
            own.insert(*pixel);
            own.len() <= most
        });
        let colors = if few {
            own.into_iter().collect()
        } else {
            let pixels: Vec<u8> = picture.pixels.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect();
            // Sampling factor 1 (all pixels) is the most accurate.
            NeuQuant::new(1, most, &pixels).color_map_rgb().as_chunks().0.to_vec()
        };
        let palette = Palette { colors, error: 0 };
        Palette { error: palette.error(picture), ..palette }
    }

    /// Whether it fits another picture of that size about as well.
    fn serves(&self, picture: &Picture) -> bool {
        2 * self.error(picture) <= 3 * self.error + picture.pixels.len() as u64
    }

    fn error(&self, picture: &Picture) -> u64 {
        picture.pixels.iter().map(|pixel| u64::from(self.nearest(*pixel).1)).sum()
    }

    /// The index of the nearest colour, and its squared distance.
    fn nearest(&self, [r, g, b]: [u8; 3]) -> (u8, u32) {
        let square = |a: u8, b: u8| u32::from(a.abs_diff(b)).pow(2);
        let distance = |color: &[u8; 3]| square(color[0], r) + square(color[1], g) + square(color[2], b);
        let distances = self.colors.iter().map(distance).enumerate();
        distances.min_by_key(|found| found.1).map_or((0, 0), |(number, distance)| (number as u8, distance))
    }

    /// The palette as files have it, with an entry for [`AS_IT_IS`].
    fn padded(&self) -> Vec<u8> {
        let mut colors = self.colors.clone();
        colors.resize(usize::from(AS_IT_IS) + 1, [0; 3]);
        colors.into_flattened()
    }
}

/// The file of one frame: `name_007.png` for `name.png`.
pub fn numbered(path: &Path, frame: u32) -> PathBuf {
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let extension = path.extension().map(|e| e.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!("{stem}_{frame:03}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_numbered_before_the_extension() {
        assert_eq!(numbered(Path::new("a/b.c.png"), 7), Path::new("a/b.c_007.png"));
    }

    /// A picture of few or many colours that change with time, except for a quarter of the pixels.
    fn picture(levels: usize, time: usize) -> Picture {
        let color = |at: usize| match at {
            0..600 => [7, 8, 9],
            _ => [1, 7, 3].map(|step| ((at * step + 97 * time) % levels * 5 + 30 * time) as u8),
        };
        Picture { width: 60, height: 40, pixels: (0..2400).map(color).collect() }
    }

    #[test]
    fn only_what_changes_is_drawn_in_near_colours() {
        for (levels, farthest) in [(3, 0), (41, 40 * 40)] {
            let [first, second] = [0, 1].map(|time| picture(levels, time));
            let palette = Palette::of(&second);
            let indices = changes(&second, Some(&first), &palette);
            for (at, (&index, pixel)) in indices.iter().zip(&second.pixels).enumerate() {
                assert_eq!(index == AS_IT_IS, at < 600, "pixel {at}");
                let (nearest, distance) = palette.nearest(*pixel);
                assert!(at < 600 || index == nearest && distance <= farthest, "{levels} levels: {distance}");
            }
            assert!(changes(&first, None, &palette).iter().all(|index| *index != AS_IT_IS));
            assert_eq!(palette.padded().len(), 3 * 256);
        }
    }

    /// A device that takes no byte, where there is one.
    #[test]
    fn a_full_disk_is_an_error() {
        let full = Path::new("/dev/full");
        if full.exists() {
            let mut animation = Animation::begin(full.into(), 0.1);
            animation.add(&picture(3, 0)).unwrap();
            assert!(animation.end().unwrap_err().starts_with("/dev/full: "));
        }
        assert_eq!(Animation::begin("none.gif".into(), 0.1).end(), Ok(()));
    }

    #[test]
    fn a_palette_fits_pictures_of_its_colours() {
        let palette = Palette::of(&picture(41, 0));
        let mut turned = picture(41, 0);
        turned.pixels.reverse();
        assert!(palette.serves(&turned) && !palette.serves(&picture(41, 3)));
        let few = Palette::of(&picture(3, 0));
        assert!(few.serves(&picture(3, 0)) && !few.serves(&picture(3, 2)));
    }
}
