//! What colour a surface has where it was hit.

use crate::sampling::mix;
use crate::smooth::Normals;
use mbkd::Hit;
use mbkd::glam::{Vec2, Vec3};
use mbkd_scenes::Look;
use std::sync::Arc;

/// The diffuse surface of a mesh.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Base colour, linear.
    pub color: Vec3,
    /// Groups of this many triangles lie somewhere between `color` and `other`; 0: all are `color`.
    pub group: u32,
    /// The other end of the range of colours.
    pub other: Vec3,
    /// A colour per vertex that multiplies the base colour; may be empty.
    pub vertex_colors: Vec<Vec3>,
    /// Texture coordinates per vertex; may be empty.
    pub uvs: Vec<Vec2>,
    /// A picture that multiplies the base colour.
    pub texture: Option<Arc<Texture>>,
    /// Shading normals; without them triangles look flat.
    pub normals: Option<Arc<Normals>>,
}

impl Surface {
    /// One colour throughout.
    pub fn plain(color: Vec3) -> Surface {
        Surface { color, group: 0, other: color, vertex_colors: vec![], uvs: vec![], texture: None, normals: None }
    }

    /// The look a scene asks for.
    pub fn of(look: &Look) -> Surface {
        Surface { other: look.other, group: look.group, ..Surface::plain(look.color) }
    }

    /// The shading normal at a hit, on the side of the true normal `flat`, which it is where there is no other.
    pub fn normal_at(&self, hit: &Hit, time: f32, flat: Vec3) -> Vec3 {
        let Some(normals) = &self.normals else { return flat };
        let smooth = normals.at(hit.primitive as usize, [1.0 - hit.u - hit.v, hit.u, hit.v], time);
        match smooth.dot(flat) {
            along if along > 0.0 => smooth,
            along if along < 0.0 => -smooth,
            _ => flat,
        }
    }

    /// The colour at a hit on the triangle with these vertices.
    pub fn color_at(&self, hit: &Hit, triangle: [u32; 3]) -> Vec3 {
        let mut color = self.color;
        if let Some(group) = hit.primitive.checked_div(self.group) {
            let random = mix(0xc010, u64::from(group)) as u32 >> 8;
            color = color.lerp(self.other, random as f32 / (1u32 << 24) as f32);
        }
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        if !self.vertex_colors.is_empty() {
            let at = |k: usize| self.vertex_colors.get(triangle[k] as usize).copied().unwrap_or(Vec3::ONE);
            color *= at(0) * weights[0] + at(1) * weights[1] + at(2) * weights[2];
        }
        if let Some(texture) = &self.texture {
            let at = |k: usize| self.uvs.get(triangle[k] as usize).copied().unwrap_or(Vec2::ZERO);
            color *= texture.at(at(0) * weights[0] + at(1) * weights[1] + at(2) * weights[2]);
        }
        color
    }
}

/// A picture in linear light, repeated over the plane.
#[derive(Debug)]
pub struct Texture {
    /// Pixels across; at least 1.
    pub width: u32,
    /// Rows, the first at v = 0; at least 1.
    pub height: u32,
    /// Row by row, sRGB as files have it.
    pub pixels: Vec<[u8; 3]>,
}

impl Texture {
    /// The pixel at (u, v), without filtering: the many samples of a pixel filter it.
    fn at(&self, uv: Vec2) -> Vec3 {
        if !uv.is_finite() {
            return Vec3::ZERO;
        }
        let place = |x: f32, size: u32| (((x - x.floor()) * size as f32) as u32).min(size - 1);
        let (x, y) = (place(uv.x, self.width), place(uv.y, self.height));
        let [r, g, b] = self.pixels[(y * self.width + x) as usize];
        Vec3::new(crate::film::decode(r), crate::film::decode(g), crate::film::decode(b))
    }
}
