//! PLY, ASCII and binary, through the ply-rs-bw crate: vertices with x y z and optionally red green blue, and faces as
//! lists of vertex indices, triangulated as fans.

use super::sequence::StillPart;
use super::{FormatError, check_indices, check_positions};
use crate::materials::Surface;
use mbkd::glam::Vec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, Property};
use std::io::Cursor;

/// Reads the bytes of a file.
pub fn parse(bytes: &[u8]) -> Result<Vec<StillPart>, FormatError> {
    let parser = Parser::<DefaultElement>::new();
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = parser.read_header(&mut reader).map_err(|e| FormatError::new("header", e.to_string()))?;
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

    let mut indices = Vec::with_capacity(faces.len());
    for (i, face) in faces.iter().enumerate() {
        let list = face.get("vertex_indices").or_else(|| face.get("vertex_index")).and_then(index_list);
        let list =
            list.ok_or_else(|| FormatError::new(format!("face {i}"), "has no list `vertex_indices` of whole numbers"))?;
        indices.extend(list.windows(2).skip(1).map(|edge| [list[0], edge[0], edge[1]]));
    }
    check_indices("faces", &indices, positions.len())?;
    if indices.is_empty() {
        return Err(FormatError::new("", "there are no triangles in it"));
    }
    let base = if colors.len() == positions.len() { Vec3::ONE } else { Vec3::new(0.62, 0.5, 0.42) };
    let vertex_colors = if colors.len() == positions.len() { colors } else { vec![] };
    Ok(vec![StillPart { indices, positions, surface: Surface { vertex_colors, ..Surface::plain(base) } }])
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

/// A list of indices; negative ones become too large and are rejected later, with their place.
fn index_list(property: &Property) -> Option<Vec<u32>> {
    Some(match property {
        Property::ListChar(list) => list.iter().map(|&i| i as u32).collect(),
        Property::ListUChar(list) => list.iter().map(|&i| i.into()).collect(),
        Property::ListShort(list) => list.iter().map(|&i| i as u32).collect(),
        Property::ListUShort(list) => list.iter().map(|&i| i.into()).collect(),
        Property::ListInt(list) => list.iter().map(|&i| i as u32).collect(),
        Property::ListUInt(list) => list.clone(),
        _ => return None,
    })
}
