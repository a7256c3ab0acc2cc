//! Wavefront OBJ, through the tobj crate, with the diffuse colours of its material file if that exists.

use super::polygons::Polygons;
use super::sequence::StillPart;
use super::{FormatError, check_positions, without_mark};
use crate::materials::Surface;
use mbkd::glam::Vec3;
use std::io::{BufReader, Cursor};
use std::path::Path;

/// Reads the bytes of a file; its material file is read from the same folder.
pub fn parse(bytes: &[u8], file: &Path) -> Result<Vec<StillPart>, FormatError> {
    let bytes = &with_all_colors(plain_lines(without_mark(bytes)))[..];
    let options = tobj::LoadOptions { ignore_points: true, ignore_lines: true, ..Default::default() };
    let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
    // A missing material file is not an error.
    let materials = |name: &Path| match super::read_file(&folder.join(name)) {
        Ok(bytes) => tobj::load_mtl_buf(&mut BufReader::new(Cursor::new(with_three_numbers(without_mark(&bytes))))),
        Err(_) => Err(tobj::LoadError::OpenFileFailed),
    };
    let (models, materials) = tobj::load_obj_buf(&mut BufReader::new(Cursor::new(bytes)), &options, materials)
        .map_err(|e| FormatError::new(line_of(bytes), e.to_string()))?;
    let materials = materials.unwrap_or_default();
    let mut parts = Vec::new();
    for model in models {
        let mesh = model.mesh;
        let place = format!("object `{}`", model.name);
        let positions: Vec<Vec3> = mesh.positions.chunks_exact(3).map(Vec3::from_slice).collect();
        check_positions(&place, &positions)?;
        let faces = faces(&mesh).map_err(|what| FormatError::new(&place, what))?;
        if faces.is_empty() {
            continue;
        }
        let color = mesh.material_id.and_then(|id| materials.get(id)?.diffuse).map(Vec3::from);
        let color =
            color.filter(|c| c.is_finite()).map_or(Vec3::new(0.62, 0.5, 0.42), |c| c.clamp(Vec3::ZERO, Vec3::ONE));
        let colors = mesh.vertex_color.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>();
        let vertex_colors = if colors.iter().all(|c| c.is_finite()) { colors } else { vec![] };
        parts.push(StillPart { faces, positions, surface: Surface { vertex_colors, ..Surface::plain(color) } });
    }
    if parts.is_empty() {
        return Err(FormatError::new("", "there are no triangles in it"));
    }
    Ok(parts)
}

/// The faces of a mesh.
fn faces(mesh: &tobj::Mesh) -> Result<Polygons, &'static str> {
    let mut faces = Polygons::default();
    // The sizes of faces are left out if all are triangles.
    if mesh.face_arities.is_empty() {
        mesh.indices.chunks_exact(3).for_each(|face| faces.push(face));
        return Ok(faces);
    }
    let mut rest = &mesh.indices[..];
    for &size in &mesh.face_arities {
        let (face, after) = rest.split_at_checked(size as usize).unwrap_or((&[], &[]));
        if face.is_empty() {
            return Err("a face has no corners");
        }
        faces.push(face);
        rest = after;
    }
    Ok(faces)
}

/// The file as tobj takes it: with continued lines joined, and without lines (`l`), which tobj takes for faces if they have more
/// than two points. Lines keep their numbers: empty ones follow joined ones.
fn plain_lines(bytes: &[u8]) -> Vec<u8> {
    let mut plain = Vec::with_capacity(bytes.len() + 1);
    let (mut joined, mut comment, mut left_out) = (0, false, false);
    for line in bytes.split(|&b| b == b'\n').map(<[u8]>::trim_ascii_end) {
        if joined == 0 {
            let first = line.split(u8::is_ascii_whitespace).find(|word| !word.is_empty()).unwrap_or_default();
            // A path may end a comment with a backslash.
            (comment, left_out) = (first.starts_with(b"#"), first == b"l");
        }
        let (text, continued) = match line.strip_suffix(b"\\") {
            Some(text) if !comment => (text, true),
            _ => (line, false),
        };
        if !left_out {
            plain.extend_from_slice(text);
        }
        if continued {
            plain.push(b' ');
            joined += 1;
        } else {
            plain.extend(std::iter::repeat_n(b'\n', 1 + joined));
            joined = 0;
        }
    }
    plain
}

/// The same with white at vertices without a colour, if others have one: tobj takes the n-th colour for that of the n-th vertex.
fn with_all_colors(text: Vec<u8>) -> Vec<u8> {
    let lines = || text.split(|&b| b == b'\n');
    let numbers = |line: &[u8]| {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        if words.next() == Some(b"v") { words.count() } else { 0 }
    };
    let has = |count: usize| lines().any(|line| numbers(line) == count);
    if !(has(6) && has(3)) {
        return text;
    }
    let white = |line| if numbers(line) == 3 { &b" 1 1 1\n"[..] } else { b"\n" };
    lines().flat_map(|line| [line, white(line)]).flatten().copied().collect()
}

/// A material file whose colours have three numbers: tobj panics at fewer. One number is a grey; other colours, as spectral ones,
/// are left out.
fn with_three_numbers(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    let mut plain = String::with_capacity(text.len());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let kind = words.next().filter(|kind| ["Ka", "Kd", "Ks", "Ke"].contains(kind));
        let numbers: Vec<&str> = words.take_while(|word| word.parse::<f32>().is_ok()).collect();
        match (kind, &numbers[..]) {
            (None, _) | (_, [_, _, _, ..]) => plain += line,
            (Some(kind), [grey]) => plain += &format!("{kind} {grey} {grey} {grey}"),
            _ => {}
        }
        plain.push('\n');
    }
    plain
}

/// The first line that is not valid OBJ, or has an index out of range: the parser's errors do not name the line.
fn line_of(bytes: &[u8]) -> String {
    let words = |line: &[u8]| String::from_utf8_lossy(line).split_whitespace().map(String::from).collect::<Vec<_>>();
    // Positions, texture coordinates and normals; a face may refer to later lines.
    let count = |kind: &str| {
        let of_kind = bytes.split(|&b| b == b'\n').filter(|line| words(line).first().is_some_and(|w| w == kind));
        of_kind.count() as i64
    };
    let counts = ["v", "vt", "vn"].map(count);
    let index = |text: &str, count: i64| text.parse::<i64>().is_ok_and(|i| (1..=count).contains(&i.abs()));
    let corner = |word: &String| {
        let parts: Vec<&str> = word.split('/').collect();
        parts.len() <= 3
            && parts.iter().zip(counts).enumerate().all(|(k, (text, n))| (k > 0 && text.is_empty()) || index(text, n))
    };
    let suspicious = |line: &[u8]| {
        let words = words(line);
        let Some((kind, rest)) = words.split_first() else { return false };
        let numbers = rest.iter().all(|word| word.parse::<f32>().is_ok());
        match kind.as_str() {
            "v" | "vn" => !numbers || rest.len() < 3,
            "vt" => !numbers || rest.is_empty(),
            "f" => !rest.iter().all(corner),
            _ => std::str::from_utf8(line).is_err(),
        }
    };
    match bytes.split(|&b| b == b'\n').position(suspicious) {
        Some(line) => format!("line {}", line + 1),
        None => String::new(),
    }
}
