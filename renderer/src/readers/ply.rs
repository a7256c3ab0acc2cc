//! PLY, ASCII and binary, through the ply-rs-bw crate: vertices with x y z and optionally red green blue, and faces as
//! lists of vertex indices.

use super::polygons::Polygons;
use super::sequence::StillPart;
use super::{FormatError, check_positions, without_mark};
use crate::materials::Surface;
use mbkd::glam::Vec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, Encoding, Property};
use std::io::Cursor;

/// Reads the bytes of a file.
pub fn parse(bytes: &[u8]) -> Result<Vec<StillPart>, FormatError> {
    let parser = Parser::<DefaultElement>::new();
    let bytes = without_mark(bytes);
    let read_header = |reader: &mut Reader<Cursor<&[u8]>>| {
        parser.read_header(reader).map_err(|e| FormatError::new("header", e.to_string()))
    };
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = read_header(&mut reader)?;
    // Nothing is allocated for more elements than the rest of the file can hold.
    let body = bytes.windows(10).position(|w| w == b"end_header").map_or(bytes.len(), |at| at + 10);
    let rest = bytes.len() - body;
    for (name, element) in &header.elements {
        // A property takes at least one byte in any encoding.
        if element.count.saturating_mul(element.properties.len().max(1)) > rest {
            let what = format!("{} of them promised, but only {rest} bytes follow", element.count);
            return Err(FormatError::new(format!("element `{name}`"), what));
        }
    }
    let text;
    if header.encoding == Encoding::Ascii {
        text = with_digits(bytes);
        reader = Reader::new(Cursor::new(&text));
        read_header(&mut reader)?;
    }
    let mut payload = parser.read_payload(&mut reader, &header).map_err(|e| FormatError::new("body", e.to_string()))?;
    let vertices =
        payload.swap_remove("vertex").ok_or_else(|| FormatError::new("header", "there is no element `vertex`"))?;
    let faces = payload.swap_remove("face").ok_or_else(|| FormatError::new("header", "there is no element `face`"))?;

    let mut positions = Vec::with_capacity(vertices.len());
    let mut colors = Vec::new();
    for (i, vertex) in vertices.iter().enumerate() {
        let get = |name: &str| vertex.get(name).and_then(number).map(|x| x as f32);
        let (Some(x), Some(y), Some(z)) = (get("x"), get("y"), get("z")) else {
            return Err(FormatError::new(format!("vertex {i}"), "has no numbers x, y and z"));
        };
        positions.push(Vec3::new(x, y, z));
        let channel = |name: &str| match vertex.get(name) {
            Some(Property::UChar(byte)) => Some(crate::film::decode(*byte)),
            Some(other) => number(other).map(|x| (x as f32).clamp(0.0, 1.0)),
            None => None,
        };
        if let (Some(r), Some(g), Some(b)) = (channel("red"), channel("green"), channel("blue")) {
            colors.push(Vec3::new(r, g, b));
        }
    }
    check_positions("vertices", &positions)?;

    let mut polygons = Polygons::default();
    let mut corners = Vec::new();
    for (i, face) in faces.iter().enumerate() {
        let place = || format!("face {i}");
        let list = face.get("vertex_indices").or_else(|| face.get("vertex_index")).and_then(index_list);
        let list = list.ok_or_else(|| FormatError::new(place(), "has no list `vertex_indices` of whole numbers"))?;
        corners.clear();
        for index in list {
            let known = usize::try_from(index).is_ok_and(|i| i < positions.len());
            if !known {
                let what = format!("names vertex {index}, but there are only {}", positions.len());
                return Err(FormatError::new(place(), what));
            }
            corners.push(index as u32);
        }
        polygons.push(&corners);
    }
    if polygons.is_empty() {
        return Err(FormatError::new("", "there are no triangles in it"));
    }
    let base = if colors.len() == positions.len() { Vec3::ONE } else { Vec3::new(0.62, 0.5, 0.42) };
    let vertex_colors = if colors.len() == positions.len() { colors } else { vec![] };
    let surface = Surface { vertex_colors, ..Surface::plain(base) };
    Ok(vec![StillPart { faces: polygons, positions, surface }])
}

/// A text with a digit on either side of a point next to a digit: the parser refuses `.5` and `5.`.
fn with_digits(bytes: &[u8]) -> Vec<u8> {
    let is_digit = |at: Option<usize>| at.and_then(|at| bytes.get(at)).is_some_and(u8::is_ascii_digit);
    let mut text = Vec::with_capacity(bytes.len());
    for (at, &byte) in bytes.iter().enumerate() {
        let point = byte == b'.';
        let (before, after) = (is_digit(at.checked_sub(1)), is_digit(Some(at + 1)));
        if point && after && !before {
            text.push(b'0');
        }
        text.push(byte);
        if point && before && !after {
            text.push(b'0');
        }
    }
    text
}

fn number(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(x) => x.into(),
        Property::UChar(x) => x.into(),
        Property::Short(x) => x.into(),
        Property::UShort(x) => x.into(),
        Property::Int(x) => x.into(),
        Property::UInt(x) => x.into(),
        Property::Float(x) => x.into(),
        Property::Double(x) => x,
        _ => return None,
    })
}

/// A list of indices, which may be negative.
fn index_list(property: &Property) -> Option<Vec<i64>> {
    fn wide<T: Copy + Into<i64>>(list: &[T]) -> Vec<i64> {
        list.iter().map(|&i| i.into()).collect()
    }
    Some(match property {
        Property::ListChar(list) => wide(list),
        Property::ListUChar(list) => wide(list),
        Property::ListShort(list) => wide(list),
        Property::ListUShort(list) => wide(list),
        Property::ListInt(list) => wide(list),
        Property::ListUInt(list) => wide(list),
        _ => return None,
    })
}
