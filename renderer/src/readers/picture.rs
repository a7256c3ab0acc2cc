//! Textures in models: PNG and JPEG, as 8-bit RGB.

use crate::materials::Texture;
use std::io::Cursor;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// The greatest width and height in pixels.
const LARGEST_SIDE: u32 = 1 << 14;
/// The greatest number of bytes that decoding a PNG may take in addition to its pixels.
const LARGEST_PARTS: usize = 1 << 28;

/// The greatest number of pixels of all pictures of a model: a file of one colour is a thousandth of its pixels, and a model may
/// name it any number of times.
const MOST_PIXELS: u64 = 1 << 30;

/// Decodes the pictures of a model.
pub struct Decoder {
    /// Pixels that may still be decoded.
    left: u64,
}

impl Decoder {
    pub fn new() -> Decoder {
        Decoder { left: MOST_PIXELS }
    }

    /// Decodes the bytes of a file; the format is determined by its first bytes.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<Texture, String> {
        match bytes {
            [0x89, b'P', b'N', b'G', ..] => png(bytes, &mut self.left),
            [0xff, 0xd8, ..] => jpeg(bytes, &mut self.left),
            _ => Err("neither PNG nor JPEG".into()),
        }
    }
}

/// Decodes a single picture.
#[cfg(test)]
pub fn decode(bytes: &[u8]) -> Result<Texture, String> {
    Decoder::new().decode(bytes)
}

/// Takes the pixels of a picture from those that are left; an error if the picture is too large.
fn take(left: &mut u64, (width, height): (u32, u32)) -> Result<(), String> {
    if width.max(height) > LARGEST_SIDE {
        return Err(format!("{width} x {height} pixels are more than {LARGEST_SIDE} a side"));
    }
    let pixels = u64::from(width) * u64::from(height);
    *left =
        left.checked_sub(pixels).ok_or_else(|| format!("all pictures have more than {MOST_PIXELS} pixels together"))?;
    Ok(())
}

fn png(bytes: &[u8], left: &mut u64) -> Result<Texture, String> {
    let limits = png::Limits { bytes: LARGEST_PARTS };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    let (width, height) = reader.info().size();
    take(left, (width, height))?;
    let mut data = vec![0; reader.output_buffer_size().ok_or("too many pixels")?];
    let frame = reader.next_frame(&mut data).map_err(|e| e.to_string())?;
    data.truncate(frame.buffer_size());
    let pixels = match frame.color_type {
        png::ColorType::Grayscale => data.iter().map(|&y| [y; 3]).collect(),
        png::ColorType::GrayscaleAlpha => data.chunks_exact(2).map(|p| [p[0]; 3]).collect(),
        png::ColorType::Rgb => data.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect(),
        png::ColorType::Rgba => data.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect(),
        png::ColorType::Indexed => return Err("a palette that was not resolved".into()),
    };
    Ok(Texture { width, height, pixels })
}

fn jpeg(bytes: &[u8], left: &mut u64) -> Result<Texture, String> {
    let side = LARGEST_SIDE as usize;
    let options = DecoderOptions::default().set_max_width(side).set_max_height(side);
    let mut decoder =
        JpegDecoder::new_with_options(Cursor::new(bytes), options.jpeg_set_out_colorspace(ColorSpace::RGB));
    decoder.decode_headers().map_err(|e| e.to_string())?;
    let info = decoder.info().ok_or("no header")?;
    let (width, height) = (u32::from(info.width), u32::from(info.height));
    take(left, (width, height))?;
    let data = decoder.decode().map_err(|e| e.to_string())?;
    let pixels: Vec<[u8; 3]> = data.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    if width == 0 || pixels.len() != width as usize * height as usize {
        return Err(format!("{} pixels instead of {width} x {height}", pixels.len()));
    }
    Ok(Texture { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(color: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if color == png::ColorType::Indexed {
            encoder.set_palette(vec![9, 8, 7, 1, 2, 3]);
        }
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        bytes
    }

    #[test]
    fn every_kind_of_png_becomes_rgb() {
        use png::BitDepth::{Eight, One, Sixteen};
        use png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
        for (color, depth, data, expected) in [
            (Rgb, Eight, &[1, 2, 3, 4, 5, 6][..], [[1, 2, 3], [4, 5, 6]]),
            (Rgba, Eight, &[1, 2, 3, 0, 4, 5, 6, 255], [[1, 2, 3], [4, 5, 6]]),
            (Grayscale, Eight, &[7, 8], [[7; 3], [8; 3]]),
            (GrayscaleAlpha, Eight, &[7, 0, 8, 255], [[7; 3], [8; 3]]),
            (Grayscale, Sixteen, &[7, 99, 8, 99], [[7; 3], [8; 3]]),
            (Indexed, One, &[0b0100_0000], [[9, 8, 7], [1, 2, 3]]),
        ] {
            let picture = decode(&written(color, depth, data)).unwrap();
            assert_eq!((picture.width, picture.height, &picture.pixels[..]), (2, 1, &expected[..]), "{color:?}");
        }
    }

    /// Sixteen by sixteen grey pixels: four blocks of which all coefficients are zero, in two bits each.
    fn grey_jpeg() -> Vec<u8> {
        let one_code = |table: u8| [&[0xff, 0xc4, 0, 20, table, 1][..], &[0; 16]].concat();
        [
            &[0xff, 0xd8, 0xff, 0xdb, 0, 67, 0][..],
            &[1; 64],
            &[0xff, 0xc0, 0, 11, 8, 0, 16, 0, 16, 1, 1, 0x11, 0],
            &one_code(0),
            &one_code(0x10),
            &[0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0, 0, 0xff, 0xd9],
        ]
        .concat()
    }

    #[test]
    fn all_pictures_of_a_model_have_a_limit() {
        let png = written(png::ColorType::Grayscale, png::BitDepth::Eight, &[7, 8]);
        let mut decoder = Decoder { left: 5 };
        assert!(decoder.decode(&png).is_ok() && decoder.decode(&png).is_ok());
        assert!(decoder.decode(&png).unwrap_err().contains("pixels together"));
        let jpeg = grey_jpeg();
        assert_eq!(Decoder { left: 256 }.decode(&jpeg).map(|picture| picture.pixels.len()), Ok(256));
        assert!(Decoder { left: 255 }.decode(&jpeg).unwrap_err().contains("pixels together"));
    }

    #[test]
    fn broken_pictures_are_errors() {
        let whole = written(png::ColorType::Rgb, png::BitDepth::Eight, &[1, 2, 3, 4, 5, 6]);
        for end in 0..whole.len() - 12 {
            assert!(decode(&whole[..end]).is_err(), "{end} bytes");
        }
        assert!(decode(&[0xff, 0xd8, 0xff, 0xe0, 0, 16]).is_err());
        assert!(decode(b"GIF89a").unwrap_err().contains("neither"));
    }
}
