//! OpenEXR in its simplest form: one part, uncompressed rows of 32-bit channels ("Technical Introduction to OpenEXR"
//! and "OpenEXR File Layout", openexr.com). Every reader accepts it. Only files of the same form are read.

use mbkd::glam::Vec3;

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

/// A channel: a number for each pixel, row by row from the top.
pub enum Channel {
    /// Type 2.
    Float(Vec<f32>),
    /// Type 0.
    Whole(Vec<u32>),
}

/// A picture of some channels, of which a window is present.
pub struct Exr {
    /// Columns and rows of the whole picture.
    pub display: [usize; 2],
    /// The window that is present.
    pub window: Region,
    /// Sorted by the bytes of their names.
    pub channels: Vec<(String, Channel)>,
    /// Further attributes: name, type, bytes.
    pub attributes: Vec<(String, String, Vec<u8>)>,
}

/// Magic number; version 2, no flags.
const BEGIN: [u8; 8] = [0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];

/// The file of a picture of colours, row by row from the top.
pub fn picture(width: usize, height: usize, pixels: &[Vec3]) -> Vec<u8> {
    let window = Region { x: 0, y: 0, width, height };
    Exr { display: [width, height], window, channels: colors(pixels), attributes: vec![] }.file()
}

/// Colours as channels.
pub fn colors(pixels: &[Vec3]) -> Vec<(String, Channel)> {
    let channel = |(name, i): (&str, usize)| (name.into(), Channel::Float(pixels.iter().map(|p| p[i]).collect()));
    [("B", 2), ("G", 1), ("R", 0)].map(channel).into()
}

impl Exr {
    /// The bytes of the file.
    pub fn file(&self) -> Vec<u8> {
        let mut bytes = BEGIN.to_vec();
        let mut attribute = |name: &str, kind: &str, value: &[u8]| {
            for text in [name, kind] {
                bytes.extend(text.bytes());
                bytes.push(0);
            }
            bytes.extend((value.len() as u32).to_le_bytes());
            bytes.extend(value);
        };
        let mut channels = Vec::new();
        for (name, channel) in &self.channels {
            // Name, type, not perceptually linear, no subsampling.
            let kind = if matches!(channel, Channel::Float(_)) { 2 } else { 0 };
            channels.extend(name.bytes().chain([0]));
            channels.extend([kind, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]);
        }
        channels.push(0);
        let Region { x, y, width, height } = self.window;
        let window = |x: usize, y: usize, width: usize, height: usize| {
            [x, y, x + width - 1, y + height - 1].map(|edge| (edge as i32).to_le_bytes()).concat()
        };
        attribute("channels", "chlist", &channels);
        attribute("compression", "compression", &[0]);
        attribute("dataWindow", "box2i", &window(x, y, width, height));
        attribute("displayWindow", "box2i", &window(0, 0, self.display[0], self.display[1]));
        attribute("lineOrder", "lineOrder", &[0]);
        attribute("pixelAspectRatio", "float", &1f32.to_le_bytes());
        attribute("screenWindowCenter", "v2f", &[0; 8]);
        attribute("screenWindowWidth", "float", &1f32.to_le_bytes());
        self.attributes.iter().for_each(|(name, kind, value)| attribute(name, kind, value));
        bytes.push(0);
        // The offset of each row: behind this table, rows have a header of 8 bytes.
        let (first, row) = (bytes.len() + 8 * height, 4 * self.channels.len() * width);
        bytes.extend((0..height).flat_map(|y| ((first + y * (8 + row)) as u64).to_le_bytes()));
        for line in 0..height {
            bytes.extend(((y + line) as i32).to_le_bytes());
            bytes.extend((row as u32).to_le_bytes());
            let pixels = line * width..(line + 1) * width;
            for (_, channel) in &self.channels {
                match channel {
                    Channel::Float(all) => bytes.extend(all[pixels.clone()].iter().flat_map(|x| x.to_le_bytes())),
                    Channel::Whole(all) => bytes.extend(all[pixels.clone()].iter().flat_map(|x| x.to_le_bytes())),
                }
            }
        }
        bytes
    }

