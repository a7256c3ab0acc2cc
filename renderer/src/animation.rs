//! A sequence: numbered PNGs and one animated GIF, each frame with its own shutter.

use crate::film::Picture;
use gif::{Encoder, Frame, Repeat};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// A GIF in the making.
pub struct Animation {
    path: PathBuf,
    /// Made with the first frame, whose size is that of all.
    encoder: Option<Encoder<BufWriter<File>>>,
    seconds_per_frame: f64,
}

impl Animation {
    /// Begins a GIF that repeats for ever.
    pub fn begin(path: PathBuf, seconds_per_frame: f64) -> Animation {
        Animation { path, encoder: None, seconds_per_frame }
    }

    /// Adds a frame.
    pub fn add(&mut self, picture: &Picture) -> Result<(), String> {
        let fail = |e: &dyn std::fmt::Display| format!("{}: {e}", self.path.display());
        let side = |pixels: usize| u16::try_from(pixels).map_err(|e| fail(&e));
        let (width, height) = (side(picture.width)?, side(picture.height)?);
        // 1 is the slowest and finest choice of colours, 30 the fastest.
        let mut frame = Frame::from_rgb_speed(width, height, picture.pixels.as_flattened(), 10);
        // In hundredths. Viewers slow down what is faster than 50 frames a second.
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
}
