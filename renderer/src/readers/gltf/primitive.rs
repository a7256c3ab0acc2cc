//! The triangles of a mesh: positions with morph targets and joint weights, colours, texture coordinates.

use super::super::{FormatError, check_indices};
use super::accessor::Data;
use crate::materials::Surface;
use gltf::mesh::Mode;
use gltf::{Accessor, Semantic};
use mbkd::glam::{DVec3, Vec2, Vec3};

/// A primitive of a mesh, before it is posed.
pub struct Primitive {
    /// Three vertex indices per triangle, all in range.
    pub indices: Vec<[u32; 3]>,
    /// Positions before morphing and skinning.
    pub positions: Vec<DVec3>,
    /// The offsets of each morph target at weight 1, one per vertex.
    pub targets: Vec<Vec<DVec3>>,
    /// Joints of each vertex and their weights; empty without a skin.
    pub influences: Vec<Vec<(u32, f64)>>,
    /// Its surface.
    pub surface: Surface,
}

/// Reads a primitive; `None` if it consists of points or lines.
pub fn read(
    primitive: &gltf::Primitive,
    place: &str,
    data: &Data,
    surface: Surface,
) -> Result<Option<Primitive>, FormatError> {
    let order = match primitive.mode() {
        Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan => primitive.mode(),
        _ => return Ok(None),
    };
    let positions = primitive.get(&Semantic::Positions).ok_or_else(|| FormatError::new(place, "has no positions"))?;
    let positions = vectors(data, &positions)?;
    let count = positions.len();
    let same_count = |what: &str, found: usize| {
        let message = || format!("{found} {what} for {count} positions");
        if found == count { Ok(()) } else { Err(FormatError::new(place, message())) }
    };
    let list: Vec<u32> = match primitive.indices() {
        Some(accessor) => data.integers::<1>(&accessor)?.into_iter().map(|[i]| i).collect(),
        None => (0..count as u32).collect(),
    };
    let indices = triangles(order, &list);
    check_indices(place, &indices, count)?;

    let mut targets = Vec::new();
    for target in primitive.morph_targets() {
        let offsets = match target.positions() {
            Some(accessor) => vectors(data, &accessor)?,
            None => vec![DVec3::ZERO; count],
        };
        same_count("morph offsets", offsets.len())?;
        targets.push(offsets);
    }

    let mut influences = Vec::new();
    for set in 0.. {
        let (joints, weights) = (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)));
        let (Some(joints), Some(weights)) = (joints, weights) else { break };
        let (joints, weights) = (data.integers::<4>(&joints)?, data.floats::<4>(&weights)?);
        same_count("joints", joints.len())?;
        same_count("weights", weights.len())?;
        influences.resize(count, Vec::new());
        for (all, (joints, weights)) in influences.iter_mut().zip(joints.into_iter().zip(weights)) {
            all.extend(joints.into_iter().zip(weights).filter(|(_, w)| *w != 0.0).map(|(j, w)| (j, f64::from(w))));
        }
    }

    let mut surface = surface;
    if let Some(accessor) = primitive.get(&Semantic::Colors(0)) {
        surface.vertex_colors = colors(data, &accessor)?;
        same_count("colours", surface.vertex_colors.len())?;
    }
    match primitive.get(&Semantic::TexCoords(coordinates(&primitive.material()))) {
        Some(accessor) if surface.has_pictures() => {
            surface.uvs = data.floats::<2>(&accessor)?.into_iter().map(Vec2::from).collect();
            same_count("texture coordinates", surface.uvs.len())?;
        }
        Some(_) => {}
        None => surface.drop_pictures(),
    }
    Ok(Some(Primitive { indices, positions, targets, influences, surface }))
}

/// The set of texture coordinates of a material: that of the first texture it has.
pub fn coordinates(material: &gltf::Material) -> u32 {
    let pbr = material.pbr_metallic_roughness();
    let pictures = [pbr.base_color_texture(), pbr.metallic_roughness_texture(), material.emissive_texture()];
    pictures.into_iter().flatten().next().map_or(0, |info| info.tex_coord())
}

fn vectors(data: &Data, accessor: &Accessor) -> Result<Vec<DVec3>, FormatError> {
    Ok(data.floats::<3>(accessor)?.into_iter().map(|p| DVec3::from(p.map(f64::from))).collect())
}

fn colors(data: &Data, accessor: &Accessor) -> Result<Vec<Vec3>, FormatError> {
    let rows = match accessor.dimensions() {
        gltf::accessor::Dimensions::Vec4 => {
            data.floats::<4>(accessor)?.into_iter().map(|[r, g, b, _]| [r, g, b]).collect()
        }
        _ => data.floats::<3>(accessor)?,
    };
    // NaN is shown as black.
    let channel = |x: f32| if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
    Ok(rows.into_iter().map(|c| Vec3::from(c.map(channel))).collect())
}

fn triangles(mode: Mode, list: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => list
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        Mode::TriangleFan => list.windows(2).skip(1).map(|w| [list[0], w[0], w[1]]).collect(),
        _ => list.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    }
}