    /// Reads a file of this form; for other files the error says how they differ.
    pub fn parse(bytes: &[u8]) -> Result<Exr, String> {
        let mut rest = bytes.strip_prefix(&BEGIN).ok_or("not an EXR file of one part with rows")?;
        let (mut windows, mut channels, mut attributes) = ([None; 2], None, Vec::new());
        loop {
            let name = text(&mut rest)?;
            if name.is_empty() {
                break;
            }
            let kind = text(&mut rest)?;
            let length = u32::from_le_bytes(array(&mut rest)?) as usize;
            let value = rest.split_off(..length).ok_or(SHORT)?;
            match name.as_str() {
                "channels" => channels = Some(channel_list(value)?),
                "compression" if value == [0] => {}
                "compression" => return Err("it is compressed; merge what motion_blur wrote".into()),
                "dataWindow" => windows[0] = Some(box_of(value)?),
                "displayWindow" => windows[1] = Some(box_of(value)?),
                "lineOrder" | "pixelAspectRatio" | "screenWindowCenter" | "screenWindowWidth" => {}
                _ => attributes.push((name, kind, value.to_vec())),
            }
        }
        let ([Some(window), Some(display)], Some(channels)) = (windows, channels) else {
            return Err("it has no channels or no window".into());
        };
        if window.x + window.width > display.width || window.y + window.height > display.height {
            return Err("its window is not inside of the picture".into());
        }
        rest = rest.get(8 * window.height..).ok_or(SHORT)?;
        let mut values: Vec<Vec<u32>> = vec![Vec::new(); channels.len()];
        for line in 0..window.height {
            let (y, length) = (i32::from_le_bytes(array(&mut rest)?), u32::from_le_bytes(array(&mut rest)?));
            if (y as usize, length as usize) != (window.y + line, 4 * channels.len() * window.width) {
                return Err(format!("its row {line} is not where it should be"));
            }
            for column in &mut values {
                let row = rest.split_off(..4 * window.width).ok_or(SHORT)?;
                column.extend(row.as_chunks().0.iter().map(|&word| u32::from_le_bytes(word)));
            }
        }
        let channel = |((name, float), values): ((String, bool), Vec<u32>)| match float {
            true => (name, Channel::Float(values.into_iter().map(f32::from_bits).collect())),
            false => (name, Channel::Whole(values)),
        };
        let channels = channels.into_iter().zip(values).map(channel).collect();
        Ok(Exr { display: [display.width, display.height], window, channels, attributes })
    }

    /// The bytes of a further attribute.
    pub fn attribute(&self, name: &str) -> Option<&[u8]> {
        self.attributes.iter().find(|(other, ..)| other == name).map(|(.., value)| &value[..])
    }

    /// A channel of whole numbers.
    pub fn whole(&self, name: &str) -> Option<&[u32]> {
        self.channels.iter().find_map(|(other, channel)| match channel {
            Channel::Whole(values) if other == name => Some(&values[..]),
            _ => None,
        })
    }
}

const SHORT: &str = "it ends too early";

/// Text up to a zero byte.
fn text(rest: &mut &[u8]) -> Result<String, String> {
    let end = rest.iter().position(|&byte| byte == 0).ok_or(SHORT)?;
    let text = String::from_utf8_lossy(&rest[..end]).into_owned();
    *rest = &rest[end + 1..];
    Ok(text)
}

fn array<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], String> {
    let (first, others) = rest.split_first_chunk().ok_or(SHORT)?;
    *rest = others;
    Ok(*first)
}

/// Names of channels, and whether they are of type f32.
fn channel_list(mut value: &[u8]) -> Result<Vec<(String, bool)>, String> {
    let mut channels = Vec::new();
    loop {
        let name = text(&mut value)?;
        if name.is_empty() {
            return Ok(channels);
        }
        let about: [u8; 16] = array(&mut value)?;
        if about[0] == 1 || about[8..] != [1, 0, 0, 0, 1, 0, 0, 0] {
            return Err(format!("its channel {name} is not of 32 bits per pixel"));
        }
        channels.push((name, about[0] == 2));
    }
}

fn box_of(mut value: &[u8]) -> Result<Region, String> {
    let mut edge = || Ok::<_, String>(i64::from(i32::from_le_bytes(array(&mut value)?)));
    let [x, y, right, below] = [edge()?, edge()?, edge()?, edge()?];
    let fine = 0 <= x && x <= right && 0 <= y && y <= below && below.max(right) < 1 << 16;
    let size = |from: i64, to: i64| (to - from + 1) as usize;
    let window = || Region { x: x as usize, y: y as usize, width: size(x, right), height: size(y, below) };
    fine.then(window).ok_or_else(|| "its window is empty or too large".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Exr {
        let channels = vec![
            ("B".into(), Channel::Float(vec![0.5; 6])),
            ("count".into(), Channel::Whole((0..6).map(|i| u32::MAX - i).collect())),
        ];
        let attributes = vec![("note".into(), "string".into(), b"hello".to_vec())];
        Exr { display: [7, 5], window: Region { x: 2, y: 1, width: 3, height: 2 }, channels, attributes }
    }

    #[test]
    fn what_is_written_is_read() {
        let bytes = example().file();
        let read = Exr::parse(&bytes).unwrap();
        assert_eq!((read.display, read.window), ([7, 5], Region { x: 2, y: 1, width: 3, height: 2 }));
        assert_eq!(read.attribute("note"), Some(&b"hello"[..]));
        assert_eq!(read.whole("count").unwrap()[5], u32::MAX - 5);
        assert!(read.whole("B").is_none() && read.file() == bytes);
    }

    #[test]
    fn a_broken_file_is_an_error() {
        let bytes = example().file();
        for end in 0..bytes.len() {
            assert!(Exr::parse(&bytes[..end]).is_err(), "the first {end} bytes");
        }
        for at in 0..bytes.len() {
            for value in [0, 1, 0x7f, 0xff] {
                let mut broken = bytes.clone();
                broken[at] = value;
                // An error or another picture, but no panic.
                let _ = Exr::parse(&broken);
            }
        }
    }
}
