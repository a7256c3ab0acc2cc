//! The simple shading of section 3: a light from the side, a grey for each triangle's neighbourhood. It is the same code for every
//! structure, and looks at the meshes, not at a tree.

use mbkd::glam::Vec3;
use mbkd::{Hit, Keys, Ray, TriangleMesh};

/// The meshes that are lit.
pub struct Shading<'a> {
    meshes: &'a [TriangleMesh],
}

/// The light's direction, of length 1.
const LIGHT: Vec3 = Vec3::new(0.48, 0.64, 0.6);
/// What rays see that hit nothing.
const SKY: f32 = 0.3;

impl<'a> Shading<'a> {
    /// Of some meshes.
    pub fn new(meshes: &'a [TriangleMesh]) -> Shading<'a> {
        Shading { meshes }
    }

    /// What a ray sees.
    #[inline]
    pub fn value(&self, ray: &Ray, hit: Option<Hit>) -> f32 {
        let Some(hit) = hit else { return SKY };
        let [a, b, c] = self.corners(&hit, ray.time);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        // Successive triangles lie side by side; eight of them share a grey.
        let mixed = (hit.primitive / 8).wrapping_mul(0x9e37_79b9) ^ hit.mesh.wrapping_mul(0x85eb_ca6b);
        let grey = 0.2 + 0.8 * (mixed >> 8) as f32 / (1 << 24) as f32;
        grey * (0.15 + 0.85 * normal.dot(LIGHT).abs())
    }

    fn corners(&self, hit: &Hit, time: f32) -> [Vec3; 3] {
        let mesh = &self.meshes[hit.mesh as usize];
        let Keys::F32(keys) = &mesh.keys else { return [Vec3::ZERO; 3] };
        let at = time * (keys.len() - 1) as f32;
        let first = (at as usize).min(keys.len().saturating_sub(2));
        let last = (first + 1).min(keys.len() - 1);
        mesh.indices[hit.primitive as usize]
            .map(|i| keys[first][i as usize].lerp(keys[last][i as usize], at - first as f32))
    }
}
