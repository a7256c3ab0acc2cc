//! The appearance of surfaces at a hit: colour, gloss and emission.

use crate::gloss::Gloss;
use crate::sampling::mix;
use crate::smooth::Normals;
use mbkd::Hit;
use mbkd::glam::{Vec2, Vec3};
use mbkd_scenes::Look;
use std::sync::Arc;

/// The surface of a mesh.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Base colour, linear.
    pub color: Vec3,
    /// Groups of this many triangles have a colour between `color` and `other`; 0: all have `color`.
    pub group: u32,
    /// The other end of the range of colours.
    pub other: Vec3,
    /// A colour per vertex that multiplies the base colour; may be empty.
    pub vertex_colors: Vec<Vec3>,
    /// Texture coordinates per vertex; may be empty.
    pub uvs: Vec<Vec2>,
    /// A texture that multiplies the base colour.
    pub texture: Option<Arc<Texture>>,
    /// Metal or gloss; without it the surface is diffuse.
    pub finish: Option<Finish>,
    /// Emitted radiance, linear.
    pub emission: Vec3,
    /// A texture that multiplies the emission.
    pub emission_texture: Option<Arc<Texture>>,
    /// Shading normals; without them triangles look flat.
    pub normals: Option<Arc<Normals>>,
}

impl Surface {
    /// One colour throughout.
    pub fn plain(color: Vec3) -> Surface {
        Surface {
            color,
            group: 0,
            other: color,
            vertex_colors: vec![],
            uvs: vec![],
            texture: None,
            finish: None,
            emission: Vec3::ZERO,
            emission_texture: None,
            normals: None,
        }
    }

    /// Whether it needs texture coordinates.
    pub fn has_pictures(&self) -> bool {
        let of_finish = self.finish.as_ref().is_some_and(|finish| finish.texture.is_some());
        self.texture.is_some() || self.emission_texture.is_some() || of_finish
    }

    /// Removes textures.
    pub fn drop_pictures(&mut self) {
        (self.texture, self.emission_texture) = (None, None);
        self.finish.iter_mut().for_each(|finish| finish.texture = None);
    }

    /// The surface for a scene's look.
    pub fn of(look: &Look) -> Surface {
        Surface { other: look.other, group: look.group, ..Surface::plain(look.color) }
    }

    /// The shading normal at a hit, on the side of the true normal `flat`, which is the default.
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
            color *= texture.at(self.uv_at(hit, triangle));
        }
        color
    }

    /// The gloss at a hit, if the surface has any, for this colour.
    pub fn gloss_at(&self, hit: &Hit, triangle: [u32; 3], color: Vec3) -> Option<Gloss> {
        let Finish { metallic, roughness, texture } = self.finish.as_ref()?;
        let [_, green, blue] = texture.as_ref().map_or([255; 3], |texture| texture.raw(self.uv_at(hit, triangle)));
        let of = |byte: u8| f32::from(byte) / 255.0;
        Some(Gloss::new(color, metallic * of(blue), roughness * of(green)))
    }

    /// The emitted radiance at a hit.
    pub fn emission_at(&self, hit: &Hit, triangle: [u32; 3]) -> Vec3 {
        match &self.emission_texture {
            Some(texture) => self.emission * texture.at(self.uv_at(hit, triangle)),
            None => self.emission,
        }
    }

    fn uv_at(&self, hit: &Hit, triangle: [u32; 3]) -> Vec2 {
        let at = |k: usize| self.uvs.get(triangle[k] as usize).copied().unwrap_or(Vec2::ZERO);
        at(0) * (1.0 - hit.u - hit.v) + at(1) * hit.u + at(2) * hit.v
    }
}

/// The gloss of a surface.
#[derive(Clone, Debug)]
pub struct Finish {
    /// From 0 (the colour is that of the base below a clear coat) to 1 (a metal).
    pub metallic: f32,
    /// From 0 (a mirror) to 1.
    pub roughness: f32,
    /// A texture whose blue multiplies the former and whose green the latter.
    pub texture: Option<Arc<Texture>>,
}

/// A texture in linear light, repeated over the plane.
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
    /// The light at (u, v).
    fn at(&self, uv: Vec2) -> Vec3 {
        Vec3::from(self.raw(uv).map(crate::film::decode))
    }

    /// The pixel at (u, v), without filtering: the many samples of a pixel filter it.
    fn raw(&self, uv: Vec2) -> [u8; 3] {
        if !uv.is_finite() {
            return [0; 3];
        }
        let place = |x: f32, size: u32| (((x - x.floor()) * size as f32) as u32).min(size - 1);
        let (x, y) = (place(uv.x, self.width), place(uv.y, self.height));
        self.pixels[(y * self.width + x) as usize]
    }
}
