//! OpenEXR in its simplest form: one part, uncompressed rows of 32-bit channels B, G, R ("Technical Introduction to
//! OpenEXR" and "OpenEXR File Layout", openexr.com). Every reader takes it.

use mbkd::glam::Vec3;

/// The file of a picture whose rows, `width` pixels each, run from the top.
pub fn file(width: usize, height: usize, pixels: &[Vec3]) -> Vec<u8> {
    // Magic number; version 2, no flags.
    let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        for text in [name, kind] {
            bytes.extend(text.bytes());
            bytes.push(0);
        }
        bytes.extend((value.len() as u32).to_le_bytes());
        bytes.extend(value);
    };
    // Channels in alphabetical order: name, type 2 = f32, not perceptually linear, no subsampling.
    let channel = |name: u8| [&[name, 0, 2, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0][..]].concat();
    attribute("channels", "chlist", &[channel(b'B'), channel(b'G'), channel(b'R'), vec![0]].concat());
    attribute("compression", "compression", &[0]);
    let window = [0, 0, width as i32 - 1, height as i32 - 1].map(i32::to_le_bytes).concat();
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1f32.to_le_bytes());
    bytes.push(0);
    // Where each row begins: behind this table, rows have a header of 8 bytes.
    let (first, row) = (bytes.len() + 8 * height, 12 * width);
    bytes.extend((0..height).flat_map(|y| ((first + y * (8 + row)) as u64).to_le_bytes()));
    for (y, pixels) in pixels.chunks(width).enumerate() {
        bytes.extend((y as i32).to_le_bytes());
        bytes.extend((row as u32).to_le_bytes());
        for channel in [2, 1, 0] {
            bytes.extend(pixels.iter().flat_map(|p| p[channel].to_le_bytes()));
        }
    }
    bytes
}
