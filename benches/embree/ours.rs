//! Our side.

use crate::geometry::{corners, pass};
use mbkd::{Hit, Ray, TriangleMesh};

/// TEMPORARY: brute force.
pub struct Ours {
    meshes: Vec<TriangleMesh>,
}

impl Ours {
    pub fn build(meshes: &[TriangleMesh], _threads: usize) -> Result<Ours, String> {
        Ok(Ours { meshes: meshes.to_vec() })
    }

    pub fn with_avx2(self) -> Result<Ours, String> {
        Ok(self)
    }

    pub fn bytes(&self) -> usize {
        0
    }

    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (m, mesh) in self.meshes.iter().enumerate() {
            for k in 0..mesh.len() {
                let p = pass(ray, corners(&self.meshes, m as u32, k as u32, ray.time));
                let t = p.t as f32;
                if p.margin >= 0.0 && ray.t_min <= t && t <= ray.t_max && best.is_none_or(|b| t < b.t) {
                    best = Some(Hit { t, u: 0.0, v: 0.0, mesh: m as u32, primitive: k as u32 });
                }
            }
        }
        best
    }

    pub fn any_hit(&self, ray: &Ray) -> bool {
        self.closest_hit(ray).is_some()
    }

    pub fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        rays.iter().zip(hits).for_each(|(ray, hit)| *hit = self.closest_hit(ray));
    }

    pub fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        rays.iter().zip(hits).for_each(|(ray, hit)| *hit = self.any_hit(ray));
    }
}
