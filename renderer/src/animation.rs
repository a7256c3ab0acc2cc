//! A sequence: numbered PNGs and one animated GIF, each frame with its own shutter.

use crate::film::Picture;
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbImage};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A GIF in the making.
pub struct Animation {
    path: PathBuf,
    encoder: GifEncoder<BufWriter<File>>,
    seconds_per_frame: f64,
}

impl Animation {
    /// Begins a GIF that repeats for ever.
    pub fn begin(path: PathBuf, seconds_per_frame: f64) -> Result<Animation, String> {
        let fail = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
        let file = File::create(&path).map_err(|e| fail(&e))?;
        // 1 is the slowest and finest choice of colours, 30 the fastest.
        let mut encoder = GifEncoder::new_with_speed(BufWriter::new(file), 10);
        encoder.set_repeat(Repeat::Infinite).map_err(|e| fail(&e))?;
        Ok(Animation { path, encoder, seconds_per_frame })
    }

    /// Adds a frame.
    pub fn add(&mut self, picture: &Picture) -> Result<(), String> {
        let rgb = RgbImage::from_raw(picture.width as u32, picture.height as u32, picture.bytes());
        let rgb = rgb.ok_or_else(|| format!("{}: the picture is too large", self.path.display()))?;
        let rgba = image::DynamicImage::from(rgb).into_rgba8();
        // Viewers slow down what is faster than 50 frames a second.
        let delay = Delay::from_saturating_duration(Duration::from_secs_f64(self.seconds_per_frame.clamp(0.02, 10.0)));
        let frame = Frame::from_parts(rgba, 0, 0, delay);
        self.encoder.encode_frame(frame).map_err(|e| format!("{}: {e}", self.path.display()))
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
